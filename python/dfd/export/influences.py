"""Skin weights in the form of file formats: a few joints for each vertex, and weights that sum to 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.export.rig import Rig

# A sum of weights above 1 by more is not the rounding of 24 bits.
ABOVE = 1e-5


@dataclass(frozen=True, eq=False)
class Influences:
    """The joints and weights of each vertex."""

    # (V, K) joints of each vertex, the heaviest first, no joint twice; 0 where the weight is 0
    joints: Int64
    weights: Float32  # (V, K) float32, descending; rows sum to 1 within 1e-6
    pruned: float  # the largest part of a vertex's weight that was left out, in [0, 1]
    normalized: int  # how many vertices had weights that sum to more than 1, or negative ones, and have others here


def influences_of(rig: Rig, most: int | None) -> Influences:
    """The `most` heaviest joints of each vertex, all where it is None, with their weights divided by their sum."""
    joints, weights = [], []
    pruned, normalized, width = 0.0, 0, 1
    count = len(rig.joints)
    for _, rows in rig.weights():
        normalized += int(((rows.sum(axis=1) > 1.0 + ABOVE) | (rows.min(axis=1) < -ABOVE)).sum())
        order, single, left = heaviest(np.maximum(rows, 0.0), min(most or count, count))
        pruned = max(pruned, 1.0 - left)
        width = max(width, int((single > 0).sum(axis=1).max()))
        joints.append(order)
        weights.append(single)
    return Influences(
        np.concatenate([each[:, :width] for each in joints]),
        np.concatenate([each[:, :width] for each in weights]),
        max(pruned, 0.0) if most is not None else 0.0,
        normalized,
    )


def heaviest(weights: Float64, most: int) -> tuple[Int64, Float32, float]:
    """The heaviest joints (N, most) of weights (N, J), their weights scaled to sum 1, and the least part kept of a row.

    No weight is negative, and every row has one.
    """
    order = np.argsort(-weights, axis=1, kind="stable")[:, :most]
    kept = np.take_along_axis(weights, order, axis=1)
    remaining = kept.sum(axis=1) / weights.sum(axis=1)
    single = _summing_to_one(kept / kept.sum(axis=1, keepdims=True))
    order[single == 0] = 0
    return order, single, float(remaining.min())


def _summing_to_one(weights: Float64) -> Float32:
    """Weights in 24 bits whose rows sum to 1: the first, the heaviest, absorbs the rounding of the others."""
    single = weights.astype(np.float32)
    single[single < np.finfo(np.float32).tiny] = 0.0  # some readers treat denormal numbers as 0
    single[:, 0] = 1.0 - single[:, 1:].sum(axis=1, dtype=np.float64)
    return single
