"""Merge patches into trees of regions: neighbors without a boundary between them first.

The strength of a boundary comes from its crease. The distance of the mean features of the regions on both sides counts
beside it. The regions with the weakest boundary are merged next, as in hierarchies of images (Arbeláez et al., "Contour
detection and hierarchical image segmentation", 2011). Patches that are mirror images of each other are one leaf of each
tree, so each node is symmetric. Lengths have the unit of `Patches`.
"""

import heapq
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu

import dfd._core as _core
from dfd.common.linear_algebra import Bool, Float64, Int32, Int64, group_sums, principal_directions
from dfd.segmentation.patches import TINY, Patches

# The numbers are measured as in `patches`, where they are 0.701 and 0.820, with a noise of about 0.02.
# DIMENSIONS: number of principal components of the features that are kept; the others are noise. With 12: 0.701, 0.822;
# with 48: 0.699, 0.815.
DIMENSIONS = 24
# DIFFUSION: area over which features are smoothed, as a share of the surface. With half: 0.724, 0.821; with twice:
# 0.692, 0.804.
DIFFUSION = 0.005
# Differences of the next four are of the IoU at level 0 and of sets, measured as in `choose`.
# CREASE: concavity (`Borders`) of a border, about 6°, that divides the rate of smoothing across it by e. Without:
# −0.025, −0.032.
CREASE = 0.1
# STEP: feature distance of two patches that divides the rate of smoothing between them by e. Without: −0.010, −0.022.
STEP = 0.15
# ROUNDS: rounds of smoothing; each computes the rates from the features that the previous round smoothed. With 1:
# −0.019, −0.014; without smoothing: −0.014, −0.025.
ROUNDS = 3
# BIAS, CONCAVE: the strength of a boundary is the logistic function of BIAS + CONCAVE × concavity. With the concavity
# itself as the strength, level 0 is 0.003 smaller, within one level 0.004, and sets 0.007, on every third mesh.
BIAS, CONCAVE = -2.8, 6.0
# FEATURES: weights of the distance of the regions' mean features, one for each tree. With 0.6 alone: −0.014, −0.021;
# with 0.4 and 1: −0.002, +0.006, and −0.006 within one level; with 0.3 and 1.2: 0.000, +0.003, and −0.005 there.
FEATURES = (0.3, 0.6, 1.2)
# SMALLEST: smallest area of a region, as a share of the surface. With half, 1 of 416 places changes; with twice, the
# best within one level is 0.0015 smaller.
SMALLEST = 0.001


