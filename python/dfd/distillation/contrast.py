"""Unit rows moved apart about their mean, until they are as far from each other as rows of that kind should be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["PAIRS", "mean_distance", "restore_contrast", "unit"]

PAIRS = 2000  # whose mean distance stands for that of all
LARGEST_STRETCH = 5.0  # more would only magnify noise, on a shape that looks the same everywhere


def restore_contrast(
    rows: NDArray[np.float32], distance: float, generator: np.random.Generator, *, least: float = 1.0
) -> NDArray[np.float32]:
    """Move unit `rows` (N, D) about their mean, `least` to `LARGEST_STRETCH` times, to a mean distance of pairs."""
    one, other = generator.integers(0, len(rows), (2, PAIRS))
    mean = rows.mean(axis=0)

    def stretched(some: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
        return unit(mean + np.float32(factor) * (some - mean))

    low, high = least, LARGEST_STRETCH
    for _ in range(20):  # the distance grows with the factor
        middle = (low + high) / 2
        if mean_distance(stretched(rows[one], middle), stretched(rows[other], middle)) < distance:
            low = middle
        else:
            high = middle
    return stretched(rows, low)


def unit(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return `rows` (N, D) at unit length; one of hardly any length stays short."""
    result: NDArray[np.float32] = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.float32(1e-6))
    return result


def mean_distance(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return the mean distance between the rows (N, D) of `one` and those of `other`."""
    return float(np.linalg.norm(one - other, axis=1).mean())
