"""Fixtures that several test files use."""

import os
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # several processes share the cores; must be set before torch is imported
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
import torch
from filelock import FileLock
from hypothesis import HealthCheck, settings
from made_field import field_of
from numpy.typing import NDArray
from prepared import parts_once

import dfd
from dfd import Field, Mesh
from dfd.samples import Sample

# Without a deadline, tests do not fail on a busy machine.
settings.register_profile("any machine", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Use a temporary cache and a temporary data folder instead of the user's, also in child processes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DFD_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.setenv("DFD_DATA", str(tmp_path_factory.mktemp("data")))
        yield


@pytest.fixture(autouse=True)
def _own_thread_count() -> Iterator[None]:
    """Restore the number of threads after each test."""
    before = dfd.get_num_threads()
    yield
    dfd.set_num_threads(before)


@pytest.fixture(autouse=True, scope="module")
def _parts_once(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let equal sessions share their parts, except in the tests of parts."""
    with nullcontext() if "segmentation" in request.path.parts else parts_once():
        yield


@pytest.fixture(scope="module")
def one_thread() -> Iterator[None]:
    """Use one thread for torch and dfd. The networks of the tests are so small that more threads are slower."""
    threads, own = torch.get_num_threads(), dfd.get_num_threads()
    torch.set_num_threads(1)
    dfd.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
    dfd.set_num_threads(own)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return a function that returns a folder by name. `make` fills it once in a run; tests must not write into it."""
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent

    def folder_of(name: str, make: Callable[[Path], object]) -> Path:
        folder = shared / name
        with FileLock(shared / f"{name}.lock"):
            if not folder.exists():
                unfinished = shared / f"{name}.unfinished"
                unfinished.mkdir(exist_ok=True)
                make(unfinished)
                unfinished.rename(folder)
        return folder

    return folder_of


@pytest.fixture(scope="session")
def tiny_encoder(made_once: Callable[..., Path]) -> Path:
    """Return the folder of a vision network that encodes a picture in a millisecond."""
    from tiny_encoder import save_tiny_encoder  # imports transformers, which takes seconds

    return made_once("tiny_encoder", save_tiny_encoder)


@pytest.fixture(scope="session")
def chair_sample() -> Sample:
    return read_only(dfd.samples.chair(4000))


@pytest.fixture(scope="session")
def chair_mesh(chair_sample: Sample) -> Mesh:
    return chair_sample.mesh


@pytest.fixture(scope="session")
def mesh(chair_mesh: Mesh) -> Mesh:
    return chair_mesh


@pytest.fixture(scope="session")
def field(mesh: Mesh) -> Field:
    """Return a field of the chair with random weights."""
    return field_of(mesh, seed=1)


@pytest.fixture(scope="session")
def features(mesh: Mesh, field: Field) -> NDArray[np.float32]:
    return field.features(mesh)


@pytest.fixture(scope="session")
def quadruped_sample() -> Sample:
    return read_only(dfd.samples.quadruped(4000))


def read_only(sample: Sample) -> Sample:
    """Make the label arrays of a sample read-only; the arrays of its mesh already are read-only."""
    for labels in (sample.labels, sample.instances):
        labels.flags.writeable = False
    return sample
