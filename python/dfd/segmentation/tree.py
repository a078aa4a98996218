"""Merge patches into a tree of parts: neighbors without a boundary between them first.

The strength of a boundary comes from its crease and from the distance of the features on both sides. The merged regions
with the weakest boundary are next, as in hierarchies of images (Arbeláez et al., "Contour detection and hierarchical
image segmentation", 2011). Patches that are mirror images of each other are one leaf of the tree, so each tree node is
symmetric. Lengths have the unit of `Patches`. (T,) arrays have one entry for each tree node.
"""

import heapq
from functools import cached_property

import numpy as np
from scipy.sparse import diags_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from dfd.common.linear_algebra import Bool, Float64, group_sums, principal_directions
from dfd.segmentation.patches import Patches

DIMENSIONS = 24  # number of principal components of the features that are kept; the others are noise
DIFFUSION = 0.005  # area over which features are smoothed, as a share of the surface
CREASE = 0.1  # concavity (`Borders`) of a border, about 6°, that divides the rate of smoothing across the border by e
STEP = 0.15  # feature distance of two patches that divides the rate of smoothing between them by e
ROUNDS = 3  # rounds of smoothing; each computes the rates from the features that the previous round smoothed
# The strength of a boundary is the logistic function of BIAS + CONCAVE × concavity + STEEP × feature distance.
BIAS, CONCAVE, STEEP = -2.8, 6.0, 1.0
FEATURES = 0.6  # weight of the distance of the regions' mean features, beside the strength of their boundary
LEAST_PATCH = 1e-9  # smallest area of a patch in the smoothing, as a share of the surface
LEAST_SPREAD = 0.05  # smallest divisor of the features: if all features of a shape are nearly equal, they are noise
SHORTEST = 1e-9  # length of a boundary across a small gap


