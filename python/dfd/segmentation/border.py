"""Move the border of a part to nearby creases by a minimum cut of the graph of places (`Patches`)."""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra, maximum_flow

from dfd.common.linear_algebra import Bool
from dfd.segmentation.patches import Patches
from dfd.segmentation.trees import CREASE

# If borders of parts stay where patches end, level 0 is 0.0006 smaller on every sixth mesh of `bench.quality people`,
# the best within one level is 0.003 smaller, and the mean fold at borders of four rigs is 90.7° (90.4°).
COST = 2**26  # integer cost of a border of length 1 without a crease; a cut of length 31 fits into 32 bits


def snapped(patches: Patches, inside: Bool, held: int | None = None) -> Bool:
    """Move the border of a part to the cheapest cut nearby, and return the part's places, (M,) bool.

    `inside` (P,) is True for the patches of the part. The cost of a border is its length, multiplied by a lower factor
    in concave creases. A place can change sides if its distance from the old border is below the patch spacing, and
    below half of the largest such distance in its connected component. The place `held` always belongs to the part.
    """
    borders, start = patches.place_borders, inside[patches.of_place]
    one, other = borders.pairs.T
    at_border = np.unique(borders.pairs[start[one] != start[other]])
    if not len(at_border):
        return start
    limit = 2 * patches.spacing
    depth = dijkstra(borders.graph(borders.apart), indices=at_border, min_only=True, limit=limit)
    deepest = np.zeros(borders.count)
    one_side = patches.borders.graph(np.equal(*inside[patches.borders.pairs.T]).astype(np.float64))
    one_side.eliminate_zeros()
    component = connected_components(one_side, directed=False)[1][patches.of_place]
    np.maximum.at(deepest, component, np.minimum(depth, limit))
    free = depth < deepest[component] / 2
    if held is not None:
        start[held], free[held] = True, False
    # The graph has the places that can change sides, a source (other places of the part), and a sink (all others).
    count = int(free.sum())
    number = np.where(start, count, count + 1)
    number[free] = np.arange(count)
    touched = free[one] | free[other]
    cost = 1 + COST * borders.length[touched] * np.exp(-borders.concavity[touched].clip(0) / CREASE)
    ends = number[borders.pairs[touched]]
    ends, capacity = np.concatenate([ends, ends[:, ::-1]]), np.tile(cost, 2)
    graph = csr_array((capacity.astype(np.int32), tuple(ends.T)), shape=(count + 2, count + 2))
    left = (graph - maximum_flow(graph, count, count + 1, method="dinic").flow).tocsr()
    # The places that the source still reaches are the smallest side of all minimum cuts, so they are unique.
    return np.isin(number, breadth_first_order(left, count, return_predecessors=False))
