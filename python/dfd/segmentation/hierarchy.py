"""Build a tree of the parts of a shape, by merging patches with similar features.

Features are smoothed first, except across creases. Each tree node is a part with its counterparts. The merge distance
of a tree node is the mean distance between the features of its two children. A tree node is salient if its borders
follow creases and its parent has a much larger merge distance. (T,) arrays have one entry for each tree node.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import linkage
from scipy.sparse import diags_array
from scipy.sparse.linalg import splu
from scipy.spatial.distance import cdist

import dfd._core as _core
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.segmentation.border import SMALL_COMPONENT, closed
from dfd.segmentation.patches import BRIDGE, Distal, Patches

DIMENSIONS = 24  # number of principal components of the features that are kept; the others are noise
DIFFUSION = 0.005  # area over which features are smoothed, as a share of the surface
CREASE = 0.1  # concavity (`Borders`) of a border, about 6°, that divides the rate of smoothing across the border by e
STEP = 0.15  # feature distance of two patches that divides the rate of smoothing between them by e
ROUNDS = 3  # rounds of smoothing; each computes the rates from the features that the previous round smoothed
LEAST_AREA, MOST_AREA = 0.002, 0.95  # smallest and largest area of a part, as shares of the surface
LEAST_COMPONENT = 0.005  # smallest mean area of a part's components, as a share of the surface; excludes narrow strips
LEAST_CUT_AREA = 0.005  # smallest area of a part in a cut of the whole shape, as a share of the surface
SIMILAR = 1.4  # two areas or lengths are similar if the larger divided by the smaller is at most this
# In `held`, an ancestor replaces the best tree node only if the ancestor's smallest component has at least EQUAL times
# the area of its largest. The ancestor's likelihood must also be at least STILL_LIKELY times the best tree node's.
EQUAL, STILL_LIKELY = 0.8, 0.15
CUT = 1.35  # factor of the saliency of tree nodes in `Hierarchy.cut`: like the parts that people name, none overlap
# If the best tree node covers more than the share MOST_HELD of the surface, `held` prefers a candidate that covers less
# and has at least the saliency LEAST_WITHIN, if there is one.
MOST_HELD, LEAST_WITHIN = 0.7, 0.15
# If a tree node covers the share s of the surface beyond the handle, seen from the shape's middle (`Distal`), the tree
# node's likelihood is multiplied by s ** HELD_BEYOND. If the saliency is at least SALIENT, this factor is 1.
HELD_BEYOND, SALIENT = 3.0, 0.5
SHORT = 0.2  # added to border lengths, in bounding-box diagonals, because short borders often follow a crease by chance
ROUNDING = 1e-12  # length below which a border is a rounding error, as a share of the length of all borders
LEAST_CONCAVITY = 0.02  # added to the concavity of all borders, because some parts end without a crease
# Two parts, each with several components, are joined if both have at least the saliency SURE, the sizes of their
# components and borders are similar, and the parts do not touch. The distance of their mean features must also be below
# LESS_APART times the feature distance of each part from its surroundings. There are at most JOIN_ROUNDS rounds.
SURE, LESS_APART, JOIN_ROUNDS = 0.1, 2.0, 3
EVEN = 0.05  # added to the divisor of `Hierarchy.step`: if both merge distances are small, their difference is noise


class Hierarchy:
    """The tree of all parts of one shape. Patches are its leaves. Each other tree node merges two earlier tree nodes.

    Attributes
    ----------
    inside
        (T, P) whether a patch belongs to a tree node.
    area, border
        (T,) area of each tree node as a share of the surface, and length of its borders in bounding-box diagonals.
    concavity
        (T,) mean concavity along the borders, in [0, 2].
    step
        (T,) (M − m) / (M + `EVEN`), in [0, 1): m is a tree node's merge distance, and M its parent's.
    cut
        The clearest cut: the tree nodes that cover the shape once, with the largest sum of `clarity` × area.

    Parameters
    ----------
    patches
        The patches of the shape.
    features
        (P, D) the features of the patches.
    """

    def __init__(self, patches: Patches, features: NDArray[np.floating]) -> None:
        self._patches = patches
        self._distal = Distal(patches)
        self._known_components: dict[bytes, tuple[Float64, int]] = {}  # kept for the trees of all rounds
        values = smoothed(patches, features.astype(np.float64))
        self._build(values)
        # The features of front legs can be closer to those of the trunk than to those of the hind legs. The features of
        # two similar parts are therefore shifted so that both parts have the same mean, and the tree is built again.
        for _ in range(JOIN_ROUNDS):
            if not (pairs := self._counterpart_pairs(values)):
                break
            for pair in pairs:
                both = self._mean(values, pair[:1] | pair[1:])[0]
                for inside, own in zip(pair, self._mean(values, pair), strict=True):
                    values[inside] += both - own
            self._build(values)

    def _build(self, values: Float64) -> None:
        """Build the tree. Patches with the most similar `values` (P, D) are merged first."""
        count = len(values)
        merges = linkage(values, "average") if count > 1 else np.zeros((0, 4))
        self._height = np.concatenate([np.zeros(count), merges[:, 2]])
        self._parent = np.full(2 * count - 1, -1)
        children = merges[:, :2].astype(np.int64)
        self._parent[children] = np.arange(count, 2 * count - 1)[:, None]
        self._size = np.concatenate([np.ones(count, np.int64), merges[:, 3].astype(np.int64)])
        # The patches of tree node n are `_order[_first[n] : _first[n] + _size[n]]`.
        first = np.zeros(2 * count - 1, np.int64)
        for node in range(count - 2, -1, -1):
            one, other = children[node]
            first[one] = first[count + node]
            first[other] = first[one] + self._size[one]
        self._first, self._order = first, np.argsort(first[:count], kind="stable")
        self._children = children
        self._closed: dict[int, Bool] = {}
        self._measure_nodes()
        self.cut = self._clearest_cut()

    def _counterpart_pairs(self, values: Float64) -> list[Bool]:
        """Return pairs of parts to join, (2, P) bool each, the most similar pair first. No part is in two pairs."""
        nodes = [node for node in self.cut if self._may_be_part(node) and self.saliency(node) >= SURE]
        nodes = [node for node in nodes if len(self._components(node)[0]) > 1]
        if len(nodes) < 2:
            return []
        inside = self.inside[nodes]
        touches = self._patches.borders.graph(np.ones(len(self._patches.borders.pairs)))
        around = (touches @ inside.T > 0).T & ~inside
        around[~around.any(axis=1)] = True  # a part without neighbors is compared with the whole shape
        mean = self._mean(values, inside)
        step = np.maximum(np.linalg.norm(mean - self._mean(values, around), axis=1), 1e-9)
        apart = cdist(mean, mean) / np.minimum(step[:, None], step)
        size = np.log([[self._components(node)[0].mean(), self.girth(node)] for node in nodes])
        joined = (apart < LESS_APART) & (cdist(size, size, "chebyshev") < np.log(SIMILAR)) & ~(around @ inside.T)
        one, other = np.nonzero(np.triu(joined, 1))
        pairs: list[Bool] = []
        taken: set[int] = set()
        for pair in np.argsort(apart[one, other], kind="stable"):
            both = [int(one[pair]), int(other[pair])]
            if taken.isdisjoint(both):
                taken.update(both)
                pairs.append(inside[both])
        return pairs

    def _mean(self, values: Float64, inside: Bool) -> Float64:
        """Return the means (K, D) of `values` (P, D) over the parts `inside` (K, P), weighted by area."""
        area = inside * self._patches.area
        return np.asarray(area @ values / area.sum(axis=1, keepdims=True), np.float64)

    def candidates(self, patch: int) -> list[int]:
        """Return the tree nodes that contain a patch and may be parts, the smallest first; if none may, the root."""
        path = [patch]
        while self._parent[path[-1]] >= 0:
            path.append(int(self._parent[path[-1]]))
        return [node for node in path if self._may_be_part(node)] or path[-1:]

    def _may_be_part(self, node: int) -> bool:
        """Return whether a tree node's area and the mean area of its components lie within the bounds for parts."""
        return bool(LEAST_AREA < self.area[node] < MOST_AREA and self._components(node)[0].mean() > LEAST_COMPONENT)

    def saliency(self, node: int) -> float:
        """Return the saliency of a tree node. Compare saliencies only among tree nodes that share a patch.

        Salient tree nodes, such as a limb, a head or a cup's handle, end at creases and differ from their surroundings.
        They have short borders. The mean length of the borders counts, so four legs are as salient as one leg.
        """
        saliency = (self.concavity[node] + LEAST_CONCAVITY) * self.step[node] / (self.girth(node) + SHORT)
        return float(saliency * (CUT if node in self.cut else 1.0))

    def clarity(self, node: int) -> float:
        """Return the clarity of a tree node's borders, a saliency that can be compared among all tree nodes."""
        clarity = (self.concavity[node] + LEAST_CONCAVITY) * self.step[node] ** 0.75
        return float(clarity / np.sqrt(self.girth(node) + SHORT))

    def closed(self, node: int) -> Bool:
        """Return a tree node's patches and regions that only these connect to the body (`border.closed`), (P,) bool."""
        if node not in self._closed:
            self._closed[node] = closed(self._patches, self.inside[node])
        return self._closed[node]

    def held(self, patch: int) -> int:
        """Return the tree node that a handle at a patch moves.

        It is the candidate whose `closed` patches have the largest expected IoU (intersection over union) with the
        part that the user means. The likelihood of a candidate increases with its saliency. If the saliency is below
        `SALIENT`, the likelihood also increases with the candidate's share of the surface beyond the handle, so a ring
        around a leg is unlikely. An ancestor with at least twice as many components, all of similar size, replaces the
        candidate, so that hind wheels follow front wheels.
        """
        nodes, area = self.candidates(patch), self._patches.area
        whole = np.array([self.closed(node) for node in nodes])
        beyond = area * self._distal.beyond(patch)
        saliency = np.array([self.saliency(node) for node in nodes])
        likely = saliency * np.where(saliency < SALIENT, (whole @ beyond / beyond.sum()) ** HELD_BEYOND, 1.0)
        common = whole * area @ whole.T
        share = common.diagonal()
        expected = common / (share[:, None] + share - common) @ likely
        best = int(np.argmax(expected))
        smaller = np.flatnonzero((share <= MOST_HELD) & (saliency >= LEAST_WITHIN))
        if share[best] > MOST_HELD and len(smaller):
            best = int(smaller[expected[smaller].argmax()])
        chosen = best
        for above in range(best + 1, len(nodes)):
            own, larger = self._components(nodes[chosen])[0], self._components(nodes[above])[0]
            equal = larger.min() >= EQUAL * larger.max()
            similar = 1 / SIMILAR <= larger.mean() / own.mean() <= SIMILAR
            if len(larger) >= 2 * len(own) and equal and similar and likely[above] >= STILL_LIKELY * likely[best]:
                chosen = above
        return nodes[chosen]

    def girth(self, node: int) -> float:
        """Return the `girth` of a tree node."""
        return _girth(self._patches, float(self.border[node]), float(self.area[node]), self._components(node)[1])

    def _components(self, node: int) -> tuple[Float64, int]:
        key = self._keys[node]
        if key not in self._known_components:
            self._known_components[key] = components_and_borders(self._patches, self.inside[node])
        return self._known_components[key]

    def _clearest_cut(self) -> list[int]:
        """Return `cut`. The best cut of a tree node is the node, or its children's best cuts together."""
        count = self._patches.borders.count
        worth = np.zeros(len(self._height))
        cuts = [[node] for node in range(count)]
        for node, (one, other) in enumerate(self._children, start=count):
            own = self.area[node] * self.clarity(node) if self._may_be_part(node) else 0.0
            below = worth[one] + worth[other]
            worth[node] = max(own, below)
            cuts.append([node] if own > 0 and own >= below else cuts[one] + cuts[other])
        return cuts[-1]

    def cut_labels(self) -> Int64:
        """Return the index in `cut` of each patch's part, (P,). A small part joins the part that it touches most."""
        borders, area = self._patches.borders, self._patches.area
        part: Int64 = self.inside[self.cut].argmax(axis=0)
        for small in sorted(set(part.tolist()), key=lambda number: area[part == number].sum()):
            if area[part == small].sum() >= LEAST_CUT_AREA:
                break
            ends = part[borders.pairs]
            between = (ends == small).any(axis=1) & (ends[:, 0] != ends[:, 1])
            if between.any():
                beside = ends[between].sum(axis=1) - small
                part[part == small] = np.bincount(beside, borders.length[between] + 1e-9).argmax()
        return part

    def _measure_nodes(self) -> None:
        """Set the attributes that have an entry for each tree node."""
        patches, borders = self._patches, self._patches.borders
        creased = borders.length * borders.concavity.clip(0)
        self.area, self.border = self._sums(patches.area), self._crossing(borders.length)
        # A border of length 0 is a small gap between components of the mesh.
        self.concavity = np.where(self.border > 0, self._crossing(creased) / (self.border + SHORT), BRIDGE)
        above = np.where(self._parent >= 0, self._height[self._parent], self._height)
        self.step = (above - self._height) / (above + EVEN)
        self.inside = np.zeros((len(self._height), borders.count), bool)
        for row, first, size in zip(self.inside, self._first, self._size, strict=True):
            row[self._order[first : first + size]] = True
        self._keys = [row.tobytes() for row in np.packbits(self.inside, axis=1)]

    def _sums(self, of_node: Float64) -> Float64:
        """Return the sum of `of_node` over each tree node's subtree, (T,). `of_node` is (T,), or (P,) for leaves."""
        sums = np.zeros(len(self._height))
        sums[: len(of_node)] = of_node
        for node, (one, other) in enumerate(self._children, start=self._patches.borders.count):
            sums[node] += sums[one] + sums[other]
        return sums

    def _crossing(self, of_border: Float64) -> Float64:
        """Return the sum of `of_border` (E,) over the borders between each tree node and its surroundings, (T,)."""
        borders = self._patches.borders
        ends = borders.pairs.copy()
        apart = np.arange(len(ends))
        # Find the lowest common ancestor of the two patches of each border. Parents have higher indices than children,
        # so the end with the lower index is replaced by its parent until both ends are equal.
        while len(apart):
            lower = ends[apart].argmin(axis=1)
            ends[apart, lower] = self._parent[ends[apart, lower]]
            apart = apart[ends[apart, 0] != ends[apart, 1]]
        outer, inner = np.zeros(borders.count), np.zeros(len(self._height))
        np.add.at(outer, borders.pairs, of_border[:, None])
        np.add.at(inner, ends[:, 0], of_border)
        sums = self._sums(outer) - 2 * self._sums(inner)
        return np.where(sums > ROUNDING * outer.sum(), sums, 0.0)


