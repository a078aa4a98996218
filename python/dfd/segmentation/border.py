"""Move the border of a part to nearby creases by a minimum cut, close the part (see `closed`), and find its components.

A patch is a group of mesh nodes. A mesh node is a group of nearby vertices (`dfd.geometry.coarse`).
"""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra, maximum_flow

from dfd.common.linear_algebra import Bool, Int64
from dfd.segmentation.patches import Patches

NECK = 1.5  # patches up to this distance from a part's border, in patch spacings, do not connect the part's components
SMALL_COMPONENT = 0.1  # a component is small if its area is below this share of the largest component's area
LARGEST_MOVE = 0.75  # largest distance by which a border moves, in patch spacings
CREASE = 0.1  # increase of concavity that divides the cost of a border by e
MOVE_COST = 0.1  # cost of moving a patch to the other side, divided by the cost of a flat border one patch spacing long
STEEPEST = 10.0  # largest value of (patch spacing / distance of two nodes), by which their concavity is multiplied
COST_SCALE = 1e6  # integer cost of a flat border as long as the diagonal of the bounding box
LARGEST_COST = 2**28  # largest integer cost, to prevent overflow of 32-bit sums


def snapped(patches: Patches, inside: Bool, held: int | None = None) -> Bool:
    """Move the border of a part to the cheapest cut nearby, and return the part's mesh nodes, (N,) bool.

    `inside` (P,) is True for the patches of the part. The cost of a border is its length, multiplied by a lower factor
    in concave creases. A mesh node can change sides if its distance from the old border is below `LARGEST_MOVE`, and
    below half of the largest such distance in its connected component. The mesh node `held` always belongs to the part.
    """
    borders, start = patches.node_borders, inside[patches.of_node]
    one, other = borders.pairs.T
    at_border = np.unique(borders.pairs[start[one] != start[other]])
    if len(at_border) == 0:
        return start
    limit = 2 * LARGEST_MOVE * patches.spacing * patches.size
    depth = dijkstra(patches.nodes.graph, indices=at_border, min_only=True, limit=limit)
    deepest = np.zeros(borders.count)
    one_side = patches.borders.graph(np.equal(*inside[patches.borders.pairs.T]).astype(np.float64))
    one_side.eliminate_zeros()
    component = connected_components(one_side, directed=False)[1][patches.of_node]
    np.maximum.at(deepest, component, np.minimum(depth, limit))
    free = depth < deepest[component] / 2
    if held is not None:
        start[held], free[held] = True, False
    # The graph has the nodes that can change sides, a source (other nodes of the part), and a sink (all others).
    count = int(free.sum())
    number = np.where(start, count, count + 1)
    number[free] = np.arange(count)
    touched = free[one] | free[other]
    crease = borders.concavity[touched].clip(0) * np.minimum(patches.spacing / borders.apart[touched], STEEPEST)
    cost = COST_SCALE * borders.length[touched] * np.exp(-crease / CREASE) + 1
    keep = COST_SCALE * MOVE_COST / patches.spacing * patches.node_area[free]
    ends = np.concatenate(
        [number[borders.pairs[touched]], np.stack([number[free], np.where(start[free], count, count + 1)], axis=1)]
    )
    ends, capacity = np.concatenate([ends, ends[:, ::-1]]), np.tile(np.concatenate([cost, keep]), 2)
    graph = csr_array((capacity.clip(0, LARGEST_COST).astype(np.int32), tuple(ends.T)), shape=(count + 2, count + 2))
    left = (graph - maximum_flow(graph, count, count + 1, method="dinic").flow).tocsr()
    left.data[left.data < 0] = 0
    left.eliminate_zeros()
    on_side = np.zeros(count + 2, bool)
    on_side[breadth_first_order(left, count, return_predecessors=False)] = True
    return on_side[number][patches.first]


def closed(patches: Patches, inside: Bool) -> Bool:
    """Return the patches of a part and of all regions that only this part connects to the body, (P,) bool.

    An example is the hoof of a leg. `inside` (P,) is True for the patches of the part. The body is the largest
    component of the surface outside the part. If the body has less than half of that surface, `inside` is returned.
    """
    borders = patches.borders
    out = np.flatnonzero(~inside)
    component = connected_components(borders.graph(borders.apart)[out][:, out], directed=False)[1]
    areas = np.bincount(component, patches.area[out])
    if len(out) == 0 or areas.max() < areas.sum() / 2:
        return inside
    result = inside.copy()
    result[out[component != areas.argmax()]] = True
    return result


def components_of(patches: Patches, inside: Bool) -> Int64:
    """Return the index of the component that contains each patch, (P,); −1 outside the part `inside` (P,).

    Connections between components are ignored if they consist of patches within `NECK` of the border. Legs that meet
    in a narrow web are thus separate components. Each patch of an ignored connection belongs to the nearest component.
    """
    borders = patches.borders
    members = np.flatnonzero(inside)
    graph = borders.graph(borders.apart)[members][:, members]
    component = np.asarray(connected_components(graph, directed=False)[1], np.int64)
    deep = np.flatnonzero(borders.depth(inside)[members] > NECK * patches.spacing)
    core = connected_components(graph[deep][:, deep], directed=False)[1] if len(deep) else deep
    area = np.bincount(core, patches.area[members[deep]])
    large = (area > SMALL_COMPONENT * area.max(initial=0))[core]
    if len(seeds := deep[large]):
        # A connected component without a large group of deep patches is not divided.
        divided = np.isin(component, component[seeds])
        source = dijkstra(graph, indices=seeds, min_only=True, return_predecessors=True)[2]
        of_seed = np.zeros(len(members), np.int64)
        of_seed[seeds] = core[large] + 1
        component = np.where(divided, of_seed[np.where(divided, source, 0)], -component - 1)
    result = np.full(borders.count, -1)
    result[members] = np.unique(component, return_inverse=True)[1]
    return result
