"""Welding: rows of an array with equal positions become one vertex."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64, Int32, Int64


def weld(positions: Float64) -> tuple[Int64, Int32]:
    """Make each distinct position a vertex. Return each vertex's first row (V,), and each row's vertex (N,).

    `positions` (N, 3) must be finite. Vertices have the order of their first rows. Positions with equal bits are equal,
    and -0.0 equals 0.0. There is no tolerance.
    """
    rows = np.ascontiguousarray(positions + 0.0)  # turns -0.0 into 0.0
    key = np.zeros(len(rows), np.uint64)  # a hash of the bits of each row
    for column in rows.view(np.uint64).T:
        key ^= column
        key *= np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    if np.diff(np.sort(key)).all():  # all positions are distinct, as on most meshes
        return np.arange(len(rows)), np.arange(len(rows), dtype=np.int32)
    first, vertex = first_occurrences(key)
    if (rows[first[vertex]] != rows).any():  # two different positions have the same hash
        return first_occurrences(rows)
    return first, vertex


def first_occurrences(values: NDArray[Any]) -> tuple[Int64, Int32]:
    """Return the index (V,) at which each distinct value first occurs, ascending, and the group (N,) of each value.

    `values` are N numbers or N rows. Equal values form a group. Groups are numbered in the order of first occurrence.
    """
    group = np.unique(values, axis=0, return_inverse=True)[1].ravel()
    first = np.full(group.max(initial=-1) + 1, len(values))
    np.minimum.at(first, group, np.arange(len(values)))
    order = np.argsort(first)
    rank = np.empty(len(first), np.int32)
    rank[order] = np.arange(len(first), dtype=np.int32)
    return first[order], rank[group]
