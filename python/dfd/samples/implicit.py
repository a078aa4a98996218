"""Solid shapes as signed distances: rounded primitives, labelled by part, and their smooth union."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dfd.common.linear_algebra import Float64, Int32

Points = Float64  # (N, 3)
Distance = Callable[[Points], Float64]  # (N, 3) -> (N,), negative inside
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Piece:
    """One primitive of a shape, given for x >= 0 and mirrored at the plane x = 0 by `Shape`."""

    part: str  # the kind of part it belongs to
    distance: Distance
    instance: int = 0  # which one of its kind
    paired: bool = False  # off the plane: its mirror image is the next instance
    blend: float = 0.02  # radius of the fillet to the preceding primitives


class Shape:
    """The smooth union of primitives, symmetric in x."""

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)
        self.parts = tuple(dict.fromkeys(piece.part for piece in pieces))

    def distance(self, points: Points) -> Float64:
        """Return the approximate signed distance (N,) of `points` to the surface, the same on both sides of x = 0."""
        folded = _folded(points)
        result = self.pieces[0].distance(folded)
        for piece in self.pieces[1:]:
            result = _smooth_minimum(result, piece.distance(folded), piece.blend)
        return result

    def project(self, points: Points, step: float, times: int) -> Points:
        """Return `points` moved towards the surface `times` times, by at most `step` each; x = 0 stays x = 0."""
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
        """Return for each point the index in `parts` and the instance of the nearest primitive."""
        folded = _folded(points)
        nearest = np.argmin([piece.distance(folded) for piece in self.pieces], axis=0)
        part = np.array([self.parts.index(piece.part) for piece in self.pieces], np.int32)
        instance = np.array([piece.instance for piece in self.pieces], np.int32)
        paired = np.array([piece.paired for piece in self.pieces])
        return part[nearest], instance[nearest] + (paired[nearest] & (points[:, 0] < 0)).astype(np.int32)


def capsule(start: Triple, end: Triple, start_radius: float, end_radius: float | None = None) -> Distance:
    """A rod with round ends whose radius changes evenly from one end to the other."""
    origin, along = np.array(start), np.subtract(end, start)
    last = start_radius if end_radius is None else end_radius

    def distance(points: Points) -> Float64:
        offset = points - origin
        fraction = (offset @ along / (along @ along)).clip(0, 1)
        radius: Float64 = start_radius + (last - start_radius) * fraction
        return _length(offset - fraction[:, None] * along) - radius

    return distance


def chain(points: Sequence[Triple], radii: Sequence[float]) -> list[Distance]:
    """Capsules from each point to the next."""
    return [capsule(points[i], points[i + 1], radii[i], radii[i + 1]) for i in range(len(points) - 1)]


def ellipsoid(center: Triple, radii: Triple, pitch: float = 0.0, roll: float = 0.0) -> Distance:
    """An ellipsoid turned by `pitch` about x (positive: front down), then by `roll` about z; radians."""
    origin, semi, turn = np.array(center), np.array(radii), _turn(pitch, roll)

    def distance(points: Points) -> Float64:
        scaled = ((points - origin) @ turn) / semi
        inner = _length(scaled)
        return inner * (inner - 1) / np.maximum(_length(scaled / semi), 1e-9)

    return distance


def rounded_box(
    center: Triple, half: Triple, radius: float, *, pitch: float = 0.0, roll: float = 0.0, bend: float = 0.0
) -> Distance:
    """A box of half sides `half` with edges rounded by `radius`; `bend` bows it along x: z = bend · x²."""
    origin, inner, turn = np.array(center), np.subtract(half, radius), _turn(pitch, roll)

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
    folded = points.copy()
    folded[:, 0] = np.abs(folded[:, 0])
    return folded


def _smooth_minimum(a: Float64, b: Float64, radius: float) -> Float64:
    """The smaller of two distances, rounded where they differ by less than `radius` (quadratic fillet)."""
    overlap = np.maximum(radius - np.abs(a - b), 0) / radius
    smaller: Float64 = np.minimum(a, b)
    return smaller - overlap**2 * (radius / 4)


def _length(vectors: Points) -> Float64:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def _turn(pitch: float, roll: float) -> Float64:
    """Return the matrix (3, 3) whose columns are the turned axes."""
    cosine, sine = np.cos(pitch), np.sin(pitch)
    about_x = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    cosine, sine = np.cos(roll), np.sin(roll)
    about_z = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return about_z @ about_x
