"""A coarse level of a large mesh, drawn while the full one is too slow: vertex clustering (Rossignac 1993).

The vertices in each cube of a regular grid are merged into one of them; faces that then degenerate are dropped. Because
vertices are selected, not created, the coarse level shares weights, materials and indices with the full mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64, Int32

MOST_FACES = 16_000  # about as many as a CPU poses and draws 60 times a second
FINEST_GRID = 256  # cubes along the longest side
FACES_PER_CUBE = 2.0  # closed surfaces have two faces per vertex
SAMPLES = 200_000  # vertices used to count the cubes that a grid fills

Ints = Int32
Floats = Float32


@dataclass(frozen=True)
class CoarseLevel:
    """Faces (K, 3) over the vertices of the mesh, and (K,) the face of the mesh that each came from."""

    faces: Ints
    source_faces: Ints

    def sorted_by(self, keys: NDArray[np.integer]) -> CoarseLevel:
        """The same faces, sorted by the `keys` (F,) of their source faces."""
        order = np.argsort(keys[self.source_faces], kind="stable")
        return CoarseLevel(self.faces[order], self.source_faces[order])


def coarse_level(vertices: Float64, faces: Ints, *, max_faces: int = MOST_FACES) -> CoarseLevel | None:
    """About `most` faces at most of a shape with vertices (V, 3) and faces (F, 3); None if that saves less than half.

    Every cube that contains a face of nonzero area keeps one, so that thin and small parts stay visible.
    """
    if len(faces) < 2 * max_faces:
        return None
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    numbers = np.flatnonzero(used).astype(np.int32)
    points = _within_unit_cube(vertices[numbers])
    clusters = _Clusters(points, _finest_grid(points, max_faces / FACES_PER_CUBE))
    local = np.cumsum(used, dtype=np.int32) - np.int32(1)
    corners = faces if used.all() else local[faces]
    found, source_faces = _clustered(clusters, points, corners)
    if len(found) == 0 or 2 * len(found) > len(faces):
        return None
    return CoarseLevel(numbers[found], source_faces)


def _within_unit_cube(points: Float64) -> Floats:
    low = points.min(axis=0)
    with np.errstate(over="ignore"):
        size = float((points.max(axis=0) / 2 - low / 2).max()) * 2
    if not 0 < size < np.inf:
        size = 1.0 if size == 0 else float(np.finfo(np.float64).max)
    return (points / size - low / size).astype(np.float32)


def _cubes(points: Floats, grid: int) -> Ints:
    """(N,) the number of each point's cube, of `grid` along a side."""
    x, y, z = np.minimum((points * np.float32(grid)).astype(np.int32), grid - 1).T
    return (x * grid + y) * grid + z


def _finest_grid(points: Floats, max_cubes: float) -> int:
    """The finest grid of which the points fill at most `max_cubes` cubes."""
    some = points[:: max(len(points) // SAMPLES, 1)]
    low, high = 1, FINEST_GRID + 1
    while high - low > 1:
        grid = (low + high) // 2
        filled = np.zeros(grid**3, bool)
        filled[_cubes(some, grid)] = True
        low, high = (grid, high) if np.count_nonzero(filled) <= max_cubes else (low, grid)
    return low


class _Clusters:
    """Points by cube: `of` (N,) the cluster; `middle` (C,) nearest to the mean, `rim` (C,) farthest from `middle`."""

    def __init__(self, points: Floats, grid: int) -> None:
        cubes = _cubes(points, grid)
        filled = np.zeros(grid**3, bool)
        filled[cubes] = True
        self.count = int(np.count_nonzero(filled))
        self.of: Ints = (np.cumsum(filled, dtype=np.int32) - np.int32(1))[cubes]
        sizes = np.bincount(self.of, minlength=self.count)
        sums = np.stack([np.bincount(self.of, points[:, k], self.count) for k in range(3)], axis=1)
        means = (sums / sizes[:, None]).astype(np.float32)
        self.middle = self._first_minimum(_squared(points - means[self.of]))
        self.rim = self._first_minimum(-_squared(points - points[self.middle][self.of]))

    def _first_minimum(self, values: Floats) -> Ints:
        """(C,) per cluster, the first point with the minimal value."""
        least = np.full(self.count, np.inf, np.float32)
        np.minimum.at(least, self.of, values)
        hits = np.flatnonzero(values == least[self.of])[::-1]
        first = np.zeros(self.count, np.int32)
        first[self.of[hits]] = hits
        return first


def _clustered(clusters: _Clusters, points: Floats, corners: Ints) -> tuple[Ints, Ints]:
    """Faces over the middles of clusters, and from which of `corners` (F, 3) each came."""
    ends = clusters.of[corners]
    apart = [ends[:, k] != ends[:, (k + 1) % 3] for k in range(3)]
    spans = apart[0] & apart[1] & apart[2]
    splits = apart[0] | apart[1] | apart[2]
    found, came_from = [clusters.middle[ends[spans]]], [np.flatnonzero(spans)]

    # A part thinner than a cube has faces between at most two clusters: keep ribbons of its width that join them.
    lost = _unused(clusters.count, ends[spans])
    joins = splits & ~spans & _any_marked(lost, ends)
    here, there = _pairs(ends[joins])
    here, there = np.where(lost[here], here, there), np.where(lost[here], there, here)
    found.append(np.stack([clusters.middle[here], clusters.rim[here], clusters.middle[there]], axis=1))
    came_from.append(np.flatnonzero(joins))

    # A part inside a single cube keeps its largest face.
    areas = _areas(points, found[1])
    found[1], came_from[1] = found[1][areas > 0], came_from[1][areas > 0]
    lost = lost & _unused(clusters.count, clusters.of[found[1]])
    within = np.flatnonzero(_any_marked(lost, ends))
    largest = _largest(_areas(points, corners[within]), ends[within], lost)
    found.append(corners[within[largest]])
    came_from.append(within[largest])

    faces, origins = np.concatenate(found), np.concatenate(came_from)
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    first = np.sort(first)
    first = first[_areas(points, faces[first]) > 0]
    return faces[first], origins[first].astype(np.int32)


def _squared(offsets: Floats) -> Floats:
    x, y, z = offsets.T
    return x * x + y * y + z * z


def _any_marked(marked: Bool, ends: Ints) -> Bool:
    """(N,) whether one of (N, 3) is marked."""
    return marked[ends[:, 0]] | marked[ends[:, 1]] | marked[ends[:, 2]]


def _unused(count: int, ends: Ints) -> Bool:
    """(count,) which clusters are in none of `ends`."""
    lost = np.ones(count, bool)
    lost[ends] = False
    return lost


def _pairs(ends: Ints) -> tuple[Ints, Ints]:
    """The two clusters of each of (N, 3), of which two are the same."""
    return ends.min(axis=1), ends.max(axis=1)


def _areas(points: Floats, faces: Ints) -> Floats:
    """(N,) four times the squared area of each face."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    return _squared(np.cross(b - a, c - a))


def _largest(areas: Floats, ends: Ints, wanted: Bool) -> Ints:
    """Of each wanted cluster the largest face with a corner in it; which of (N,) they are."""
    order = np.argsort(-areas, kind="stable")
    order = order[areas[order] > 0]
    at = ends[order].reshape(-1)
    clusters, first = np.unique(at, return_index=True)
    return np.unique(order[first[wanted[clusters]] // 3])