class Trees:
    """Trees of the regions of one shape. Orbits of patches are their leaves. Each node merges two earlier nodes.

    Nobody knows how much the mean features of two regions count beside the boundary between them. So there is a tree
    for each of several weights. (T,) arrays have one entry for each region that is a node of any tree, and not smaller
    than `SMALLEST`, and for each thing of the file (`Patches.things`) with its mirror images.

    Attributes
    ----------
    links
        (P, P) distances between the centers of neighboring patches.
    values
        (P, K) smoothed features of the patches, divided by their standard deviation over the surface.
    strength
        (E,) strength of the boundary at each border of the patches, in [0, 1].
    inside
        (T, P) whether a patch belongs to a region.
    own
        (T,) whether a region is a thing of the file.
    votes
        (T,) number of trees in which the region is a node, at least 1 for a thing of the file.
    """

    def __init__(self, patches: Patches, features: Float64) -> None:
        """Build the trees from `features` (P, D) of the patches."""
        self.patches, self.links = patches, patches.borders.graph(patches.borders.apart)
        smooth = smoothed(patches, features)
        spread = float(np.sqrt(patches.area @ np.square(smooth).sum(axis=1)))  # smoothing keeps the mean, which is 0
        self.values = smooth / max(spread, TINY)
        self.strength = 1 / (1 + np.exp(-BIAS - CONCAVE * patches.borders.concavity.clip(0.0, 1.0)))
        of_trees = np.concatenate([self._tree(weight)[:, patches.orbit] for weight in FEATURES])
        inside = np.concatenate([of_trees, _regions_of_things(patches)])
        bits = np.packbits(inside, axis=1)
        first, which = np.unique(bits.view(f"V{bits.shape[1]}").ravel(), return_index=True, return_inverse=True)[1:]
        self.inside = inside[first]
        self.own = np.isin(np.arange(len(first)), which[len(of_trees) :])
        self.votes = np.maximum(np.bincount(which[: len(of_trees)], minlength=len(first)), self.own)

    def _tree(self, features: float) -> Bool:
        """Return the orbits (T, L) in each node of a tree, for a weight of the mean features."""
        children, area = self._merged(features)
        leaves = len(area) - len(children)
        size = np.ones(len(area), np.int64)
        for node, (one, other) in enumerate(children, start=leaves):
            size[node] = size[one] + size[other]
        # In the order of a walk through the tree, the leaves of a node are consecutive.
        start = np.zeros(len(size), np.int64)
        for node, (one, other) in reversed(list(enumerate(children, start=leaves))):
            start[one], start[other] = start[node], start[node] + size[one]
        large = np.flatnonzero(area >= SMALLEST)
        place = start[:leaves] - start[large, None]
        return np.asarray((place >= 0) & (place < size[large, None]))

    @cached_property
    def areas(self) -> Float64:
        """Return the area of each region, (T,), as a share of the surface."""
        return self.inside @ self.patches.area

    def mean(self, region: Bool) -> Float64:
        """Return the mean `values` (K,) of the patches `region` (P,)."""
        area = self.patches.area[region]
        return np.asarray(area @ self.values[region] / area.sum(), np.float64)

    def contrast(self, region: Bool) -> float:
        """Return the distance of the mean `values` of a region (P,) from those of the patches around it, 1 if none."""
        around = self.around(region)
        return float(np.linalg.norm(self.mean(region) - self.mean(around))) if around.any() else 1.0

    def boundary(self, region: Bool) -> float:
        """Return the mean `strength` of the boundary around a region (P,), 1 if it has no surroundings."""
        crossing, length = self.crossing(region)
        return mean_along(self.strength[crossing], length, 1.0)

    def crossing(self, region: Bool) -> tuple[Int64, Float64]:
        """Return the borders (C,) between a region (P,) and its surroundings, and their lengths (C,)."""
        one, other = self._ends
        crossing = np.flatnonzero(region[one] != region[other])
        return crossing, np.maximum(self.patches.borders.length[crossing], TINY)

    def around(self, region: Bool) -> Bool:
        """Return the patches beside `region` (P,), (P,) bool."""
        beside = np.zeros(len(region), bool)
        beside[self._ends[:, self.crossing(region)[0]]] = True
        return beside & ~region

    def labels(self, inside: Bool) -> Int32:
        """Return the number of the connected component of each of the patches `inside` (P,), and others, (P,)."""
        one, other = self._ends
        ends = np.flatnonzero(inside[one] & inside[other])
        return _core.components(len(inside), np.zeros((0, 3), np.int32), np.stack([one[ends], other[ends]], axis=1))

    @cached_property
    def _ends(self) -> Int32:
        """Return the patches (2, E) on both sides of each border."""
        return np.ascontiguousarray(self.patches.borders.pairs.T, np.int32)

    def components(self, inside: Bool) -> list[Bool]:
        """Return the connected components (P,) of the patches `inside` (P,)."""
        label = self.labels(inside)
        return [label == number for number in np.unique(label[inside])]

    def _merged(self, features: float) -> tuple[list[list[int]], Float64]:
        """Return the children of each inner node, and the areas of all nodes.

        `features` is the weight of the distance of the regions' mean features, beside the strength of the boundary.
        """
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
            return round(total / length + features * float(np.sqrt(apart @ apart)), 9)

        queue = [(cost(one, other), one, other) for one in range(leaves) for other in beside[one] if one < other]
        heapq.heapify(queue)
        children: list[list[int]] = []
        alive = set(range(leaves))
        while len(alive) > 1:
            if not queue:  # components without a link merge last
                one, other = sorted(alive)[:2]
            else:
                _, one, other = heapq.heappop(queue)
                if one not in alive or other not in alive:
                    continue
            new = leaves + len(children)
            children.append([one, other])
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
        return children, np.array(sizes)

    def _boundaries(self, leaves: int) -> list[dict[int, tuple[float, float]]]:
        """Return, for each leaf, its neighbors, each with the length of the boundary and its strength times length."""
        borders = self.patches.borders
        ends = self.patches.orbit[borders.pairs]
        apart = ends[:, 0] != ends[:, 1]
        length = np.maximum(borders.length[apart], TINY)
        key, which = np.unique(np.sort(ends[apart], axis=1) @ [leaves, 1], return_inverse=True)
        lengths, totals = np.bincount(which, length), np.bincount(which, length * self.strength[apart])
        beside: list[dict[int, tuple[float, float]]] = [{} for _ in range(leaves)]
        for pair, own, total in zip(key.tolist(), lengths.tolist(), totals.tolist(), strict=True):
            one, other = divmod(pair, leaves)
            beside[one][other] = beside[other][one] = own, total
        return beside


def _regions_of_things(patches: Patches) -> Bool:
    """Return the patches (U, P) of each thing of the file and of its mirror images, without the whole shape.

    Two things are mirror images if most of the area of each is in the orbits of the other.
    """
    found = [np.zeros((0, len(patches.area)), bool)]
    for label in patches.things:
        number = np.unique(label, return_inverse=True)[1]
        in_orbit = csr_array((patches.area, (number, patches.orbit)))  # area of each thing in each orbit
        size = np.asarray(in_orbit.sum(axis=1)).ravel()
        most = diags_array(1 / size) @ in_orbit @ (in_orbit > 0).T.astype(np.float64) > 0.5
        rows = most.multiply(most.T).tocsr()[:, number].toarray()
        found.append(rows[~rows.all(axis=1)])
    return np.concatenate(found)


def mean_along(values: Float64, length: Float64, alone: float) -> float:
    """Return the mean of `values` (C,), weighted by `length` (C,), or `alone` for a region without a border."""
    return float(values @ length / length.sum()) if len(length) else alone


def smoothed(patches: Patches, features: Float64) -> Float64:
    """Return at most `DIMENSIONS` principal components (P, K) of `features` (P, D), smoothed along the surface.

    Creases and large changes of the features stop the smoothing. Source: Perona and Malik, "Scale-space and edge
    detection using anisotropic diffusion", 1990. Here, the conductance (the rate of smoothing across a border) also
    decreases with concavity. Each round is one implicit time step.
    """
    borders, area = patches.borders, diags_array(np.maximum(patches.area, TINY))
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
