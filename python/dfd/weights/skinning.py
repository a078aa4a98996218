"""Convert weights for programs whose linear blend skinning needs weights that sum to 1."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32

if TYPE_CHECKING:
    import torch


@overload
def skinning(weights: torch.Tensor) -> torch.Tensor: ...
@overload
def skinning(weights: ArrayLike) -> Float32: ...
def skinning(weights: Any) -> Any:
    """Return weights for usual linear blend skinning: with a column for the resting shape, every row sums to 1.

    Weights of dfd sum to any number. With a sum below 1, a vertex partly stays in place; skinning without the last
    column would pull it towards the origin. With a sum above 1, the weights are divided by it, as by
    `overlap="normalize"` of `dfd.pose`.

    Raises ValueError if `weights` has another array shape, is not finite, or has a negative number.

    Parameters
    ----------
    weights
        (V, H), at least 0, as `dfd.bind` returns them.

    Returns
    -------
    weights
        (V, H + 1) float32. The last column is max(1 − Σ W_k, 0), the weight of a joint that never moves. A tensor gives
        a tensor of its own type, with gradients.

    Examples
    --------
    >>> import dfd
    >>> dfd.skinning([[0.25, 0.25], [1.0, 1.0]])
    array([[0.25, 0.25, 0.5 ],
           [0.5 , 0.5 , 0.  ]], dtype=float32)
    """
    if tensors.is_tensor(weights):
        import torch

        _checked(weights.detach())
        total = weights.sum(dim=1, keepdim=True)
        return torch.cat([weights / total.clamp(min=1), (1 - total).clamp(min=0)], dim=1)
    rows = _checked(weights)
    total = rows.sum(axis=1, keepdims=True)
    return np.concatenate([rows / np.maximum(total, 1), np.maximum(1 - total, 0)], axis=1)


def _checked(weights: Any) -> Float32:
    rows: Float32 = check.array("skinning", "weights", weights, ("V", "H"))
    if (rows < 0).any():
        raise ArgumentError("weights", f"must be at least 0, got {rows.min():g}", "skinning")
    return rows
