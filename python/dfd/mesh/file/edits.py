"""Replacement of bytes in a file, conversion of numbers to text, and rounding to 32-bit floats."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64, Int64

SAME = 1e-6  # largest change of a unit normal's components that counts as rounding
COARSE = 1e-5  # largest accepted rounding error of 32-bit floats, as a fraction of the bounding box's diagonal


class Edits:
    """Replacements of bytes in a file, collected and then applied together."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._spans: list[Int64] = []
        self._new: list[bytes] = []

    def replace(self, spans: Int64 | Sequence[tuple[int, int]], new: Iterable[bytes]) -> None:
        """Replace byte ranges by `new`. `spans` (L, 2) holds the first byte and the end (exclusive) of each range."""
        self._spans.append(np.asarray(spans, np.int64).reshape(-1, 2))
        self._new += new

    def result(self) -> bytes:
        """Return the bytes with all replacements."""
        spans = np.concatenate([np.zeros((0, 2), np.int64), *self._spans])
        order = np.lexsort(spans.T[::-1])
        pieces, done = [], 0
        for index, (start, end) in zip(order.tolist(), spans[order].tolist(), strict=True):
            pieces += [self._data[done:start], self._new[index]]
            done = end
        return b"".join([*pieces, self._data[done:]])


def rows_as_text(values: NDArray[np.floating]) -> list[bytes]:
    """Return each row of `values` (L, K) as text. Each number has the shortest form that reads back exactly."""
    template = b" ".join([b"%a"] * values.shape[1])
    return [template % tuple(row) for row in values.tolist()]


def far_origin(vertices: Float64) -> Float64 | None:
    """Return the center (3,) of vertices (V, 3) if 32-bit floats are too coarse for them, else None.

    The center is rounded to 32-bit floats.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if rounding(vertices).max() <= COARSE * np.linalg.norm(high - low):
        return None
    return (low / 2 + high / 2).astype(np.float32).astype(np.float64)


def rounding(vertices: Float64) -> Float64:
    """Return the distances (V,) by which rounding to 32-bit floats moves vertices (V, 3)."""
    with np.errstate(over="ignore"):
        return np.linalg.norm(vertices - vertices.astype(np.float32), axis=1)
