"""Weights under which each handle lands exactly where its own transform sends it."""

from __future__ import annotations

import numpy as np

from dfd.common.linear_algebra import Float64

# Of the largest singular value: below, weights of 24 bits no longer say which handle moves what.
SINGULAR = 1e-5


def interpolating(function: str, handle_weights: Float64) -> Float64:
    """(H, H) inverse of the weights among handles, row j at the place of handle j.

    Weights times it are 1 for a handle at its own place and 0 for all others there.

    Raises ValueError if the weights are singular; it names the two handles that look most alike, or the one that moves
    nothing.
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
    # Rows that depend on each other cancel in the direction that the smallest singular value belongs to.
    first, second = sorted(np.argsort(-np.abs(directions[:, -1]), kind="stable")[:2].tolist())
    raise ValueError(
        f"{function}: the handles of columns {first} and {second} have alike weights at their places and cannot both "
        "arrive"
    )
