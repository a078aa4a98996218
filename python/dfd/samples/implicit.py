"""Define solid shapes by signed distance functions: rounded primitives with part labels, and their smooth union."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dfd.common.linear_algebra import Float64, Int32

Points = Float64  # (N, 3)
Distance = Callable[[Points], Float64]  # maps points (N, 3) to signed distances (N,), negative inside
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Primitive:
    """A primitive of a shape, defined for x ≥ 0; `Shape` mirrors it in the plane x = 0."""

    part: str  # the kind of part
    distance: Distance
    instance: int = 0  # index of the part among the parts of its kind
    paired: bool = False  # whether the mirror image is another part, with the index `instance` + 1
    blend: float = 0.02  # width of the smooth transition to the union of the primitives before it in the shape


class Shape:
    """The smooth union of primitives, symmetric in the plane x = 0."""

    def __init__(self, primitives: Sequence[Primitive]) -> None:
        self.primitives = tuple(primitives)
        self.parts = tuple(dict.fromkeys(primitive.part for primitive in primitives))

    def distance(self, points: Points) -> Float64:
        """Return the approximate signed distance (N,) of `points` (N, 3) from the surface, negative inside."""
        folded = _folded(points)
        result = self.primitives[0].distance(folded)
        for primitive in self.primitives[1:]:
            result = _smooth_minimum(result, primitive.distance(folded), primitive.blend)
        return result

    def project(self, points: Points, step: float, times: int) -> Points:
        """Move copies of `points` (N, 3) to the surface in `times` steps of at most `step`. If x is 0, x stays 0."""
        moved = points.copy()
        for _ in range(times):
            distance = self.distance(moved)
            nudged = [self.distance(moved + nudge) for nudge in 1e-3 * step * np.eye(3)]
            gradient = (np.stack(nudged, axis=1) - distance[:, None]) / (1e-3 * step)
            length = np.maximum(_length(gradient), 1e-6)
            moved -= gradient * ((distance / length).clip(-step, step) / length)[:, None]
            moved[points[:, 0] == 0, 0] = 0.0
        return moved

    def labels(self, points: Points) -> tuple[Int32, Int32]:
        """Return the part (N,), an index into `parts`, and the instance (N,) of the primitive nearest to each point."""
        folded = _folded(points)
        nearest = np.argmin([primitive.distance(folded) for primitive in self.primitives], axis=0)
        part = np.array([self.parts.index(primitive.part) for primitive in self.primitives], np.int32)
        instance = np.array([primitive.instance for primitive in self.primitives], np.int32)
        paired = np.array([primitive.paired for primitive in self.primitives])
        return part[nearest], instance[nearest] + (paired[nearest] & (points[:, 0] < 0)).astype(np.int32)


def capsule(start: Triple, end: Triple, start_radius: float, end_radius: float | None = None) -> Distance:
    """Return the distance function of a rod with round ends, whose radius changes linearly along it."""
    origin, along = np.array(start), np.subtract(end, start)
    last = start_radius if end_radius is None else end_radius

    def distance(points: Points) -> Float64:
        offset = points - origin
        fraction = (offset @ along / (along @ along)).clip(0, 1)
        radius: Float64 = start_radius + (last - start_radius) * fraction
        return _length(offset - fraction[:, None] * along) - radius

    return distance


def chain(points: Sequence[Triple], radii: Sequence[float]) -> list[Distance]:
    """Return the distance functions of capsules between consecutive `points`; `radii` has a radius for each point."""
    return [capsule(points[i], points[i + 1], radii[i], radii[i + 1]) for i in range(len(points) - 1)]


def ellipsoid(center: Triple, radii: Triple, *, roll: float = 0.0) -> Distance:
    """Return the approximate distance function of an ellipsoid that is rotated about z by `roll` radians."""
    origin, semi, turn = np.array(center), np.array(radii), _rotation(0, 1, roll)

    def distance(points: Points) -> Float64:
        scaled = ((points - origin) @ turn) / semi
        inner = _length(scaled)
        return inner * (inner - 1) / np.maximum(_length(scaled / semi), 1e-9)

    return distance


def rounded_box(center: Triple, half: Triple, radius: float, *, pitch: float = 0.0, bend: float = 0.0) -> Distance:
    """Return the approximate distance function of a box with side lengths 2 · `half` and edges rounded by `radius`.

    The box is bent: z increases by `bend` · x². It is then rotated about x by `pitch` radians (positive: front down).
    """
    origin, inner, turn = np.array(center), np.subtract(half, radius), _rotation(1, 2, pitch)

    def distance(points: Points) -> Float64:
        local = (points - origin) @ turn
        slope = 0.0
        if bend:
            local[:, 2] -= bend * local[:, 0] ** 2
            slope = 2 * bend * inner[0]
        outside = np.abs(local) - inner
        gap = _length(np.maximum(outside, 0)) + np.minimum(outside.max(axis=1), 0)
        return (gap - radius) / np.hypot(1, slope)

    return distance


def _folded(points: Points) -> Points:
    """Return `points` with x replaced by |x|."""
    folded = points.copy()
    folded[:, 0] = np.abs(folded[:, 0])
    return folded


def _smooth_minimum(a: Float64, b: Float64, radius: float) -> Float64:
    """Return the smaller of two distances (N,), reduced smoothly if they differ by less than `radius`."""
    overlap = np.maximum(radius - np.abs(a - b), 0) / radius
    smaller: Float64 = np.minimum(a, b)
    return smaller - overlap**2 * (radius / 4)


def _length(vectors: Points) -> Float64:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def _rotation(first: int, second: int, angle: float) -> Float64:
    """Return the matrix (3, 3) that rotates axis `first` towards axis `second` by `angle` radians."""
    matrix = np.eye(3)
    matrix[[first, second], [first, second]] = np.cos(angle)
    matrix[second, first] = np.sin(angle)
    matrix[first, second] = -np.sin(angle)
    return matrix
