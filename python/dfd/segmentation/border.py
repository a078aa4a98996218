"""Move the borders of parts to nearby creases by a minimal cut, and find what a part separates from the body."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra, maximum_flow

from dfd.common.linear_algebra import Bool, Int64
from dfd.segmentation.patches import Patches

NECK = 1.5  # spacings of patches; components that touch only at this distance from the border are separate
SMALL_COMPONENT = 0.1  # share of the largest component's area; smaller components join their neighbor
BAND = 1.5  # largest distance by which the border may move, in spacings of patches
CREASE = 0.1  # concavity that divides the cost of a border by e
KEEP = 0.1  # cost of a node that changes sides, relative to the girth of a patch of its area
STEEPEST = 10.0  # largest factor of the concavity between nodes that are nearer to each other than patches
UNITS, MOST = 1e6, 2**28  # integer cost of a border as long as the diagonal, and the largest cost

Mask = Bool


def snapped(patches: Patches, inside: Mask, held: int | None = None) -> Mask:
    """Return (N,) which nodes belong to the part of patches `inside` (P,), after the cheapest cut near its border.

    The cost of a border is its length, lowered where the surface creases inwards. Nodes deeper than `BAND`, or than
    half of the depth of their component, keep their side. The node `held` belongs to the part.
    """
    borders, start = patches.node_borders, inside[patches.of_node]
    one, other = borders.pairs.T
    at_border = np.unique(borders.pairs[start[one] != start[other]])
    if len(at_border) == 0:
        return start
    band = BAND * patches.spacing * patches.size
    depth = dijkstra(patches.nodes.graph, indices=at_border, min_only=True, limit=band)
    deepest = np.zeros(borders.count)
    one_side = patches.borders.graph(np.equal(*inside[patches.borders.pairs.T]).astype(np.float64))
    one_side.eliminate_zeros()
    component = connected_components(one_side, directed=False)[1][patches.of_node]
    np.maximum.at(deepest, component, np.minimum(depth, band))
    free = depth < deepest[component] / 2
    if held is not None:
        start[held], free[held] = True, False
    # The graph has the nodes that may change sides, one source for all other nodes inside, and one sink for the rest.
    count = int(free.sum())
    number = np.where(start, count, count + 1)
    number[free] = np.arange(count)
    touched = free[one] | free[other]
    crease = borders.concavity[touched].clip(0) * np.minimum(patches.spacing / borders.apart[touched], STEEPEST)
    cost = UNITS * borders.length[touched] * np.exp(-crease / CREASE) + 1
    keep = UNITS * KEEP / patches.spacing * patches.node_area[free]
    ends = np.concatenate(
        [number[borders.pairs[touched]], np.stack([number[free], np.where(start[free], count, count + 1)], axis=1)]
    )
    ends, capacity = np.concatenate([ends, ends[:, ::-1]]), np.tile(np.concatenate([cost, keep]), 2)
    graph = csr_array((capacity.clip(0, MOST).astype(np.int32), tuple(ends.T)), shape=(count + 2, count + 2))
    left = (graph - maximum_flow(graph, count, count + 1, method="dinic").flow).tocsr()
    left.data[left.data < 0] = 0
    left.eliminate_zeros()
    on_side = np.zeros(count + 2, bool)
    on_side[breadth_first_order(left, count, return_predecessors=False)] = True
    return on_side[number][patches.twin]


def closed(patches: Patches, inside: Mask) -> Mask:
    """Return a part (P,) with everything that it separates from the body, such as the hoof of a leg.

    The body is the largest component that remains without the part. If it has less than half of the remaining area, as
    around a trunk, the part is returned unchanged.
    """
    borders = patches.borders
    out = np.flatnonzero(~inside)
    component = connected_components(borders.graph(borders.apart)[out][:, out], directed=False)[1]
    areas = np.bincount(component, patches.area[out])
    if len(out) == 0 or areas.max() < areas.sum() / 2:
        return inside
    whole = inside.copy()
    whole[out[component != areas.argmax()]] = True
    return whole


def components_of(patches: Patches, inside: Mask) -> Int64:
    """Return (P,) the component of a part `inside` (P,) that each patch is on, counted from 0; −1 outside the part.

    Legs that meet in a narrow web are separate components. Patches deeper than NECK define the components. Each other
    patch belongs to the component that is nearest along the surface.
    """
    borders = patches.borders
    own = np.flatnonzero(inside)
    graph = borders.graph(borders.apart)[own][:, own]
    ends = np.unique(borders.pairs[np.not_equal(*inside[borders.pairs.T])])
    depth = dijkstra(borders.graph(borders.apart), indices=ends, min_only=True) if len(ends) else None
    component = np.asarray(connected_components(graph, directed=False)[1], np.int64)
    if depth is not None:
        deep = np.flatnonzero(depth[own] > NECK * patches.spacing)
        core = connected_components(graph[deep][:, deep], directed=False)[1] if len(deep) else deep
        area = np.bincount(core, patches.area[own[deep]])
        large = (area > SMALL_COMPONENT * area.max(initial=0))[core]
        # A component without a deep patch stays one.
        whole = np.isin(component, component[deep[large]])
        seeds = deep[large]
        if len(seeds):
            source = dijkstra(graph, indices=seeds, min_only=True, return_predecessors=True)[2]
            name = np.zeros(len(own), np.int64)
            name[seeds] = core[large] + 1
            component = np.where(whole, name[np.where(whole, source, 0)], -component - 1)
    result = np.full(borders.count, -1)
    result[own] = np.unique(component, return_inverse=True)[1]
    return result
