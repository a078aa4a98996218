"""Weights of vertices for handles: feature distance, fixed points, geodesic falloff (Eq. 4-7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd import _core
from dfd.common import check, tensors, threads
from dfd.weights.compact import CompactFeatures

__all__ = ["bind"]

Float32 = NDArray[np.float32]
Points = NDArray[np.int64] | Float32  # (N,) vertices or (N, d) rows
Distances = NDArray[np.float32] | NDArray[np.float16]


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
        (H, V) geodesic distances from each handle, in [0, 1]. float32 and float16 are read in place; in float16 they
        take half the memory, and are off by 2.5e-4 at most.
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
    source: Float32 | CompactFeatures
    if isinstance(features, CompactFeatures):
        source, blocks = features, features.blocks
    else:
        source = blocks = tensors.contiguous("bind", "features", features, ("V", "D"), np.float32)
    points, missed = _points("handles", handles, source)
    fixed_points, fixed_missed = (None, None) if fixed is None else _points("fixed", fixed, source)
    shape = (source.shape[0], len(points))
    distances, exponents = _falloff(geodesic, locality, shape)
    if out is None:
        weights = _core.empty_float32(*shape)
    else:
        inputs = {"features": blocks, "handles": points, "fixed": fixed_points, "geodesic": distances}
        weights = tensors.output("bind", out, shape, np.float32, inputs, columns=True)
    rest = (points, missed, fixed_points, fixed_missed, distances, exponents, weights, threads.get_num_threads())
    if not isinstance(source, CompactFeatures):
        _core.bind(blocks, *rest)
    elif source.precision == "int8":
        _core.bind_bytes(blocks, shape[0], source.step, *rest)
    else:
        _core.bind_halves(blocks, shape[0], *rest)
    return tensors.like(features, weights) if out is None else out


def _points(name: str, value: Any, source: Float32 | CompactFeatures) -> tuple[Points, Float32 | None]:
    """What to compare with, and (N,) what rows miss; the kernel checks where vertices lie and that handles differ."""
    array = np.asarray(tensors.shared("bind", name, value))
    if array.ndim == 2:
        rows = check.array("bind", name, array, ("N", source.shape[1]))
        if not isinstance(source, CompactFeatures):
            return rows, None
        stored, missed = source.project(rows)
        return np.ascontiguousarray(stored), missed
    if array.ndim == 1 and array.dtype == np.int64:
        return np.ascontiguousarray(array), None
    return check.vertex_indices("bind", name, array, source.shape[0]), None


def _falloff(geodesic: Any, locality: ArrayLike, shape: tuple[int, int]) -> tuple[Distances | None, Float32 | None]:
    """(H, V) distances and (H,) exponents λ, or neither."""
    if geodesic is None and type(locality) is float and locality == 0:
        return None, None
    vertex_count, handle_count = shape
    if np.ndim(locality) == 0:
        exponents = np.full(handle_count, check.number("bind", "locality", locality, minimum=0), np.float32)
    else:
        exponents = check.array("bind", "locality", locality, (handle_count,))
        if (exponents < 0).any():
            raise ValueError(f"bind: `locality` must be at least 0, got {exponents.min():g}")
    if geodesic is None:
        if exponents.any():
            raise ValueError("bind: `geodesic` must be given when `locality` is above 0")
        return None, None
    array = tensors.shared("bind", "geodesic", geodesic)
    dtype = np.float16 if getattr(array, "dtype", None) == np.float16 else np.float32
    distances: Distances = tensors.contiguous("bind", "geodesic", array, (handle_count, vertex_count), dtype)
    return distances, exponents
