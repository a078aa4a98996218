"""Points spread evenly over the faces of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["points_on_faces", "spread_in_triangle"]


def points_on_faces(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Spread points over faces, `counts` (F,) of them on each.

    Returns
    -------
    face
        (N,) the face of each point, ascending.
    barycentric
        (N, 3) its weights of the face's corners; the first point of a face is its center.
    """
    ends = np.cumsum(counts)
    face = np.repeat(np.arange(len(counts)), counts)
    index = np.arange(len(face)) - (ends - counts)[face]
    return face, spread_in_triangle(index)


def spread_in_triangle(index: NDArray[np.int64]) -> NDArray[np.float32]:
    """Barycentric coordinates (N, 3) that fill a triangle evenly as `index` (N,) counts up from its center, 0.

    Source: the additive sequence of Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
    """
    step = np.array([0.7548776662466927, 0.5698402909980532])  # 1/g and 1/g², g³ = g + 1
    across = (1 / 3 + index[:, None] * step) % 1
    across = np.where(across.sum(axis=1, keepdims=True) > 1, 1 - across, across)
    return np.column_stack([1 - across.sum(axis=1), across]).astype(np.float32)
