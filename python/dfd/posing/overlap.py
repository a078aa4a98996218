"""Weights with which each handle arrives exactly at the target of its own transform."""

from __future__ import annotations

import numpy as np

from dfd.common.linear_algebra import Float64

# Smallest singular value relative to the largest. Below it, weights with 24 bits cannot distinguish the handles.
SINGULAR = 1e-5


def interpolating(function: str, handle_weights: Float64) -> Float64:
    """Return the inverse (H, H) of the weights among handles, whose row j is at the place of handle j.

    Weights multiplied by it are 1 for a handle at its own place, and 0 for all other handles there.

    Raises ValueError if the weights are singular. The message names the two most similar handles, or a handle that
    moves nothing.
    """
    if len(handle_weights) == 0:
        return handle_weights
    directions, sizes, _ = np.linalg.svd(handle_weights)
    if sizes[-1] > SINGULAR * sizes[0]:
        return np.asarray(np.linalg.inv(handle_weights), np.float64)
    still = np.flatnonzero(~handle_weights.any(axis=1))
    if len(still):
        raise ValueError(
            f"{function}: the handle of column {still[0]} cannot arrive: no weight is above 0 at its place"
        )
    # Linearly dependent rows cancel in the direction of the smallest singular value.
    first, second = sorted(np.argsort(-np.abs(directions[:, -1]), kind="stable")[:2].tolist())
    raise ValueError(
        f"{function}: the handles of columns {first} and {second} have nearly equal weights at their places and cannot "
        "both arrive"
    )
