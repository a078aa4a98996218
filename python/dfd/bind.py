"""Weights of vertices for handles: feature distance, fixed points, geodesic falloff (Eq. 4-7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd import _core, check, tensors, threads

__all__ = ["bind"]


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
        (V, D) rows, of unit length by convention; they are taken as they are. float32 is read in place.
    handles
        (H,) distinct vertex indices, or (H, D) feature rows, so that a handle can be any point in space.
    fixed
        (P,) vertex indices or (P, D) feature rows of points that stay, and with them all that looks like them.
    geodesic
        (H, V) geodesic distances from each handle, in [0, 1].
    locality
        λ ≥ 0, for all handles or (H,) for each: 0 reaches as far as looks do, larger stays closer to the handle.
    out
        (V, H) float32 array for the result, otherwise a new one is made.

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
    rows = tensors.contiguous("bind", "features", features, ("V", "D"), np.float32)
    handle_rows = _feature_rows("handles", handles, rows, unique=True)
    fixed_rows = None if fixed is None else _feature_rows("fixed", fixed, rows, unique=False)
    shape = (len(rows), len(handle_rows))

    exponents = _localities(locality, shape[1])
    distances = None
    if geodesic is not None:
        distances = tensors.contiguous("bind", "geodesic", geodesic, (shape[1], shape[0]), np.float32)
    elif exponents.any():
        raise ValueError("bind: `geodesic` must be given when `locality` is above 0")

    inputs = {"features": rows, "handles": handle_rows, "fixed": fixed_rows, "geodesic": distances}
    target = None if out is None else tensors.output("bind", out, shape, np.float32, inputs)
    weights = _core.bind(
        rows,
        handle_rows,
        fixed_rows,
        distances,
        None if distances is None else exponents,
        target,
        threads.get_num_threads(),
    )
    return tensors.like(features, weights) if out is None else out


def _feature_rows(name: str, value: Any, features: NDArray[np.float32], *, unique: bool) -> NDArray[np.float32]:
    """(N, D) rows of `features` that `value` indexes, or `value` itself if it holds rows already."""
    array = np.asarray(tensors.shared("bind", name, value))
    if array.ndim == 2:
        return check.array("bind", name, array, ("N", features.shape[1]))
    indices = check.vertex_indices("bind", name, array, len(features), unique=unique)
    rows = features[indices]
    bad = np.argwhere(~np.isfinite(rows))
    if len(bad):
        row, column = bad[0]
        raise ValueError(f"bind: `features` must be finite, got {rows[row, column]} at [{indices[row]}, {column}]")
    return rows


def _localities(locality: ArrayLike, handle_count: int) -> NDArray[np.float32]:
    """(H,) exponents λ."""
    if np.ndim(locality) == 0:
        return np.full(handle_count, check.number("bind", "locality", locality, minimum=0), np.float32)
    exponents = check.array("bind", "locality", locality, (handle_count,))
    if (exponents < 0).any():
        raise ValueError(f"bind: `locality` must be at least 0, got {exponents.min():g}")
    return exponents
