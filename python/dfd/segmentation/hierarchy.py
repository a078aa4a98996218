"""The tree of a shape's parts: patches merged by the similarity of features, smoothed except across creases.

Each node of the tree is a part with its counterparts. A node is a part that people would name if its borders run along
creases and its features differ much from those of the next larger node.
"""

from __future__ import annotations

from dataclasses import dataclass

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
DIFFUSION = 0.005  # area over which features are smoothed, relative to the surface
CREASE = 0.1  # concavity that divides the conductance of smoothing by e, about six degrees per patch
STEP = 0.15  # feature distance with the same effect
ROUNDS = 3  # number of rounds of smoothing; each round detects borders in the result of the previous one
LEAST_AREA, MOST_AREA = 0.002, 0.95  # bounds of the area of a part, as shares of the surface
LEAST_COMPONENT = 0.005  # smallest mean area of a part's components, as a share of the surface; creases have less
LEAST_SHOWN = 0.005  # smallest area of a part in a cut of the whole shape, as a share of the surface
ALIKE = 1.4  # largest ratio between two areas that count as similar
# A larger node replaces the best one if the areas of its smallest and largest component have at least the ratio EQUAL,
# and its likelihood is at least STILL_LIKELY times that of the best.
EQUAL, STILL_LIKELY = 0.8, 0.15
CUT = 1.35  # factor of the saliency of nodes in the clearest cut, because parts that people name do not overlap
# Nodes with more than MOST_MEANT of the surface are held only where no smaller one has at least a saliency of
# LEAST_WITHIN. On 91 rigs, 0.8 loses 0.005 of the IoU, and 0.2 loses 0.003; on 76 labelled meshes, 0.6 loses 0.002, and
# 0.1 loses 0.010.
MOST_MEANT, LEAST_WITHIN = 0.7, 0.15
# Exponent, in the likelihood of a node, of the share of the surface beyond the handle that the node holds. On 91 rigs,
# 2 leaves 0.004 more of limbs behind, and 4 loses 0.004 of the IoU.
HELD_BEYOND = 3.0
SHORT = 0.2  # diagonals; added to lengths of borders, because short borders often follow a crease by chance
ROUNDING = 1e-12  # share of the length of all borders below which a length is a rounding error
LEAST_CONCAVITY = 0.02  # added to every border, since some parts end without a crease
SURE = 0.1  # smallest saliency of two parts that may be joined
# Two parts of several components each are joined if their components and borders have similar sizes, and their features
# differ by less than LESS_APART times the difference from their surroundings. This is repeated TWIN_ROUNDS times.
LESS_APART, TWIN_ROUNDS = 2.0, 3
EVEN = 0.05  # merge distance below which steps to the parent are noise


@dataclass(frozen=True, eq=False)
class Node:
    """A node of the tree: a part with its counterparts."""

    inside: Bool  # (P,) which patches belong to it
    area: float  # as a share of the surface
    border: float  # length of its borders, in diagonals of the box
    concavity: float  # mean concavity along them, in [0, 2]
    step: float  # increase of the merge distance to the parent, in [0, 1]


