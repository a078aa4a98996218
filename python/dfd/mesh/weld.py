"""Welding: rows that hold the same position become one vertex."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64, Int32, Int64


def weld(positions: Float64) -> tuple[Int64, Int32]:
    """Return the first row (V,) of each distinct position in `positions` (N, 3), and the vertex (N,) of each row.

    First rows are ascending, so distinct positions keep their order. Positions must be finite. Two positions are equal
    if their bits are equal, with -0.0 equal to 0.0; there is no tolerance.
    """
    rows = np.ascontiguousarray(positions + 0.0)  # turns -0.0 into 0.0
    key = np.zeros(len(rows), np.uint64)  # a hash of the bits of each row
    for column in rows.view(np.uint64).T:
        key ^= column
        key *= np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    if np.diff(np.sort(key)).all():  # all positions are distinct, as on most meshes; sorting the keys is cheap
        return np.arange(len(rows)), np.arange(len(rows), dtype=np.int32)
    first, vertex = by_appearance(key)
    if (rows[first[vertex]] != rows).any():  # two positions have one hash
        return by_appearance(rows)
    return first, vertex


def by_appearance(values: NDArray[Any]) -> tuple[Int64, Int32]:
    """Return the first place (V,) of each distinct value or row of `values`, ascending, and the number of each one's.

    The numbers (N,) count distinct values in the order in which they first appear.
    """
    group = np.unique(values, axis=0, return_inverse=True)[1].ravel()
    first = np.full(group.max(initial=-1) + 1, len(values))
    np.minimum.at(first, group, np.arange(len(values)))
    order = np.argsort(first)
    rank = np.empty(len(first), np.int32)
    rank[order] = np.arange(len(first), dtype=np.int32)
    return first[order], rank[group]
