"""Made input of any size: features of low rank as a field gives them, vertices, transforms; and the calls to time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import trimesh
from numpy.typing import NDArray

import dfd
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.field.architecture import Architecture

WIDTH = 384  # of the features of a small vision transformer
VERTICES = 500_000
CONSTRAINED = "bind 10 + 3 fixed + locality"
BINDINGS = ("bind 1", "bind 10", CONSTRAINED, "bind 100")
ONE_POSE = ("pose {}", "mirrored pose {}", "drag frame with {} handles")
POSES = tuple(name.format(count) for name in ONE_POSE for count in (1, 100))

Calls = dict[str, Callable[[], object]]


@dataclass(frozen=True)
class MadeInput:
    """A shape without faces, which binding and posing do not need."""

    vertices: Float32  # (V, 3)
    compact: dfd.CompactFeatures
    transforms: Float64  # (100, 3, 4)

    def features(self, count: int | None = None) -> Float32:
        """Return unit rows (count, 384) of the first vertices, or of all."""
        return field(self.vertices[:count])

    def handles(self, count: int) -> Int64:
        """Return `count` distinct vertices, spread over the shape."""
        return np.linspace(0, len(self.vertices) - 1, count).astype(np.int64)

    def bindings(self) -> Calls:
        """Return the calls named in `BINDINGS`, which write weights of compact features into existing arrays."""
        outs = {count: np.empty((len(self.vertices), count), np.float32) for count in (1, 10, 100)}
        calls: Calls = {
            f"bind {count}": partial(dfd.bind, self.compact, self.handles(count), out=out)
            for count, out in outs.items()
        }
        distances = np.random.default_rng(0).random((10, len(self.vertices)), dtype=np.float32)
        calls[CONSTRAINED] = partial(calls["bind 10"], fixed=[1, 2, 3], geodesic=distances, locality=2.0)
        return calls

    def poses(self, dtype: str = "float32") -> Calls:
        """Return the calls named in `POSES`. All handles move; in a drag, only one does."""
        vertices, calls = self.vertices.astype(dtype), Calls()
        out, plane = np.empty_like(vertices), dfd.SymmetryPlane((1.0, 0.0, 0.0), 0.0, band=0.01)
        for count in (1, 100):
            handles, transforms = self.handles(count), self.transforms[:count]
            weights = dfd.bind(self.compact, handles) / count
            pose = partial(dfd.pose, vertices, weights, transforms, out=out)
            mirrored = partial(pose, symmetry=plane, handles=vertices[handles])
            drag = partial(dfd.Drag(vertices, weights, transforms, [0]).pose, transforms[:1], out=out)
            calls |= {name.format(count): call for name, call in zip(ONE_POSE, (pose, mirrored, drag), strict=True)}
        return calls


def field(points: NDArray[np.floating]) -> Float32:
    """Return unit rows (N, 384): smooth functions of position with falling amplitudes, like distilled features."""
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
def make_input(vertex_count: int = VERTICES) -> MadeInput:
    """Return the input with so many vertices."""
    random = np.random.default_rng(1)
    vertices = random.standard_normal((vertex_count, 3), dtype=np.float32)
    transforms = np.eye(3, 4) + 0.05 * random.standard_normal((100, 3, 4))
    return MadeInput(vertices, dfd.compact(field, vertices), transforms)


def mirrored_field() -> dfd.Field:
    """Return a field with random weights that ignores x, so that both sides of x = 0 have equal features."""
    random = np.random.default_rng(0)
    parameters = {
        name: (random.standard_normal(shape) / np.sqrt(shape[-1])).astype(np.float32)
        for name, shape in Architecture(WIDTH).shapes().items()
    }
    parameters["network.0.weight"][:, 0] = 0
    return dfd.Field(parameters)


def torus(face_count: int) -> dfd.Mesh:
    """Return a torus of about so many faces."""
    around = max(int(np.sqrt(face_count / 6)), 4)
    made = trimesh.creation.torus(1.0, 0.35, major_sections=max(face_count // (2 * around), 4), minor_sections=around)
    return dfd.Mesh(made.vertices, made.faces)
