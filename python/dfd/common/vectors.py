"""Vectors of length 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["unit"]


def unit(rows: NDArray[np.floating], *, least: float = 0.0) -> NDArray[np.float64]:
    """The rows (N, D) at length 1; those no longer than `least`, whose direction says nothing, become 0."""
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    result: NDArray[np.float64] = np.divide(
        rows, lengths, out=np.zeros(np.shape(rows)), where=lengths > least, casting="same_kind"
    )
    return result
