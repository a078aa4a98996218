"""Correct weights so that each handle moves exactly as its own transform says, in spite of the other handles."""

import numpy as np

from dfd.common.linear_algebra import Float64

# Ratio of the smallest to the largest singular value, below which float32 weights cannot distinguish the handles.
SINGULAR = 1e-5


def interpolating(function: str, handle_weights: Float64) -> Float64:
    """Return the inverse (H, H) of the weights among handles; row j holds the weights at the position of handle j.

    Weights (V, H) multiplied by the inverse are 1 at the handle's own position, and 0 at other handles.

    Raises ValueError if the weights are singular. The message names the two most similar handles, or a handle at whose
    position all weights are 0.
    """
    if len(handle_weights) == 0:
        return handle_weights
    directions, sizes, _ = np.linalg.svd(handle_weights)
    if sizes[-1] > SINGULAR * sizes[0]:
        return np.asarray(np.linalg.inv(handle_weights), np.float64)
    still = np.flatnonzero(~handle_weights.any(axis=1))
    if len(still):
        raise ValueError(f"{function}: the handle of column {still[0]} cannot move: all weights at its position are 0")
    # The rows of similar handles have the largest entries in the direction of the smallest singular value.
    first, second = sorted(np.argsort(-np.abs(directions[:, -1]), kind="stable")[:2].tolist())
    handles = f"the handles of columns {first} and {second} cannot move independently"
    raise ValueError(f"{function}: {handles}: the weights at their positions are nearly equal")
