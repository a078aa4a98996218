"""What a metric is learned from: what an encoder sees at the vertices of a shape, and how thick the shape is there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import dfd
from bench.quality.measures import area_fractions
from bench.quality.parts import family_of
from bench.quality.shapes import Shape
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Float32, Float64
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.distillation.smoothing import build_diffusion, smooth_along_surface
from dfd.distillation.targets import PixelTargets, unit
from dfd.distillation.thickness import thickness_bands
from dfd.encoders.encode import Encoder
from dfd.upright.find_up import resolve_up
from dfd.views.render import render

NEAREST = 3  # points that a vertex is interpolated from
THICKNESS = 0.25  # that a band of thickness counts, beside the numbers of a feature of unit length
FEWEST = 5  # vertices of a part that says something


@dataclass(frozen=True, eq=False)
class VertexFeatures:
    """What distillation has at the vertices of a shape before a field is fitted, by the plain distance."""

    features: Float32  # (V, D) unit rows
    thickness: Float32  # (V, BANDS), see `dfd.distillation.thickness`


@dataclass(frozen=True, eq=False)
class Lesson:
    """A labelled shape with what is seen at its vertices."""

    shape: Shape
    seen: VertexFeatures

    @property
    def family(self) -> str:
        """See `family_of`."""
        return family_of(self.shape.name)

    @cached_property
    def mean(self) -> Float32:
        """(D,) the mean feature of the surface, whose faces stand for their corners."""
        mean = np.average(self.seen.features, axis=0, weights=area_fractions(self.shape.mesh))
        return np.asarray(mean, np.float32)

    @property
    def kinds(self) -> list[tuple[str, Float32]]:
        """The name of each part, and the features (N, D) of its vertices."""
        return [(name, self.seen.features[self.shape.labels == part]) for part, name in enumerate(self.shape.parts)]

    @cached_property
    def scatters(self) -> tuple[Float64, Float64]:
        """How features and bands vary within and between parts, (D + BANDS, D + BANDS) each; their sum has trace 1.

        Parts count alike.
        """
        every = np.concatenate(
            [self.seen.features, np.float32(THICKNESS) * self.seen.thickness], axis=1, dtype=np.float64
        )
        rows = [every[self.shape.labels == part] for part in range(len(self.shape.parts))]
        rows = [part for part in rows if len(part) >= FEWEST]
        within = np.mean([np.cov(part.T, bias=True) for part in rows], axis=0)
        between = np.cov(np.stack([part.mean(axis=0) for part in rows]).T, bias=True)
        trace = np.trace(within + between)
        return within / trace, between / trace


def cached_vertex_features(folder: Path, mesh: dfd.Mesh, encoder: Encoder) -> VertexFeatures:
    """`vertex_features`, from `folder` if they are there: taking them takes seconds for each shape."""
    path = folder / f"{mesh.content_hash}.npz"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary, temporary.open("wb") as stream:
            seen = vertex_features(mesh, encoder)
            np.savez(stream, features=seen.features.astype(np.float16), thickness=seen.thickness)
    with np.load(path) as kept:
        return VertexFeatures(unit(kept["features"].astype(np.float32)), kept["thickness"])


def vertex_features(mesh: dfd.Mesh, encoder: Encoder, **changes: Any) -> VertexFeatures:
    """What `mesh`, +y up, looks like at its vertices, as distillation has it at the surface points around them.

    `changes` are settings of `dfd.distill` that are not its defaults.
    """
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

    return VertexFeatures(unit(at_vertices(targets.features)), at_vertices(thickness_bands(views, targets)))
