"""Triangulation of polygons: fans for convex polygons, ear clipping for all other polygons.

The library mapbox-earcut clips the ears. The method: Meisters, "Polygons Have Ears", 1975.
"""

from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float64, Int64

# A corner between the edges a and b of a polygon is reflex if n · (a × b) < −2 · _REFLEX · A. Here, n is the polygon's
# unit normal, and A is its area.
_REFLEX = 1e-6


def long_faces(path: Path, sizes: Int64, lines: Int64 | None = None) -> Bool:
    """Return a mask (P,) of the faces with at least three corners, and warn if other faces are left out.

    `sizes` (P,) holds the number of corners of each face, and `lines` (P,), if given, its line index in the file. The
    warning gives the line of the first face that is left out; without `lines`, it gives the index of this face.
    """
    long: Bool = sizes >= 3
    if not long.all():
        where = f"is face {long.argmin()}" if lines is None else f"in line {lines[long.argmin()] + 1}"
        check.warn(
            f"load: `path` {path} has {np.count_nonzero(~long)} faces of fewer than three corners, the first {where}; "
            "they are left out",
            UserWarning,
        )
    return long


def check_corners(corners: Int64, count: int) -> None:
    """Raise ValueError unless all corners are vertex indices from 0 to `count` − 1."""
    wrong = corners[(corners < 0) | (corners >= count)]
    if len(wrong):
        raise ValueError(f"a face names vertex {wrong[0]}, but there are {count} vertices")


def triangulate(positions: Float64, corners: Int64, sizes: Int64) -> Int64:
    """Return the triangles (F, 3) of polygons as indices into `corners`, in the order of the polygons.

    A polygon of n corners has n − 2 triangles. `positions` (N, 3) are the vertices. `corners` (C,) holds the vertex of
    each corner, one polygon after the other. `sizes` (P,) holds the number of corners of each polygon, at least 3.
    """
    if not (sizes > 3).any():
        return np.arange(len(corners)).reshape(-1, 3)
    first = np.cumsum(sizes) - sizes
    start = np.repeat(first, sizes - 2)
    step = ranges(np.zeros(len(sizes), np.int64), sizes - 2)
    triangles = np.stack([start, start + step + 1, start + step + 2], axis=1)
    concave = _concave(positions, corners, sizes, first)
    if len(concave):
        begins = np.cumsum(sizes - 2) - (sizes - 2)
        for polygon in concave.tolist():
            size, begin = int(sizes[polygon]), int(begins[polygon])
            ears = _ears(positions[corners[first[polygon] : first[polygon] + size]])
            if ears is not None:
                triangles[begin : begin + size - 2] = ears + first[polygon]
    return triangles


def ranges(starts: Int64, lengths: Int64) -> Int64:
    """Return the concatenation of integer ranges: range i begins at `starts[i]` and has `lengths[i]` numbers."""
    before = np.cumsum(lengths) - lengths
    return np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))


def distinct_rows(rows: Int64) -> tuple[Int64, Int64]:
    """Return the sorted distinct rows (R, K) of `rows` (C, K), and the index (C,) of each row among them."""
    key = np.zeros(len(rows), np.int64)
    for column in rows.T:
        shifted = column - column.min(initial=0)
        span = int(shifted.max(initial=0)) + 1
        if (int(key.max(initial=0)) + 1) * span >= 2**62:
            key = np.unique(key, return_inverse=True)[1]
        key = key * span + shifted
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return rows[first], inverse


def _concave(positions: Float64, corners: Int64, sizes: Int64, first: Int64) -> Int64:
    """Return the indices of the polygons that have a reflex corner."""
    large = np.flatnonzero(sizes > 3)
    here = ranges(first[large], sizes[large])
    polygon = np.repeat(np.arange(len(large)), sizes[large])
    begins = np.cumsum(sizes[large]) - sizes[large]
    following = np.arange(len(here)) + 1
    following[begins + sizes[large] - 1] = begins
    points = positions[corners[here]]
    with np.errstate(over="ignore", invalid="ignore"):
        edges = points[following] - points
        turns = np.empty_like(edges)
        turns[following] = np.cross(edges, edges[following])
        around = np.cross(points - points[begins][polygon], edges)  # the sum of these is Newell's normal
        normals = np.add.reduceat(around, begins, axis=0)
        size = np.linalg.norm(normals, axis=1)  # twice the area of each polygon
        unit = normals / np.where(size > 0, size, 1)[:, None]
        back = np.einsum("nc,nc->n", turns, unit[polygon]) < -_REFLEX * size[polygon]
    return large[np.unique(polygon[back])]


def _ears(points: Float64) -> Int64 | None:
    """Return the triangles (N − 2, 3) of a polygon (N, 3); None if the polygon crosses itself or has no area."""
    import mapbox_earcut

    edges = np.roll(points, -1, axis=0) - points
    normal = np.cross(points - points[0], edges).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    flat = np.delete(points - points[0], axis, axis=1)
    ears = mapbox_earcut.triangulate_float64(np.ascontiguousarray(flat), np.array([len(points)], np.uint32))
    triangles: Int64 = ears.reshape(-1, 3).astype(np.int64)
    if len(triangles) != len(points) - 2:
        return None
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    inside_out = np.cross(b - a, c - a) @ normal < 0
    triangles[inside_out] = triangles[inside_out][:, [0, 2, 1]]
    return triangles
