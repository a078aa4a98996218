"""Make input of any size, with features similar to those of a field, and make the calls that benchmarks time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import trimesh
from numpy.typing import NDArray

import dfd
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.field.architecture import Architecture

WIDTH = 384  # number of dimensions of a feature, the same as in a small vision transformer
VERTICES = 500_000  # default number of vertices
MOTIONS = ("pose", "mirrored pose", "drag")

Call = Callable[[], object]


@dataclass(frozen=True)
class MadeInput:
    """A shape with features and transforms. It has no faces because bind and pose do not need them."""

    vertices: Float32  # (V, 3)
    compact: dfd.CompactFeatures  # features of the vertices
    transforms: Float64  # (100, 3, 4)

    def features(self, count: int | None = None) -> Float32:
        """Return the features (count, 384), of unit length, of the first `count` vertices, or of all vertices."""
        return field(self.vertices[:count])

    def handles(self, count: int) -> Int64:
        """Return `count` distinct vertices, spread over the shape."""
        return np.linspace(0, len(self.vertices) - 1, count).astype(np.int64)

    def binding(self, count: int, *, constrained: bool = False) -> Call:
        """Return a call that binds `count` handles to compact features, and writes the weights into an existing array.

        `constrained` adds three fixed points and a locality of 2.
        """
        out = np.empty((len(self.vertices), count), np.float32)
        bind = partial(dfd.bind, self.compact, self.handles(count), out=out)
        if not constrained:
            return bind
        distances = np.random.default_rng(0).random((count, len(self.vertices)), dtype=np.float32)
        return partial(bind, fixed=[1, 2, 3], geodesic=distances, locality=2.0)

    def pose(self, motion: str, count: int, dtype: str = "float32") -> Call:
        """Return a call that poses with `count` handles. `motion` is one of `MOTIONS`; a drag moves only one handle."""
        handles, transforms = self.handles(count), self.transforms[:count]
        vertices, weights = self.vertices.astype(dtype), dfd.bind(self.compact, handles) / count
        out = np.empty_like(vertices)
        if motion == "drag":
            return partial(dfd.Drag(vertices, weights, transforms, [0]).pose, transforms[:1], out=out)
        pose = partial(dfd.pose, vertices, weights, transforms, out=out)
        if motion == "pose":
            return pose
        plane = dfd.SymmetryPlane((1.0, 0.0, 0.0), 0.0, band=0.01)
        return partial(pose, symmetry=plane, handles=vertices[handles])


def field(points: NDArray[np.floating]) -> Float32:
    """Return features (N, 384), of unit length, at `points` (N, 3). They vary smoothly, as distilled features do."""
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


def make_input(vertex_count: int = VERTICES) -> MadeInput:
    """Return input with `vertex_count` random vertices."""
    random = np.random.default_rng(1)
    vertices = random.standard_normal((vertex_count, 3), dtype=np.float32)
    transforms = np.eye(3, 4) + 0.05 * random.standard_normal((100, 3, 4))
    return MadeInput(vertices, dfd.compact(field, vertices), transforms)


def mirrored_field() -> dfd.Field:
    """Return a random field that does not depend on x, so that both sides of x = 0 have equal features."""
    random = np.random.default_rng(0)
    parameters = {
        name: (random.standard_normal(shape) / np.sqrt(shape[-1])).astype(np.float32)
        for name, shape in Architecture(WIDTH).shapes().items()
    }
    parameters["network.0.weight"][:, 0] = 0
    return dfd.Field(parameters)


def torus(face_count: int) -> dfd.Mesh:
    """Return a torus of about `face_count` faces."""
    around = max(int(np.sqrt(face_count / 6)), 4)
    made = trimesh.creation.torus(1.0, 0.35, major_sections=max(face_count // (2 * around), 4), minor_sections=around)
    return dfd.Mesh(made.vertices, made.faces)
