"""Assign each component to one handle if several handles move, so that every handle arrives.

A component follows the handle on it, else the first handle whose counterpart it is. A component inside another one
follows both handles. Components that border on each other share the band between them.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64
from dfd.geometry.coarse import Share

HELD = 0.5  # a component ends where the weight falls below this share of the column's largest weight
SAME = 0.5  # two components are the same from this intersection over union
INSIDE = 0.8  # a component is nested in another one from this share inside it


def carriers_of(held: Bool, weights: Float64) -> tuple[Bool, Bool]:
    """Compare components `held` (C, N) on N surface samples with `weights` (N,).

    Return (C, C) whether columns i and j hold the same component, and (C, C) whether that of i is nested in that of j.
    """
    area = held.astype(np.float64) * weights
    common = area @ held.T
    own = area.sum(axis=1)
    either = own[:, None] + own - common
    same = (common > 0) & (common >= SAME * either)
    nested = (common >= INSIDE * own[:, None]) & (own[:, None] > 0) & ~same
    return same, nested


def following(handle_of: Sequence[int], same: Bool) -> list[int]:
    """Return the columns that stay: one for each component, or one for each handle on the component.

    `handle_of` (C) is the handle of each column. The first column of a handle is the component with the handle.
    """
    own = [i for i, handle in enumerate(handle_of) if handle not in handle_of[:i]]
    kept: list[int] = []
    for i, handle in enumerate(handle_of):
        rivals = [j for j in {*own, *kept} if handle_of[j] != handle]
        if i in own or not same[i, rivals].any():
            kept.append(i)
    return kept


def shared(
    columns: Sequence[Share], points: Float64, standing: Mapping[int, int], same: Bool, nested: Bool
) -> list[Share]:
    """Return the weights of `columns` (C) so that every handle arrives, and columns beside each other sum to at most 1.

    `points` (V, 3) are the vertices. `standing` has the vertex of each handle, by the column on which the handle
    stands. `same` and `nested` (C, C) are those of `carriers_of`.
    """
    result = list(columns)

    def squared(vertices: NDArray[np.integer], *on: int) -> list[Float64]:
        """Return (N,) squared distances of `vertices` (N,) from the handle on each of some columns."""
        here = points.take(vertices, axis=0)
        return [np.einsum("nk,nk->n", apart, apart) for apart in (here - points[standing[column]] for column in on)]

    def scale(column: int, factor: Float64 | Float32) -> None:
        vertices, values = result[column]
        result[column] = Share(vertices, values * factor.astype(np.float32))

    for one, other in combinations(standing, 2):
        if same[one, other]:  # both handles are on one component: each moves the nearer vertices
            for own, rival in ((one, other), (other, one)):
                near, far = squared(result[own].vertices, own, rival)
                scale(own, far / np.maximum(near + far, 1e-300))
    for i, here in standing.items():
        beside = [j for j in range(len(result)) if j != i and not nested[i, j] and result[j].at(here) > 0]
        others = [points[vertex] for j, vertex in standing.items() if j != i]
        radius = np.linalg.norm(np.array(others).reshape(-1, 3) - points[here], axis=1).min(initial=np.inf) / 2
        if not beside or radius == 0:  # with radius 0, two handles are at one point
            continue
        whole = columns[i].dense(len(points))
        for j in beside:
            vertices = result[j].vertices
            near = np.square(1.0 - np.minimum(squared(vertices, i)[0] / radius**2, 1.0))
            scale(j, 1.0 - near * whole[vertices])
    depth = nested.sum(axis=1)
    for level in np.unique(depth):
        beside = np.flatnonzero(depth == level).tolist()
        total = np.zeros(len(points), np.float32)
        for j in beside:
            total[result[j].vertices] += result[j].values
        if total.max(initial=0.0) > 1.0:
            np.maximum(total, np.float32(1.0), out=total)
            for j in beside:
                scale(j, 1.0 / total[result[j].vertices])
    return result
