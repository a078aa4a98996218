"""Correct overlapping weights so that only a handle's own transform moves the vertex at the handle."""

import numpy as np

from dfd.common.linear_algebra import Float64

# If the smallest singular value divided by the largest is at most SINGULAR, float32 cannot distinguish two handles.
SINGULAR = 1e-5


def interpolating(function: str, handle_weights: Float64) -> Float64:
    """Return the inverse of `handle_weights` (H, H). Row j of that matrix has the weights of all handles at handle j.

    If weights are multiplied by the inverse, the weight of a handle becomes 1 at this handle, and 0 at other handles.

    Raises ValueError if `handle_weights` is singular. The message names the two most similar handles, or a handle at
    whose position all weights are 0. `function` is the caller's name in messages.
    """
    if len(handle_weights) == 0:
        return handle_weights
    directions, sizes, _ = np.linalg.svd(handle_weights)
    if sizes[-1] > SINGULAR * sizes[0]:
        return np.asarray(np.linalg.inv(handle_weights), np.float64)
    still = np.flatnonzero(~handle_weights.any(axis=1))
    if len(still):
        raise ValueError(f"{function}: the handle of column {still[0]} cannot move: all weights at its position are 0")
    # Similar handles have similar rows, so they have the largest entries in the last left singular vector.
    first, second = sorted(np.argsort(-np.abs(directions[:, -1]), kind="stable")[:2].tolist())
    handles = f"the handles of columns {first} and {second} cannot move independently"
    raise ValueError(f"{function}: {handles}: the weights at their positions are nearly equal")