class Hierarchy:
    """The tree of all parts of one shape, from single patches to the whole.

    Attributes
    ----------
    nodes
        (N,) the nodes: patches first, then nodes that merge two earlier ones.
    cut
        The nodes of the cut of the tree with the largest sum of clarity times area.
    clear
        (N,) whether a node is clearer than every cut of its subtree.

    Parameters
    ----------
    patches
        The patches of the shape.
    features
        (P, D) of the patches.
    """

    def __init__(self, patches: Patches, features: NDArray[np.floating]) -> None:
        self._patches = patches
        self._distal = Distal(patches)
        self._components_by_patches: dict[bytes, tuple[Float64, int]] = {}  # shared by the trees of all rounds
        values = smoothed(patches, features.astype(np.float64))
        self._join(values)
        # Features also depend on the place on a body, so front legs may merge with the trunk before hind legs do.
        for _ in range(TWIN_ROUNDS):
            if not (twins := self._twins(values)):
                break
            for twin in twins:
                both = self._mean(values, twin[:1] | twin[1:])[0]
                for inside, own in zip(twin, self._mean(values, twin), strict=True):
                    values[inside] += both - own
            self._join(values)

    def _join(self, values: Float64) -> None:
        """Build the tree that merges patches with the most similar `values` (P, D) first."""
        count = len(values)
        merges = linkage(values, "average") if count > 1 else np.zeros((0, 4))
        self._height = np.concatenate([np.zeros(count), merges[:, 2]])
        self._parent = np.full(2 * count - 1, -1)
        children = merges[:, :2].astype(np.int64)
        self._parent[children] = np.arange(count, 2 * count - 1)[:, None]
        self._size = np.concatenate([np.ones(count, np.int64), merges[:, 3].astype(np.int64)])
        # In `_order`, the patches of each node are consecutive and start at `_first`.
        first = np.zeros(2 * count - 1, np.int64)
        for node in range(count - 2, -1, -1):
            one, other = children[node]
            first[one] = first[count + node]
            first[other] = first[one] + self._size[one]
        self._first, self._order = first, np.argsort(first[:count], kind="stable")
        self._children = children
        self._known_components: dict[int, tuple[Float64, int]] = {}
        self._carrying: dict[int, Bool] = {}
        self.nodes = self._described()
        self.cut, self.clear = self._clearest_cut()

    def _twins(self, values: Float64) -> list[Bool]:
        """Return pairs (2, P) of parts of the clearest cut to join, the most similar first, each part at most once."""
        nodes = [node for node in self.cut if self._may_be_part(node) and self.saliency(node) >= SURE]
        nodes = [node for node in nodes if len(self._components(node)[0]) > 1]
        if len(nodes) < 2:
            return []
        inside = np.array([self.nodes[node].inside for node in nodes])
        touches = self._patches.borders.graph(np.ones(len(self._patches.borders.pairs)))
        around = (touches @ inside.T > 0).T & ~inside
        around[~around.any(axis=1)] = True  # a whole component of the mesh is compared with the whole shape
        mean = self._mean(values, inside)
        step = np.maximum(np.linalg.norm(mean - self._mean(values, around), axis=1), 1e-9)
        apart = cdist(mean, mean) / np.minimum(step[:, None], step)
        size = np.log([[self._components(node)[0].mean(), self.around(node)] for node in nodes])
        alike = (apart < LESS_APART) & (cdist(size, size, "chebyshev") < np.log(ALIKE)) & ~(around @ inside.T)
        one, other = np.nonzero(np.triu(alike, 1))
        twins: list[Bool] = []
        taken: set[int] = set()
        for pair in np.argsort(apart[one, other], kind="stable"):
            both = [int(one[pair]), int(other[pair])]
            if taken.isdisjoint(both):
                taken.update(both)
                twins.append(inside[both])
        return twins

    def _mean(self, values: Float64, inside: Bool) -> Float64:
        """Return (N, D) means of `values` (P, D) over parts (N, P), weighted by area."""
        area = inside * self._patches.area
        return np.asarray(area @ values / area.sum(axis=1, keepdims=True), np.float64)

    def holding(self, patch: int) -> list[int]:
        """Return the nodes that contain a patch and may be parts, the smallest first; at least one."""
        path = [patch]
        while self._parent[path[-1]] >= 0:
            path.append(int(self._parent[path[-1]]))
        return [node for node in path if self._may_be_part(node)] or path[-1:]

    def _may_be_part(self, node: int) -> bool:
        """Return whether a node and its mean component have the area of a part."""
        return bool(
            LEAST_AREA < self.nodes[node].area < MOST_AREA and self._components(node)[0].mean() > LEAST_COMPONENT
        )

    def saliency(self, node: int) -> float:
        """Return the saliency of a node, comparable among the ancestors of one patch.

        Salient nodes end at creases, differ from their surroundings, and have short borders: limbs, heads, handles. The
        mean length of one border counts, so that four legs are as salient as one.
        """
        own = self.nodes[node]
        likely = (own.concavity + LEAST_CONCAVITY) * own.step / (self.around(node) + SHORT)
        return float(likely * (CUT if node in self.cut else 1.0))

    def clarity(self, node: int) -> float:
        """Return the clarity of a node's borders, comparable among all nodes."""
        own = self.nodes[node]
        clarity = (own.concavity + LEAST_CONCAVITY) * own.step**0.75
        return float(clarity / np.sqrt(self.around(node) + SHORT))

    def carrying(self, node: int) -> Bool:
        """Return (P,) the patches of a node with everything that it separates from the body."""
        if node not in self._carrying:
            self._carrying[node] = closed(self._patches, self.nodes[node].inside)
        return self._carrying[node]

    def meant(self, patch: int) -> int:
        """Return the node that a handle at a patch holds.

        The closed node has the largest expected IoU with the part that a person means. Salient nodes are more likely to
        be meant. Nodes that hold little of the surface beyond the handle are less likely, such as a ring around a leg.
        An ancestor replaces the node if it has at least twice as many components, all of similar size. Hind wheels then
        follow front wheels.
        """
        nodes, area = self.holding(patch), self._patches.area
        whole = np.array([self.carrying(node) for node in nodes])
        beyond = area * self._distal.beyond(patch)
        alone = np.array([self.saliency(node) for node in nodes])
        likely = alone * (whole @ beyond / beyond.sum()) ** HELD_BEYOND
        common = whole * area @ whole.T
        share = common.diagonal()
        expected = common / (share[:, None] + share - common) @ likely
        best = int(np.argmax(expected))
        smaller = np.flatnonzero((share <= MOST_MEANT) & (alone >= LEAST_WITHIN))
        if share[best] > MOST_MEANT and len(smaller):
            best = int(smaller[expected[smaller].argmax()])
        chosen = best
        for above in range(best + 1, len(nodes)):
            own, all_of_it = self._components(nodes[chosen])[0], self._components(nodes[above])[0]
            equal = all_of_it.min() >= EQUAL * all_of_it.max()
            alike = self._similar_size(nodes[above], nodes[chosen])
            if len(all_of_it) >= 2 * len(own) and equal and alike and likely[above] >= STILL_LIKELY * likely[best]:
                chosen = above
        return nodes[chosen]

    def around(self, node: int) -> float:
        """Return the mean length of a node's borders, in diagonals of the box: the girth of a limb at its base."""
        own = self.nodes[node]
        # A node without borders counts as a square of its area.
        length = own.border or np.sqrt(own.area * self._patches.node_area.sum())
        return float(length) / self._components(node)[1]

    def _similar_size(self, one: int, other: int) -> bool:
        """Return whether the mean components of two nodes have similar sizes."""
        ratio = self._components(one)[0].mean() / self._components(other)[0].mean()
        return bool(1 / ALIKE <= ratio <= ALIKE)

    def _components(self, node: int) -> tuple[Float64, int]:
        if node not in self._known_components:
            inside = self.nodes[node].inside
            key = np.packbits(inside).tobytes()
            if key not in self._components_by_patches:
                self._components_by_patches[key] = components_and_borders(self._patches, inside)
            self._known_components[node] = self._components_by_patches[key]
        return self._known_components[node]

    def _clearest_cut(self) -> tuple[list[int], Bool]:
        """Return `cut` and `clear`. The best cut of a node is the node itself, or the best cuts of its children."""
        count = self._patches.borders.count
        worth, clear = np.zeros(len(self._height)), np.zeros(len(self._height), bool)
        cuts = [[node] for node in range(count)]
        for node, (one, other) in enumerate(self._children, start=count):
            own = self.nodes[node].area * self.clarity(node) if self._may_be_part(node) else 0.0
            below = worth[one] + worth[other]
            worth[node], clear[node] = max(own, below), own > 0 and own >= below
            cuts.append([node] if clear[node] else cuts[one] + cuts[other])
        return cuts[-1], clear

    def shown(self) -> Int64:
        """Return (P,) the part of each patch in `cut`; small parts join the neighbor with the longest common border."""
        borders, area = self._patches.borders, self._patches.area
        part: Int64 = np.argmax([self.nodes[node].inside for node in self.cut], axis=0)
        for small in sorted(set(part.tolist()), key=lambda number: area[part == number].sum()):
            if area[part == small].sum() >= LEAST_SHOWN:
                break
            ends = part[borders.pairs]
            between = (ends == small).any(axis=1) & (ends[:, 0] != ends[:, 1])
            if between.any():
                beside = ends[between].sum(axis=1) - small
                part[part == small] = np.bincount(beside, borders.length[between] + 1e-9).argmax()
        return part

    def _described(self) -> list[Node]:
        """Return the nodes of the tree."""
        patches, borders = self._patches, self._patches.borders
        creased = borders.length * borders.concavity.clip(0)
        area, length, crease = self._sums(patches.area), self._crossing(borders.length), self._crossing(creased)
        # Borders of length 0 are gaps between components.
        concavity = np.where(length > 0, crease / (length + SHORT), BRIDGE)
        above = np.where(self._parent >= 0, self._height[self._parent], self._height)
        step = (above - self._height) / (above + EVEN)
        inside = np.zeros((len(self._height), borders.count), bool)
        for row, first, size in zip(inside, self._first, self._size, strict=True):
            row[self._order[first : first + size]] = True
        described = zip(inside, area.tolist(), length.tolist(), concavity.tolist(), step.tolist(), strict=True)
        return [Node(*each) for each in described]

    def _sums(self, of_node: Float64) -> Float64:
        """Return (N,) sums over the subtree of each node, of a number per node or per patch."""
        sums = np.zeros(len(self._height))
        sums[: len(of_node)] = of_node
        for node, (one, other) in enumerate(self._children, start=self._patches.borders.count):
            sums[node] += sums[one] + sums[other]
        return sums

    def _crossing(self, of_border: Float64) -> Float64:
        """Return (N,) sums over the outer borders of each node, of a number per border of patches."""
        borders = self._patches.borders
        ends = borders.pairs.copy()
        apart = np.arange(len(ends))
        while len(apart):  # children come before parents, so that the smaller number goes up
            lower = ends[apart].argmin(axis=1)
            ends[apart, lower] = self._parent[ends[apart, lower]]
            apart = apart[ends[apart, 0] != ends[apart, 1]]
        outer, inner = np.zeros(borders.count), np.zeros(len(self._height))
        np.add.at(outer, borders.pairs, of_border[:, None])
        np.add.at(inner, ends[:, 0], of_border)
        sums = self._sums(outer) - 2 * self._sums(inner)
        return np.where(sums > ROUNDING * outer.sum(), sums, 0.0)


