"""Welding: rows that hold the same position become one vertex."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float64, Int32, Int64


def weld(positions: Float64) -> tuple[Int64, Int32]:
    """Return the first row (V,) of each distinct position in `positions` (N, 3), and the vertex (N,) of each row.

    First rows are ascending, so distinct positions keep their order. Positions must be finite. Two positions are equal
    if their bits are equal, with -0.0 equal to 0.0; there is no tolerance.
    """
    rows = np.ascontiguousarray(positions + 0.0)  # turns -0.0 into 0.0
    key = _hash(rows)
    if _differs(np.sort(key)).all():  # all positions are distinct, as on most meshes; sorting the keys is cheap
        return np.arange(len(rows)), np.arange(len(rows), dtype=np.int32)
    order, starts = _groups(rows, key)
    first = np.minimum.reduceat(order, starts) if len(order) else order
    by_first = np.argsort(first, kind="stable")
    rank = np.empty(len(first), np.int32)
    rank[by_first] = np.arange(len(first), dtype=np.int32)
    vertex = np.empty(len(rows), np.int32)
    vertex[order] = np.repeat(rank, np.diff(starts, append=len(rows)))
    return first[by_first], vertex


def _groups(rows: Float64, key: NDArray[np.uint64]) -> tuple[Int64, Int64]:
    """Return an order (N,) that puts equal rows next to each other, and the start (V,) of each run of equal rows."""
    order = np.argsort(key)
    run_begins = _differs(key[order])
    distinct = _differs(rows[order]).astype(bool)
    if np.any(distinct & ~run_begins):  # two positions have one hash: sort by the coordinates
        order = np.lexsort(rows.T[::-1])
        distinct = _differs(rows[order])
    return order, np.flatnonzero(distinct)


def _hash(rows: Float64) -> NDArray[np.uint64]:
    """Return a 64-bit hash (N,) of the bits of every row."""
    bits = rows.view(np.uint64)
    key = np.zeros(len(rows), np.uint64)
    for column in bits.T:
        key ^= column
        key *= np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    return key


def _differs(values: NDArray[Any]) -> Bool:
    """Return for every row whether it differs from the previous row; True for the first."""
    begins = np.ones(len(values), bool)
    changed = values[1:] != values[:-1]
    begins[1:] = changed if changed.ndim == 1 else changed.any(axis=1)
    return begins