class Tree:
    """The tree of all parts of one shape. Orbits of patches are its leaves. Each other node merges two earlier nodes.

    Attributes
    ----------
    links
        (P, P) distances between the centers of neighboring patches.
    values
        (P, K) smoothed features of the patches, divided by their standard deviation over the surface.
    steps
        (E,) distance of the `values` of the two patches at each border, at most 1.
    strength
        (E,) strength of the boundary at each border of the patches, in [0, 1].
    inside
        (T, P) whether a patch belongs to a tree node.
    parent
        (T,) index of the tree node that contains each node; −1 for the root.
    height
        (T,) strength of the boundary that disappeared in each tree node; 0 for leaves.
    """

    def __init__(self, patches: Patches, features: Float64) -> None:
        """Build the tree from `features` (P, D) of the patches."""
        self.patches, self.links = patches, patches.borders.graph(patches.borders.apart)
        smooth = smoothed(patches, features)
        spread = float(np.sqrt(patches.area @ np.square(smooth - patches.area @ smooth).sum(axis=1)))
        self.values = smooth / max(spread, LEAST_SPREAD)
        one, other = patches.borders.pairs.T
        self.steps = np.minimum(np.linalg.norm(self.values[one] - self.values[other], axis=1), 1.0)
        drive = BIAS + CONCAVE * patches.borders.concavity.clip(0.0, 1.0) + STEEP * self.steps
        self.strength = 1 / (1 + np.exp(-drive))
        children, height = self._merged()
        leaves = patches.orbit.max() + 1
        self.parent = np.full(leaves + len(children), -1)
        inside = np.zeros((len(self.parent), leaves), bool)
        inside[:leaves] = np.eye(leaves, dtype=bool)
        for node, pair in enumerate(children, start=leaves):
            inside[node] = inside[pair].any(axis=0)
            self.parent[pair] = node
        self.inside, self.height = inside[:, patches.orbit], np.concatenate([np.zeros(leaves), height])

    @cached_property
    def areas(self) -> Float64:
        """Return the area of each tree node, (T,), as a share of the surface."""
        return self.inside @ self.patches.area

    @cached_property
    def means(self) -> Float64:
        """Return the mean `values` (T, K) of each tree node."""
        return (self.inside * self.patches.area) @ self.values / self.areas[:, None]

    def mean(self, region: Bool) -> Float64:
        """Return the mean `values` (K,) of the patches `region` (P,)."""
        area = self.patches.area[region]
        return np.asarray(area @ self.values[region] / area.sum(), np.float64)

    def around(self, region: Bool) -> Bool:
        """Return the patches beside `region` (P,), (P,) bool."""
        beside = np.zeros(len(region), bool)
        pairs = self.patches.borders.pairs
        beside[pairs[np.not_equal(*region[pairs.T])]] = True
        return beside & ~region

    def components(self, inside: Bool) -> list[Bool]:
        """Return the connected components (P,) of the patches `inside` (P,)."""
        members = np.flatnonzero(inside)
        number = connected_components(self.links[members][:, members], directed=False)[1]
        found = np.zeros((number.max(initial=-1) + 1, len(inside)), bool)
        found[number, members] = True
        return list(found)

    def path(self, patch: int) -> list[int]:
        """Return the tree nodes that contain a patch, the smallest first."""
        nodes = [int(self.patches.orbit[patch])]
        while self.parent[nodes[-1]] >= 0:
            nodes.append(int(self.parent[nodes[-1]]))
        return nodes

    def _merged(self) -> tuple[list[list[int]], Float64]:
        """Return the children of each inner node, and the strength of the boundary between them, never decreasing."""
        patches, orbit = self.patches, self.patches.orbit
        leaves = int(orbit.max()) + 1
        area = np.bincount(orbit, patches.area, leaves)
        means = list(group_sums(orbit, patches.area[:, None] * self.values, leaves) / area[:, None])
        sizes = area.tolist()
        beside = self._boundaries(leaves)

        def cost(one: int, other: int) -> float:
            """Return the mean strength of the boundary between two regions, plus the distance of their features."""
            length, total = beside[one][other]
            apart = means[one] - means[other]
            return round(total / length + FEATURES * float(np.sqrt(apart @ apart)), 9)

        queue = [(cost(one, other), one, other) for one in range(leaves) for other in beside[one] if one < other]
        heapq.heapify(queue)
        children: list[list[int]] = []
        heights: list[float] = []
        alive = set(range(leaves))
        while len(alive) > 1:
            if not queue:  # components without a link merge last
                one, other = sorted(alive)[:2]
                height = heights[-1] if heights else 0.0
            else:
                height, one, other = heapq.heappop(queue)
                if one not in alive or other not in alive:
                    continue
            new = leaves + len(children)
            children.append([one, other])
            heights.append(height)
            alive -= {one, other}
            alive.add(new)
            size = sizes[one] + sizes[other]
            means.append((sizes[one] * means[one] + sizes[other] * means[other]) / size)
            sizes.append(size)
            around = beside[one]
            for number, (length, total) in beside[other].items():
                before = around.get(number, (0.0, 0.0))
                around[number] = length + before[0], total + before[1]
            beside.append({number: sums for number, sums in around.items() if number in alive})
            for number, sums in beside[new].items():
                beside[number][new] = sums
                heapq.heappush(queue, (cost(number, new), number, new))
            beside[one] = beside[other] = {}
        return children, np.maximum.accumulate(heights) if heights else np.zeros(0)

    def _boundaries(self, leaves: int) -> list[dict[int, tuple[float, float]]]:
        """Return, for each leaf, its neighbors, each with the length of the boundary and its strength times length."""
        borders = self.patches.borders
        ends = self.patches.orbit[borders.pairs]
        apart = ends[:, 0] != ends[:, 1]
        length = np.maximum(borders.length[apart], SHORTEST)
        key, which = np.unique(np.sort(ends[apart], axis=1) @ [leaves, 1], return_inverse=True)
        lengths, totals = np.bincount(which, length), np.bincount(which, length * self.strength[apart])
        beside: list[dict[int, tuple[float, float]]] = [{} for _ in range(leaves)]
        for pair, own, total in zip(key.tolist(), lengths.tolist(), totals.tolist(), strict=True):
            one, other = divmod(pair, leaves)
            beside[one][other] = beside[other][one] = own, total
        return beside


def smoothed(patches: Patches, features: Float64) -> Float64:
    """Return at most `DIMENSIONS` principal components (P, K) of `features` (P, D), smoothed along the surface.

    Creases and large changes of the features stop the smoothing. Source: Perona and Malik, "Scale-space and edge
    detection using anisotropic diffusion", 1990. Here, the conductance (the rate of smoothing across a border) also
    decreases with concavity. Each round is one implicit time step.
    """
    borders, area = patches.borders, diags_array(np.maximum(patches.area, LEAST_PATCH))
    values = features - patches.area @ features
    values = values @ principal_directions(values, DIMENSIONS).T
    by_crease = borders.length / borders.apart * np.exp(-borders.concavity.clip(0) / CREASE)
    one, other = borders.pairs.T
    for _ in range(ROUNDS):
        steps = np.square(values[one] - values[other]).sum(axis=1)
        conductance = borders.graph(by_crease * np.exp(-steps / STEP**2))
        laplacian = diags_array(np.asarray(conductance.sum(axis=1)).ravel()) - conductance
        values = splu((area + DIFFUSION * laplacian).tocsc()).solve(area @ values)
    return np.asarray(values, np.float64)
