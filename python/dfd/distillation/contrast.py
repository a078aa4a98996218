"""Unit rows moved apart about their mean, until they are as far from each other as rows of that kind should be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["PAIRS", "mean_distance", "restore_contrast", "unit"]

PAIRS = 2000  # whose mean distance stands for that of all
_ROWS_AT_ONCE = 512  # whose squares stay in a core's cache until they are summed
LARGEST_STRETCH = 5.0  # more would only magnify noise, on a shape that looks the same everywhere


def restore_contrast(
    rows: NDArray[np.float32], distance: float, generator: np.random.Generator, *, least: float = 1.0
) -> NDArray[np.float32]:
    """Move unit `rows` (N, D) about their mean, `least` to `LARGEST_STRETCH` times, to a mean distance of pairs."""
    one, other = generator.integers(0, len(rows), (2, PAIRS))
    mean = rows.mean(axis=0)

    from_mean = rows - mean
    pairs = from_mean[one], from_mean[other]

    def stretched(some: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
        return unit(mean + np.float32(factor) * some)

    low, high = least, LARGEST_STRETCH
    for _ in range(20):  # the distance grows with the factor
        middle = (low + high) / 2
        if mean_distance(*(stretched(some, middle) for some in pairs)) < distance:
            low = middle
        else:
            high = middle
    return stretched(from_mean, low)


def unit(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return `rows` (N, D) at unit length; one of hardly any length stays short."""
    result = np.empty(rows.shape, np.float32)
    for begin in range(0, len(rows), _ROWS_AT_ONCE):
        some = rows[begin : begin + _ROWS_AT_ONCE]
        length = np.maximum(np.linalg.norm(some, axis=1, keepdims=True), np.float32(1e-6))
        np.divide(some, length, out=result[begin : begin + _ROWS_AT_ONCE])
    return result


def mean_distance(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return the mean distance between the rows (N, D) of `one` and those of `other`."""
    return float(np.linalg.norm(one - other, axis=1).mean())
