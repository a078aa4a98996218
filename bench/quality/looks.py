"""What an encoder sees at the vertices of a shape, before a field is fitted: what a metric is learned from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import dfd
from dfd.common.files import atomic_write
from dfd.common.progress import Stages
from dfd.distillation.contrast import unit
from dfd.distillation.settings import DistillSettings
from dfd.distillation.smoothing import spread
from dfd.distillation.targets import PixelTargets
from dfd.distillation.upright import said_or_found
from dfd.encoders.encode import Encoder
from dfd.views.render import render

__all__ = ["kept_looks", "looks"]

NEAREST = 3  # points that a vertex is interpolated from


def kept_looks(folder: Path, mesh: dfd.Mesh, encoder: Encoder) -> NDArray[np.float32]:
    """`looks`, from `folder` if they are there: taking them takes seconds for each shape."""
    path = folder / f"{mesh.content_hash}.npy"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            np.save(stream, looks(mesh, encoder).astype(np.float16))
    return unit(np.load(path).astype(np.float32))


def looks(mesh: dfd.Mesh, encoder: Encoder, **changes: Any) -> NDArray[np.float32]:
    """Unit features (V, D) at the vertices of `mesh`, +y up, as they are after spreading, by the plain distance.

    `changes` are settings of `dfd.distill` that are not its defaults.
    """
    settings, stages = DistillSettings(up="file", **changes), Stages(show=False)
    frames = said_or_found(mesh, encoder, settings.up, stages=stages).frames
    views = render(mesh, **settings.of_pictures(), frame=frames, stages=stages)
    pixels = PixelTargets(views, encoder.encode(views.images, covered=views.covered))
    targets = spread(views, pixels, smoothing=settings.smoothing, seed=settings.seed, stages=stages)
    vertices = (mesh.vertices - views.center) * views.scale
    distance, near = cKDTree(targets.points).query(vertices, NEAREST)
    shares = 1 / np.square(distance + 1e-6)
    shares /= shares.sum(axis=1, keepdims=True)
    return unit(np.einsum("vkd,vk->vd", targets.features[near], shares.astype(np.float32)))
