"""Weights of vertices for handles: feature distance, fixed points, geodesic falloff (Eq. 4-7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd import _core, check, tensors, threads
from dfd.compact import CompactFeatures

__all__ = ["bind"]

Float32 = NDArray[np.float32]


def bind(
    features: Any,
    handles: Any,
    *,
    fixed: Any = None,
    geodesic: Any = None,
    locality: ArrayLike = 0.0,
    out: Any = None,
) -> Any:
    """How much each vertex follows each handle, in [0, 1], and exactly 1 at the handle itself.

    Parameters
    ----------
    features
        (V, D) rows, of unit length by convention; they are taken as they are. float32 is read in place. Or what
        `dfd.compact` makes of them, which binds many times faster within its tolerance.
    handles
        (H,) distinct vertex indices, or (H, D) feature rows, so that a handle can be any point in space.
    fixed
        (P,) vertex indices or (P, D) feature rows of points that stay, and with them all that looks like them.
    geodesic
        (H, V) geodesic distances from each handle, in [0, 1].
    locality
        λ ≥ 0, for all handles or (H,) for each: 0 reaches as far as looks do, larger stays closer to the handle.
    out
        (V, H) float32 array for the result, otherwise a new one is made. Its rows or its columns are contiguous: a
        column of a column-major array takes one more handle without touching the others.

    Returns
    -------
    weights
        (V, H) float32; a torch tensor if `features` is one.

    Raises
    ------
    ValueError
        If shapes disagree, a value is not finite, an index is out of range or repeated, a distance lies outside
        [0, 1], or `out` is not what the weights fit in.

    Equations 4 and 5: W = max(1 − ‖Z_i − Z_j‖, 0); then 6: W ← max(W − max_p W_p, 0); then 7: W ← W (1 − G)^λ.
    """
    source: _Rows | CompactFeatures
    if isinstance(features, CompactFeatures):
        source = features
    else:
        source = _Rows(tensors.contiguous("bind", "features", features, ("V", "D"), np.float32))
    rows, missed = _points("handles", handles, source, unique=True)
    fixed_rows, fixed_missed = (None, None) if fixed is None else _points("fixed", fixed, source, unique=False)
    shape = (source.shape[0], len(rows))

    exponents: Float32 | None = _localities(locality, shape[1])
    distances = None
    if geodesic is not None:
        distances = tensors.contiguous("bind", "geodesic", geodesic, (shape[1], shape[0]), np.float32)
    elif exponents is not None and exponents.any():
        raise ValueError("bind: `geodesic` must be given when `locality` is above 0")
    else:
        exponents = None

    if out is None:
        weights = _core.empty_float32(*shape)
    else:
        inputs = {"features": source.blocks, "handles": rows, "fixed": fixed_rows, "geodesic": distances}
        weights = tensors.output("bind", out, shape, np.float32, inputs, columns=True)
    threads_used = threads.get_num_threads()
    if isinstance(source, _Rows):
        _core.bind(source.blocks, rows, fixed_rows, distances, exponents, weights, threads_used)
    else:
        points = (rows, missed, fixed_rows, fixed_missed, distances, exponents, weights, threads_used)
        if source.precision == "int8":
            _core.bind_bytes(source.blocks, source.shape[0], source.step, *points)
        else:
            _core.bind_halves(source.blocks, source.shape[0], *points)
    return tensors.like(features, weights) if out is None else out


class _Rows:
    """Full features, with what `CompactFeatures` offers."""

    def __init__(self, rows: Float32) -> None:
        self.blocks, self.shape = rows, rows.shape

    def stored(self, indices: NDArray[np.int64]) -> Float32:
        rows = self.blocks[indices]
        bad = np.argwhere(~np.isfinite(rows))
        if len(bad):
            row, column = bad[0]
            raise ValueError(f"bind: `features` must be finite, got {rows[row, column]} at [{indices[row]}, {column}]")
        return rows

    def project(self, rows: Float32) -> tuple[Float32, Float32]:
        return rows, np.zeros(len(rows), np.float32)


def _points(name: str, value: Any, source: _Rows | CompactFeatures, *, unique: bool) -> tuple[Float32, Float32]:
    """(N, d) rows to compare with, of the vertices that `value` indexes or of its own, and (N,) what they miss."""
    array = np.asarray(tensors.shared("bind", name, value))
    if array.ndim == 2:
        stored, missed = source.project(check.array("bind", name, array, ("N", source.shape[1])))
        return np.ascontiguousarray(stored), missed
    indices = check.vertex_indices("bind", name, array, source.shape[0], unique=unique)
    return np.ascontiguousarray(source.stored(indices)), np.zeros(len(indices), np.float32)


def _localities(locality: ArrayLike, handle_count: int) -> Float32:
    """(H,) exponents λ."""
    if np.ndim(locality) == 0:
        return np.full(handle_count, check.number("bind", "locality", locality, minimum=0), np.float32)
    exponents = check.array("bind", "locality", locality, (handle_count,))
    if (exponents < 0).any():
        raise ValueError(f"bind: `locality` must be at least 0, got {exponents.min():g}")
    return exponents