def components_and_borders(patches: Patches, inside: Bool) -> tuple[Float64, int]:
    """Return the areas of the large components of a part `inside` (P,), and the count of the part's borders."""
    pairs = patches.borders.pairs.astype(np.int32)
    same = inside[pairs[:, 0]] == inside[pairs[:, 1]]
    component = _core.components(len(inside), np.zeros((0, 3), np.int32), pairs[same])
    areas = np.bincount(component, patches.area)
    own = np.zeros(len(areas), bool)
    own[component[inside]] = True
    large = areas > SMALL_COMPONENT * areas[own].max()
    # On a connected surface of genus 0, the components of the part and of its surroundings form a tree, whose edges are
    # the borders.
    return areas[large & own], max(int(large.sum()) - 1, 1)


def girth(patches: Patches, inside: Bool, count: int) -> float:
    """Return the mean length of a part's borders, in diagonals of the box. Example: the girth of a limb at its base.

    `inside` (P,) is True for the patches of the part, and `count` is the number of its borders. The girth of a part
    without borders is the side of a square with the area of the part.
    """
    borders = patches.borders
    length = float(borders.length[np.not_equal(*inside[borders.pairs.T])].sum())
    return _girth(patches, length, float(patches.area @ inside), count)


def _girth(patches: Patches, length: float, share: float, borders: int) -> float:
    """Return the girth of a part from the total `length` and the number of its borders, and its share of the area."""
    return (length or float(np.sqrt(share * patches.node_area.sum()))) / borders


def smoothed(patches: Patches, features: Float64) -> Float64:
    """Return at most `DIMENSIONS` principal components (P, K) of `features` (P, D), smoothed along the surface.

    Creases and large changes of the features stop the smoothing. Source: Perona and Malik, "Scale-space and edge
    detection using anisotropic diffusion", 1990. Here, the conductance (the rate of smoothing across a border) also
    decreases with concavity. Each round is one implicit time step.
    """
    borders, area = patches.borders, diags_array(patches.area)
    values = features - patches.area @ features
    values = values @ np.linalg.eigh(values.T @ values)[1][:, : -DIMENSIONS - 1 : -1]
    by_crease = borders.length / borders.apart * np.exp(-borders.concavity.clip(0) / CREASE)
    one, other = borders.pairs.T
    for _ in range(ROUNDS):
        steps = np.square(values[one] - values[other]).sum(axis=1)
        conductance = borders.graph(by_crease * np.exp(-steps / STEP**2))
        laplacian = diags_array(np.asarray(conductance.sum(axis=1)).ravel()) - conductance
        values = splu((area + DIFFUSION * laplacian).tocsc()).solve(area @ values)
    return np.asarray(values, np.float64)
