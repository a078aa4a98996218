"""What the tests of runs set up alike."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from stopped_runs import FEW_NODES, SMALL
from tiny_encoder import save_tiny_encoder

import dfd
from dfd import Field, Mesh
from dfd.distillation import smoothing


@pytest.fixture(autouse=True, scope="module")
def _small_and_alone() -> Iterator[None]:
    """Features spread over fewer points, which is quicker; no hub is asked."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        patch.setattr(smoothing, "SURFACE_SAMPLES", FEW_NODES)
        yield


@pytest.fixture(scope="module")
def encoder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny_encoder(tmp_path_factory.mktemp("encoder") / "tiny")


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """A shape that is not its own mirror image, so that no two pictures are the same."""
    chair = dfd.samples.chair(4000).mesh
    return Mesh(chair.vertices @ [[1.0, 0.0, 0.2], [0.1, 1.0, 0.1], [0.0, 0.0, 1.0]], chair.faces)


@pytest.fixture(scope="module")
def whole(encoder: Path, mesh: Mesh) -> Field:
    """What an uninterrupted run gives."""
    return dfd.distill(mesh, encoder, **SMALL)
