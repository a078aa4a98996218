"""Smooth normals at the vertices of a surface."""

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64, Int32

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
