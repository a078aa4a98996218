"""Where a part ends among the nodes of the surface: its border snaps to the crease near it, by a minimal cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, dijkstra, maximum_flow

from dfd.parts.patches import Patches

__all__ = ["snapped"]

BAND = 1.5  # so far from the border of patches, in their spacing, a crease is looked for
CREASE = 0.1  # concavity over which a border costs e times less
KEEP = 0.1  # what a node that changes sides costs, as a part of the border around a patch for one of its area
UNITS = 1e6  # flows are whole numbers: what a border as long as the diagonal counts

Mask = NDArray[np.bool_]


def snapped(patches: Patches, inside: Mask) -> Mask:
    """(N,) which nodes belong to the part of the patches `inside` (P,), after the cheapest cut near its border.

    What borders cost is their length, less where the surface creases inwards; what lies farther from the border of the
    patches than `BAND` stays where it is.
    """
    fine, start = patches.node_borders, inside[patches.of_node]
    one, other = fine.pairs.T
    at_border = fine.pairs[(start[one] != start[other])].ravel()
    if len(at_border) == 0:
        return start
    reach = BAND * patches.spacing * patches.size
    near = np.isfinite(dijkstra(patches.nodes.graph, indices=np.unique(at_border), min_only=True, limit=reach))
    touched = near[one] | near[other]
    count = fine.count
    number = np.full(count, -1)
    number[near] = np.arange(near.sum())
    source, sink = int(near.sum()), int(near.sum()) + 1
    number[~near] = np.where(start[~near], source, sink)
    crease = fine.concavity[touched].clip(0) * np.minimum(patches.spacing / fine.apart[touched], 10.0)
    cost = (UNITS * fine.length[touched] * np.exp(-crease / CREASE)).astype(np.int64) + 1
    ends = number[fine.pairs[touched]]
    keep = (UNITS * KEEP / patches.spacing * patches.node_area[near]).astype(np.int64)
    own = np.flatnonzero(near)
    terminal = np.where(start[own], source, sink)
    row = np.concatenate([ends[:, 0], ends[:, 1], number[own], terminal])
    column = np.concatenate([ends[:, 1], ends[:, 0], terminal, number[own]])
    capacity = np.concatenate([cost, cost, keep, keep])
    apart = row != column
    graph = csr_array((capacity[apart], (row[apart], column[apart])), shape=(sink + 1, sink + 1))
    graph.sum_duplicates()
    graph.data = np.minimum(graph.data, np.iinfo(np.int32).max // 2).astype(np.int32)
    flow = maximum_flow(graph, source, sink, method="dinic").flow
    left = graph - flow
    left.data = left.data * (left.data > 0)
    left.eliminate_zeros()
    reached = breadth_first_order(left, source, return_predecessors=False)
    result = start.copy()
    result[own] = False
    held = np.zeros(sink + 1, bool)
    held[reached] = True
    result[own] = held[number[own]]
    return result[patches.twin]
