"""Assign each component of a part to one handle if several handles move, so that every handle reaches its target.

A component follows the handle that lies on it. If no handle lies on it, it follows the first handle of which it is a
counterpart. A component inside another component follows the handles of both. If components overlap at their borders,
the sum of their weights is limited to 1.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64
from dfd.geometry.coarse import Share

LEAST_IOU = 0.5  # two components count as the same if their intersection over union is at least this
LEAST_NESTED = 0.8  # component A is nested in component B if at least this fraction of A lies in B


def same_and_nested(held: Bool, sizes: Float64) -> tuple[Bool, Bool]:
    """Return two masks (C, C): whether components i and j are the same, and whether component i is nested in j.

    `held` (C, N) says which of N surface samples a component contains. Sample n stands for `sizes[n]` vertices.
    """
    weighted = held.astype(np.float64) * sizes
    common = weighted @ held.T
    own = weighted.sum(axis=1)
    union = own[:, None] + own - common
    same = (common > 0) & (common >= LEAST_IOU * union)
    nested = (common >= LEAST_NESTED * own[:, None]) & (own[:, None] > 0) & ~same
    return same, nested


def kept_columns(handle_of: Sequence[int], same: Bool) -> list[int]:
    """Return the indices of the columns that remain of each component: those of handles on it, or else the first one.

    `handle_of` (C,) is the handle of each column. A handle lies on the component of its first column.
    """
    own = [i for i, handle in enumerate(handle_of) if handle not in handle_of[:i]]
    kept: list[int] = []
    for i, handle in enumerate(handle_of):
        rivals = [j for j in {*own, *kept} if handle_of[j] != handle]
        if i in own or not same[i, rivals].any():
            kept.append(i)
    return kept


def divided(
    columns: Sequence[Share], points: Float64, vertex_of: Mapping[int, int], same: Bool, nested: Bool
) -> list[Share]:
    """Return the weights of C `columns`, lowered so that every handle reaches its target.

    At each vertex, the sum of columns whose components are nested equally deep is at most 1. `points` (V, 3) are the
    vertices. `vertex_of` maps the first column of each handle to the vertex of the handle. `same` and `nested` (C, C)
    are the results of `same_and_nested`.
    """
    result = list(columns)

    def squared(vertices: NDArray[np.integer], column: int) -> Float64:
        """Return the squared distances (N,) of `vertices` (N,) from the handle on the component of a column."""
        apart = points.take(vertices, axis=0) - points[vertex_of[column]]
        return np.einsum("nk,nk->n", apart, apart)

    def scale(column: int, factor: Float64 | Float32) -> None:
        vertices, values = result[column]
        result[column] = Share(vertices, values * factor.astype(np.float32))

    for one, other in combinations(vertex_of, 2):
        if same[one, other]:  # two handles on one component: each vertex follows the nearer handle more
            for own, rival in ((one, other), (other, one)):
                near, far = (squared(result[own].vertices, column) for column in (own, rival))
                scale(own, far / np.maximum(near + far, 1e-300))
    for i, here in vertex_of.items():
        beside = [j for j in range(len(result)) if j != i and not nested[i, j] and result[j].at(here) > 0]
        others = [points[vertex] for j, vertex in vertex_of.items() if j != i]
        radius = np.linalg.norm(np.array(others).reshape(-1, 3) - points[here], axis=1).min(initial=np.inf) / 2
        if not beside or radius == 0:  # with radius 0, two handles are at one point
            continue
        whole = columns[i].dense(len(points))
        for j in beside:  # near the handle, lower the weights of the other columns
            vertices = result[j].vertices
            near = np.square(1.0 - np.minimum(squared(vertices, i) / radius**2, 1.0))
            scale(j, 1.0 - near * whole[vertices])
    depth = nested.sum(axis=1)
    for each in np.unique(depth):
        beside = np.flatnonzero(depth == each).tolist()
        total = np.zeros(len(points), np.float32)
        for j in beside:
            total[result[j].vertices] += result[j].values
        if total.max(initial=0.0) > 1.0:
            np.maximum(total, np.float32(1.0), out=total)
            for j in beside:
                scale(j, 1.0 / total[result[j].vertices])
    return result
