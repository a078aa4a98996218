"""Compute the data from which the metric is learned: an encoder's features and the thickness at vertices."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import dfd
from bench.quality.measures import area_fractions
from bench.quality.parts import family_of
from bench.quality.shapes import Shape
from bench.training.sources import cached_arrays
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.distillation.smoothing import build_diffusion, smooth_along_surface
from dfd.distillation.targets import PixelTargets, unit
from dfd.distillation.thickness import thickness_bands
from dfd.encoders.encode import Encoder
from dfd.upright.find_up import resolve_up
from dfd.views.render import render

NEAREST = 3  # number of surface points from which the feature of a vertex is interpolated
THICKNESS = 0.25  # factor on the bands of thickness, which are appended to features of unit length
FEWEST = 5  # smallest number of vertices of a part; smaller parts are ignored


@dataclass(frozen=True, eq=False)
class Lesson:
    """A labelled training shape with the data of its vertices, interpolated from the targets of its distillation."""

    shape: Shape
    features: Float32  # (V, D) unit rows
    thickness: Float32  # (V, BANDS), see `dfd.distillation.thickness`

    @property
    def family(self) -> str:
        """Return the family of the shape, see `family_of`."""
        return family_of(self.shape.name)

    @cached_property
    def mean(self) -> Float32:
        """Return the mean feature (D,) over the surface."""
        mean = np.average(self.features, axis=0, weights=area_fractions(self.shape.mesh))
        return np.asarray(mean, np.float32)

    @property
    def kinds(self) -> list[tuple[str, Float32]]:
        """Return the name of each part, and the features (N, D) of its vertices."""
        return [(name, self.features[self.shape.labels == part]) for part, name in enumerate(self.shape.parts)]

    @cached_property
    def scatters(self) -> tuple[Float64, Float64]:
        """Return covariance matrices within and between parts, with D + BANDS rows, divided by the trace of the sum."""
        every = np.concatenate([self.features, np.float32(THICKNESS) * self.thickness], axis=1, dtype=np.float64)
        rows = [every[self.shape.labels == part] for part in range(len(self.shape.parts))]
        rows = [part for part in rows if len(part) >= FEWEST]
        within = np.mean([np.cov(part.T, bias=True) for part in rows], axis=0)
        between = np.cov(np.stack([part.mean(axis=0) for part in rows]).T, bias=True)
        trace = np.trace(within + between)
        return within / trace, between / trace


def cached_lesson(folder: Path, shape: Shape, encoder: Encoder) -> Lesson:
    """Return the lesson of a shape. The results of `vertex_features` are cached in a file in `folder`."""

    def made() -> dict[str, NDArray[Any]]:
        features, thickness = vertex_features(shape.mesh, encoder)
        return {"features": features.astype(np.float16), "thickness": thickness}

    kept = cached_arrays(folder / f"{shape.mesh.content_hash}.npz", made)
    return Lesson(shape, unit(kept["features"].astype(np.float32)), kept["thickness"])


def vertex_features(mesh: dfd.Mesh, encoder: Encoder, **changes: Any) -> tuple[Float32, Float32]:
    """Return `features` and `thickness` of a `Lesson`; +y is up, and `changes` are settings of `dfd.distill`."""
    settings, stages = DistillSettings(up="file", **changes), Stages(show=False)
    frame = resolve_up(mesh, encoder, settings.up, stages=stages).frame
    views = render(mesh, **settings.of_pictures(), frame=frame, stages=stages)
    pixels = PixelTargets(views, encoder.encode(views.images, covered=views.covered))
    problem = build_diffusion(views, pixels.grid, smoothing=settings.smoothing, seed=settings.seed)
    targets = smooth_along_surface(pixels, problem, stages=stages)
    vertices = (mesh.vertices - views.center) * views.scale
    distance, near = cKDTree(targets.points).query(vertices, NEAREST)
    nearness = 1 / np.square(distance + 1e-6)
    nearness /= nearness.sum(axis=1, keepdims=True)

    def at_vertices(rows: Float32) -> Float32:
        return np.asarray(np.einsum("vkd,vk->vd", rows[near], nearness.astype(np.float32)), np.float32)

    return unit(at_vertices(targets.features)), at_vertices(thickness_bands(views, targets))
