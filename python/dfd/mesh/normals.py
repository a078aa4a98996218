"""Normals of faces and vertices, and their turns when a surface moves."""

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64, Int32, Int64, group_sums, nearest_rotations, unit

_FACES_AT_ONCE = 1 << 20  # largest number of faces that are processed together, which limits the memory


def face_normals(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Float64:
    """Return the normals (F, 3) of `faces` (F, 3); the length of each normal is twice the area of its face."""
    first, second, third = vertices[faces].astype(np.float64, copy=False).transpose(1, 0, 2)
    return np.cross(second - first, third - first)


def smooth_normals(vertices: Float64, faces: Int32) -> Float32:
    """Return unit normals of vertices, (V, 3): area-weighted means of face normals, or 0 if the face normals cancel."""
    span = float((vertices.max(axis=0) - vertices.min(axis=0)).max()) or 1.0
    # The shape is scaled to width 1, so that products of coordinates neither overflow nor become 0.
    x, y, z = np.ascontiguousarray((vertices / span).T)
    summed = np.zeros((len(vertices), 4))  # in each row, the sum of face normals (3) and the sum of their lengths (1)
    for start in range(0, len(faces), _FACES_AT_ONCE):
        some = faces[start : start + _FACES_AT_ONCE]
        first, second, third = np.ascontiguousarray(some.T)
        ax, ay, az = (axis[second] - axis[first] for axis in (x, y, z))
        bx, by, bz = (axis[third] - axis[first] for axis in (x, y, z))
        of_face = np.empty((len(some), 4))
        of_face[:, 0], of_face[:, 1], of_face[:, 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        of_face[:, 3] = np.sqrt(np.einsum("fc,fc->f", of_face[:, :3], of_face[:, :3]))
        for column in range(4):
            summed[:, column] += np.bincount(some.ravel(), np.repeat(of_face[:, column], 3), len(vertices))
    weight = summed[:, 3]
    summed = summed[:, :3].T
    length = np.sqrt(np.einsum("cv,cv->v", summed, summed))
    # The normals of two faces with opposite winding cancel. Rounding would then leave a random direction.
    known = length > 1e-9 * weight
    return np.where(known, summed / np.where(known, length, 1), 0).T.astype(np.float32, order="C")


def turned_normals(normals: Float64, vertices: Float64, before: Float64, faces: Int32, group: Int64) -> Float64:
    """Return unit normals (G, 3) after the surface around them moves from `before` (V, 3) to `vertices` (V, 3).

    `group` (F, 3) is the index of each face corner's normal; corners with the index G have none. A normal turns by the
    rotation nearest to the mean deformation gradient of its faces, and then as the mean normal of its faces does.
    """
    count = len(normals)
    faces, group, old, new = _with_area(vertices, before, faces, group)
    side = np.zeros((count + 1, 3))
    side[group[::-1].T] = old[::-1]  # the normal of the first face; on two-sided sheets, others are opposite
    gradient = _gradients(vertices, before, faces, old, new)
    sums = np.zeros((count + 1, 15))
    for corner in group.T:
        sign = np.where(np.einsum("fi,fi->f", side[corner], old) < 0, -1.0, 1.0)[:, None]
        sums += group_sums(corner, np.hstack([gradient.reshape(-1, 9), sign * old, sign * new]), count + 1)
    turn = nearest_rotations(sums[:count, :9].reshape(-1, 3, 3))
    turned = np.einsum("gij,gj->gi", turn, normals)
    start, end = unit(np.einsum("gij,gj->gi", turn, sums[:count, 9:12])), unit(sums[:count, 12:])
    cosine = np.einsum("gi,gi->g", start, end)[:, None]
    middle = start + end
    along = np.einsum("gi,gi->g", middle, turned)[:, None] / np.where(cosine > -0.99, 1 + cosine, 1)
    closer = turned - middle * along + 2 * end * np.einsum("gi,gi->g", start, turned)[:, None]
    known = (cosine > -0.99) & start.any(axis=1, keepdims=True) & end.any(axis=1, keepdims=True)
    return np.where(known, closer, turned)


def mean_gradients(vertices: Float64, before: Float64, faces: Int32, group: Int64, count: int) -> Float64:
    """Return the area-weighted mean deformation gradients (`count`, 3, 3) of surfaces that move as in `turned_normals`.

    Groups without a face that has an area get the identity.
    """
    faces, group, old, new = _with_area(vertices, before, faces, group)
    gradient = _gradients(vertices, before, faces, old, new).reshape(-1, 9)
    area = np.linalg.norm(old, axis=1, keepdims=True)
    sums = np.zeros((count + 1, 10))
    for corner in group.T:
        sums += group_sums(corner, np.hstack([gradient, area]), count + 1)
    total = sums[:count, 9:]
    mean = np.where(total > 0, sums[:count, :9] / np.where(total > 0, total, 1), np.eye(3).ravel())
    return mean.reshape(-1, 3, 3)


def _with_area(vertices: Float64, before: Float64, faces: Int32, group: Int64) -> tuple[Int32, Int64, Float64, Float64]:
    """Return the faces that have an area before and after, their groups, and their normals (F, 3) before and after."""
    old, new = face_normals(before, faces), face_normals(vertices, faces)
    kept = old.any(axis=1) & new.any(axis=1)
    return faces[kept], group[kept], old[kept], new[kept]


def _gradients(vertices: Float64, before: Float64, faces: Int32, old: Float64, new: Float64) -> Float64:
    """Return the deformation gradient (F, 3, 3) of each face, times twice its area.

    The gradient maps the face's edges to their new places, and its unit normal to the new one. `old` and `new` (F, 3)
    are the normals of faces, as in `face_normals`.
    """
    first, second, third = before[faces].transpose(1, 0, 2)
    to_first, to_second, to_third = vertices[faces].transpose(1, 0, 2)
    a, b, up = second - first, third - first, old / np.linalg.norm(old, axis=1, keepdims=True)
    gradient = np.einsum("fi,fj->fij", to_second - to_first, np.cross(b, up))
    gradient += np.einsum("fi,fj->fij", to_third - to_first, np.cross(up, a))
    gradient += np.einsum("fi,fj->fij", unit(new), old)
    return gradient
