"""Normals of a surface where nobody gave any: smooth ones, at its vertices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["smooth_normals"]

_FACES_AT_ONCE = 1 << 20  # to bound memory


def smooth_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return unit normals (V, 3), each the sum of its faces' normals weighted by area; zero where they cancel out."""
    span = float((vertices.max(axis=0) - vertices.min(axis=0)).max()) or 1.0
    summed = np.zeros((3, len(vertices)))
    weight = np.zeros(len(vertices))
    for start in range(0, len(faces), _FACES_AT_ONCE):
        some = faces[start : start + _FACES_AT_ONCE]
        first, second, third = (vertices[some[:, corner]] for corner in range(3))
        # Edges of at most unit length: neither a huge shape's products overflow nor a tiny one's vanish.
        crossed = np.cross((second - first) / span, (third - first) / span)
        corners = some.ravel()
        for axis in range(3):
            summed[axis] += np.bincount(corners, np.repeat(crossed[:, axis], 3), minlength=len(vertices))
        weight += np.bincount(corners, np.repeat(np.linalg.norm(crossed, axis=1), 3), minlength=len(vertices))
    length = np.sqrt(np.einsum("cv,cv->v", summed, summed))
    # Of normals that cancel out, as on a sheet that has both its sides as faces, rounding leaves a direction at random.
    known = length > 1e-9 * weight
    return np.where(known, summed / np.where(known, length, 1), 0).T.astype(np.float32, order="C")
