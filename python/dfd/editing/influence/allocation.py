"""Which handle each component follows, where several handles move: every handle arrives.

A component follows the handle that stands on it, else the first whose counterpart it is. A component inside another one
follows both. Components that border on each other share the band between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64

HELD = 0.5  # share of a column's largest weight: a component ends where less follows
SAME = 0.5  # intersection over union of two components: from here on they are one
INSIDE = 0.8  # share of a component that lies in another: from here on it is nested in it


def carriers_of(held: Bool, weights: Float64) -> tuple[Bool, Bool]:
    """Compare components `held` (C, N) on N surface samples with `weights` (N,).

    Returns
    -------
    same, nested
        (C, C) whether column i and column j hold the same component, and whether that of i is nested in that of j.
    """
    area = held.astype(np.float64) * weights
    common = area @ held.T
    own = area.sum(axis=1)
    either = own[:, None] + own - common
    same = (common > 0) & (common >= SAME * either)
    nested = (common >= INSIDE * own[:, None]) & (own[:, None] > 0) & ~same
    return same, nested


def following(handle_of: Sequence[int], same: Bool) -> list[int]:
    """Return the columns that stay: one for each component, besides those on which several handles stand.

    `handle_of` (C) is the handle of each column; the first column of a handle is that on which it stands.
    """
    own = [i for i, handle in enumerate(handle_of) if handle not in handle_of[:i]]
    kept: list[int] = []
    for i, handle in enumerate(handle_of):
        rivals = [j for j in {*own, *kept} if handle_of[j] != handle]
        if i in own or not same[i, rivals].any():
            kept.append(i)
    return kept


def shared(
    weights: Float32,
    points: Float64,
    standing: dict[int, int],
    anchors: NDArray[np.integer] | Int64,
    same: Bool,
    nested: Bool,
) -> Float32:
    """Return `weights` (C, V) so that every handle arrives and columns beside each other sum to at most 1.

    Parameters
    ----------
    points
        (V, 3) the vertices.
    standing
        By column on which a handle stands, which handle (H) that is.
    anchors
        (H,) the vertices of the handles.
    same, nested
        (C, C) as `carriers_of` returns them.
    """
    result = weights.copy()
    apart = {i: np.linalg.norm(points - points[anchors[handle]], axis=1) for i, handle in standing.items()}
    for one, other in combinations(standing, 2):
        if same[one, other]:  # both stand on it: each moves what is nearer to it
            near = np.square(apart[other]) / np.maximum(np.square(apart[one]) + np.square(apart[other]), 1e-300)
            result[one] *= near.astype(np.float32)
            result[other] *= (1.0 - near).astype(np.float32)
    for i, handle in standing.items():
        here = anchors[handle]
        beside = [j for j in range(len(result)) if j != i and not nested[i, j] and result[j, here] > 0]
        if not beside:
            continue
        others = [points[anchors[other]] for j, other in standing.items() if j != i]
        radius = np.linalg.norm(np.array(others) - points[here], axis=1).min() / 2
        if radius == 0:  # two handles at one point: neither can take the place of the other
            continue
        bump = np.square(1.0 - np.square(np.minimum(apart[i], radius) / radius)) * weights[i]
        result[beside] *= (1.0 - bump).astype(np.float32)
    depth = nested.sum(axis=1)
    for level in np.unique(depth):
        beside = np.flatnonzero(depth == level).tolist()
        total = result[beside].sum(axis=0)
        if total.max(initial=0.0) > 1.0:
            result[beside] /= np.maximum(total, np.float32(1.0))
    return result
