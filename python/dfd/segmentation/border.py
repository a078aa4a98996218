"""Move the borders of parts to nearby creases by a minimum cut, close parts, and find their components.

A patch is a group of nodes; a node is a group of nearby vertices (`dfd.geometry.coarse`).
"""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra, maximum_flow

from dfd.common.linear_algebra import Bool, Int64
from dfd.segmentation.patches import Patches

NECK = 1.5  # distance from the border up to which a connection is too narrow to join components, in patch spacings
SMALL_COMPONENT = 0.1  # area below which a component is small, relative to the largest component
BAND = 1.5  # largest distance by which the border may move, in patch spacings
CREASE = 0.1  # concavity that divides the cost of a border by e
KEEP = 0.1  # cost of moving a patch's area to the other side, relative to a border as long as the patch spacing
STEEPEST = 10.0  # largest factor of the concavity between nodes that are nearer to each other than patches
UNITS, MOST = 1e6, 2**28  # integer cost of a border as long as the diagonal of the box, and the largest cost


def snapped(patches: Patches, inside: Bool, held: int | None = None) -> Bool:
    """Return (N,) the nodes of the part of patches `inside` (P,), after its border moves to the cheapest cut nearby.

    The cost of a border is its length, lowered in concave creases. Nodes farther from the old border than `BAND`, or
    than half of the depth of their component, keep their side. The node `held` always belongs to the part.
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
    # The graph has the nodes that may change sides, a source for all other inner nodes, and a sink for the rest.
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
    return on_side[number][patches.first]


def closed(patches: Patches, inside: Bool) -> Bool:
    """Return a part (P,) with all components that only this part connects to the body, such as the hoof of a leg.

    The body is the largest component of the surface without the part. If the body has less than half of the remaining
    area, as without a trunk, the part is returned unchanged.
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


def components_of(patches: Patches, inside: Bool) -> Int64:
    """Return (P,) the component of each patch of a part `inside` (P,), counted from 0; −1 outside the part.

    Patches farther from the border than `NECK` define the components, so legs that meet in a narrow web are separate.
    Each other patch belongs to the component that is nearest along the surface.
    """
    borders = patches.borders
    own = np.flatnonzero(inside)
    graph = borders.graph(borders.apart)[own][:, own]
    component = np.asarray(connected_components(graph, directed=False)[1], np.int64)
    deep = np.flatnonzero(borders.depth(inside)[own] > NECK * patches.spacing)
    core = connected_components(graph[deep][:, deep], directed=False)[1] if len(deep) else deep
    area = np.bincount(core, patches.area[own[deep]])
    large = (area > SMALL_COMPONENT * area.max(initial=0))[core]
    if len(seeds := deep[large]):
        # A component without a large group of deep patches is not divided.
        whole = np.isin(component, component[seeds])
        source = dijkstra(graph, indices=seeds, min_only=True, return_predecessors=True)[2]
        name = np.zeros(len(own), np.int64)
        name[seeds] = core[large] + 1
        component = np.where(whole, name[np.where(whole, source, 0)], -component - 1)
    result = np.full(borders.count, -1)
    result[own] = np.unique(component, return_inverse=True)[1]
    return result
