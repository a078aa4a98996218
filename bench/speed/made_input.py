"""Made input of any size: features of low rank as a field gives them, vertices, transforms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh
from numpy.typing import NDArray

import dfd
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.field.architecture import Architecture

WIDTH = 384  # of the features of a small vision transformer


@dataclass(frozen=True)
class MadeInput:
    """A shape without faces: what binding and posing see of one."""

    vertices: Float32  # (V, 3)
    compact: dfd.CompactFeatures
    transforms: Float64  # (100, 3, 4)

    def features(self, count: int | None = None) -> Float32:
        """(count, 384) unit rows of the first vertices, or of all."""
        return field(self.vertices[:count])

    def handles(self, count: int) -> Int64:
        """`count` distinct vertices, spread over the shape."""
        return np.linspace(0, len(self.vertices) - 1, count).astype(np.int64)


def field(points: NDArray[np.floating]) -> Float32:
    """(N, 384) unit rows: smooth functions of the position whose amplitudes fall off, as distilled features' do."""
    random = np.random.default_rng(0)
    rank = 64
    frequencies = random.standard_normal((3, rank)) * np.linspace(0.3, 2.5, rank)
    phases = random.uniform(0, 2 * np.pi, rank)
    lift = random.standard_normal((rank, WIDTH)) * (0.9 ** np.arange(rank))[:, None]
    offset = 2.5 * random.standard_normal(WIDTH)
    rows = np.sin(points.astype(np.float32) @ frequencies.astype(np.float32) + phases.astype(np.float32))
    rows = rows @ lift.astype(np.float32) + offset.astype(np.float32)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return rows


@lru_cache(maxsize=1)
def make_input(vertex_count: int) -> MadeInput:
    """The input with so many vertices."""
    random = np.random.default_rng(1)
    vertices = random.standard_normal((vertex_count, 3), dtype=np.float32)
    transforms = np.eye(3, 4) + 0.05 * random.standard_normal((1000, 3, 4))
    return MadeInput(vertices, dfd.compact(field, vertices), transforms)


def mirrored_field() -> dfd.Field:
    """A field of the usual size with random weights, which sees nothing of x: it looks alike on both sides of x = 0."""
    random = np.random.default_rng(0)
    parameters = {
        name: (random.standard_normal(shape) / np.sqrt(shape[-1])).astype(np.float32)
        for name, shape in Architecture(WIDTH).shapes().items()
    }
    parameters["network.0.weight"][:, 0] = 0
    return dfd.Field(parameters)


def torus(face_count: int) -> dfd.Mesh:
    """A torus of about so many faces."""
    around = max(int(np.sqrt(face_count / 6)), 4)
    made = trimesh.creation.torus(1.0, 0.35, major_sections=max(face_count // (2 * around), 4), minor_sections=around)
    return dfd.Mesh(made.vertices, made.faces)