def components_and_borders(patches: Patches, inside: Bool) -> tuple[Float64, int]:
    """Return the areas of the components of a part `inside` (P,), without small ones, and its number of borders."""
    pairs = patches.borders.pairs.astype(np.int32)
    same = inside[pairs[:, 0]] == inside[pairs[:, 1]]
    component = _core.components(len(inside), np.zeros((0, 3), np.int32), pairs[same])
    areas = np.bincount(component, patches.area)
    own = np.zeros(len(areas), bool)
    own[component[inside]] = True
    large = areas > SMALL_COMPONENT * areas[own].max()
    # Components and their surroundings form a tree with one border per edge.
    return areas[large & own], max(int(large.sum()) - 1, 1)


def smoothed(patches: Patches, features: Float64) -> Float64:
    """Return (P, ≤ 24) principal components of features, smoothed by diffusion that creases and steps hold back.

    Source: Perona and Malik, "Scale-space and edge detection using anisotropic diffusion", 1990, on a surface and with
    the crease as a second edge stopper; each round is one implicit step.
    """
    borders, area = patches.borders, diags_array(patches.area)
    values = features - patches.area @ features
    values = values @ np.linalg.eigh(values.T @ values)[1][:, : -DIMENSIONS - 1 : -1]
    ease = borders.length / borders.apart * np.exp(-borders.concavity.clip(0) / CREASE)
    one, other = borders.pairs.T
    for _ in range(ROUNDS):
        steps = np.square(values[one] - values[other]).sum(axis=1)
        conductance = borders.graph(ease * np.exp(-steps / STEP**2))
        laplacian = diags_array(np.asarray(conductance.sum(axis=1)).ravel()) - conductance
        values = splu((area + DIFFUSION * laplacian).tocsc()).solve(area @ values)
    return np.asarray(values, np.float64)
