"""The tree of a shape's parts: patches joined by likeness of features that are smooth over the surface but at creases.

Each node of the tree is a part with its counterparts. Which of those that hold a place a person would call a part shows
at their borders: they run along creases, and the next larger part differs much from it.
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

DIMENSIONS = 24  # main directions of the features that are kept: the others hold noise
DIFFUSION = 0.005  # area over which features are smoothed, as a part of the surface
CREASE = 0.1  # concavity across which e times less is passed on: about six degrees a patch
STEP = 0.15  # difference of features likewise
ROUNDS = 3  # of smoothing: what one round evens out lets the next tell borders better
LEAST_AREA, MOST_AREA = 0.002, 0.95  # of the whole surface: of other sizes nothing is a part
LEAST_COMPONENT = 0.005  # likewise, of the mean component of a part: a crease has less
LEAST_SHOWN = 0.005  # likewise, for a part of the whole cut
ALIKE = 1.4  # times as large, at most: pieces of a size
# Pieces of such a size as those of the likeliest part, so equal, belong to it where the part of all is as likely.
EQUAL, STILL_LIKELY = 0.8, 0.15
CUT = 1.35  # times its likelihood, for a branch of the clearest cut: parts that people name lie side by side
# Of the surface: a larger part gives way to a smaller one that scores at least half as much, and LEAST_WITHIN.
MOST_MEANT, LEAST_WITHIN = 0.8, 0.15
# Power of a part's area relative to its own and that of what it leaves behind. On 45 rigs, 1 leaves 0.018 more of limbs
# behind and loses 0.014 of the IoU; on 38 labelled meshes, 3 loses 0.012.
WHOLE = 2.0
# Weight in it of area that is not beyond the handle, such as counterparts: on the rigs, 1 leaves 0.007 more behind, and
# on the labelled meshes, 0 loses 0.006 of the IoU.
ELSEWHERE = 0.25
SHORT = 0.2  # diagonals: a border that is not much longer has to crease more, since chance creases short ones
ROUNDING = 1e-12  # of the length of all borders: what is shorter is none
LEAST_CONCAVITY = 0.02  # counts for every border: some parts end without a crease
SURE = 0.1  # likelihood, at least, of each of two parts that are told to be one or two
# Two parts of several pieces each are one if pieces and borders are of a size, and if they differ from each other by
# less than so many times what each differs from its surroundings. Joined pairs may be pairs again, so often.
LESS_APART, TWIN_ROUNDS = 2.0, 3
EVEN = 0.05  # of height: what differs by less is alike, and steps from there to the next larger branch tell nothing


@dataclass(frozen=True, eq=False)
class Branch:
    """A part with its counterparts."""

    inside: Bool  # (P,) which patches belong to it
    area: float  # as a part of the whole surface
    border: float  # length of its borders, in diagonals of the box
    concavity: float  # how much the surface creases along them
    step: float  # how much more the next larger branch differs within itself, in [0, 1]


class Hierarchy:
    """Every part of one shape, from single patches to the whole.

    Attributes
    ----------
    branches
        (N,) the nodes of the tree: patches first, then what joins two earlier ones.
    cut
        Nodes that share out all patches: of all such cuts the one with the most clarity over the whole surface.
    clear
        (N,) which nodes end more clearly than any cut of them.

    Parameters
    ----------
    patches
        Of the shape.
    features
        (P, D) of the patches.
    """

    def __init__(self, patches: Patches, features: NDArray[np.floating]) -> None:
        self._patches = patches
        self._distal = Distal(patches)
        self._pieces_by_patches: dict[bytes, tuple[Float64, int]] = {}  # most nodes of one tree are in the next
        values = smoothed(patches, features.astype(np.float64))
        self._join(values)
        # Features know where on a body a thing is: front legs and hind legs may join it before they join each other.
        for _ in range(TWIN_ROUNDS):
            if not (twins := self._twins(values)):
                break
            for twin in twins:
                both = self._mean(values, twin[:1] | twin[1:])[0]
                for inside, own in zip(twin, self._mean(values, twin), strict=True):
                    values[inside] += both - own
            self._join(values)

    def _join(self, values: Float64) -> None:
        """Make the tree that joins patches with the least different `values` (P, D) first."""
        count = len(values)
        merges = linkage(values, "average") if count > 1 else np.zeros((0, 4))
        self._height = np.concatenate([np.zeros(count), merges[:, 2]])
        self._parent = np.full(2 * count - 1, -1)
        children = merges[:, :2].astype(np.int64)
        self._parent[children] = np.arange(count, 2 * count - 1)[:, None]
        self._size = np.concatenate([np.ones(count, np.int64), merges[:, 3].astype(np.int64)])
        # Patches in an order in which those of every node stand side by side, from `first` on.
        first = np.zeros(2 * count - 1, np.int64)
        for node in range(count - 2, -1, -1):
            one, other = children[node]
            first[one] = first[count + node]
            first[other] = first[one] + self._size[one]
        self._first, self._order = first, np.argsort(first[:count], kind="stable")
        self._children = children
        self._known_pieces: dict[int, tuple[Float64, int]] = {}
        self._carrying: dict[int, tuple[Bool, Bool]] = {}
        self.branches = self._described()
        self.cut, self.clear = self._clearest_cut()

    def _twins(self, values: Float64) -> list[Bool]:
        """Pairs (2, P) of parts of the clearest cut that are one, the most alike first; each part is in one at most."""
        nodes = [node for node in self.cut if self._may_be_held(node) and self.holdable(node) >= SURE]
        nodes = [node for node in nodes if len(self._pieces(node)[0]) > 1]
        if len(nodes) < 2:
            return []
        inside = np.array([self.branches[node].inside for node in nodes])
        touches = self._patches.borders.graph(np.ones(len(self._patches.borders.pairs)))
        around = (touches @ inside.T > 0).T & ~inside
        around[~around.any(axis=1)] = True  # a component: the whole shape
        mean = self._mean(values, inside)
        step = np.maximum(np.linalg.norm(mean - self._mean(values, around), axis=1), 1e-9)
        apart = cdist(mean, mean) / np.minimum(step[:, None], step)
        size = np.log([[self._pieces(node)[0].mean(), self.around(node)] for node in nodes])
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
        """(N, D) means of `values` (P, D) over parts (N, P), by area."""
        area = inside * self._patches.area
        return np.asarray(area @ values / area.sum(axis=1, keepdims=True), np.float64)

    def holding(self, patch: int) -> list[int]:
        """Nodes that hold a patch and that a person may hold, from the smallest on; at least one."""
        path = [patch]
        while self._parent[path[-1]] >= 0:
            path.append(int(self._parent[path[-1]]))
        return [node for node in path if self._may_be_held(node)] or path[-1:]

    def _may_be_held(self, node: int) -> bool:
        """Whether a node and its mean component have the area of a part."""
        return bool(
            LEAST_AREA < self.branches[node].area < MOST_AREA and self._pieces(node)[0].mean() > LEAST_COMPONENT
        )

    def holdable(self, node: int) -> float:
        """How likely a person who takes hold of the shape in a node means that node, compared with the others there.

        People name what creases off, differs from what is around it, and has short borders: limbs, heads, handles. The
        length that counts is that of one border, so that four legs with four borders do as well as one leg with one.
        """
        branch = self.branches[node]
        likely = (branch.concavity + LEAST_CONCAVITY) * branch.step / (self.around(node) + SHORT)
        return float(likely * (CUT if node in self.cut else 1.0))

    def clarity(self, node: int) -> float:
        """How clearly a node ends where it does; compared with that of others alone."""
        branch = self.branches[node]
        clarity = (branch.concavity + LEAST_CONCAVITY) * branch.step**0.75
        return float(clarity / np.sqrt(self.around(node) + SHORT))

    def carried(self, node: int) -> tuple[Bool, Bool]:
        """(P,) Return the closed node, and all that the shortest paths from the middle reach through it."""
        if node not in self._carrying:
            whole = closed(self._patches, self.branches[node].inside)
            self._carrying[node] = whole, self._distal.through(whole)
        return self._carrying[node]

    def meant(self, patch: int) -> int:
        """Return the node that a person means who grabs the shape at a patch.

        It is the likeliest that is not most of the shape, or one above it that joins it with as many equal pieces
        again: hind wheels follow front ones. A node that leaves much of the distal side behind is less likely: a ring
        around a leg, or its front alone. Only what the shortest paths from the middle reach through the node counts,
        so that a nose need not carry the head.
        """
        nodes, area = self.holding(patch), self._patches.area
        alone = [self.holdable(node) for node in nodes]
        side, likely = self._distal.side(patch), []
        for node, value in zip(nodes, alone, strict=True):
            whole, reached = self.carried(node)
            left = area[side & reached & ~whole].sum()
            own = (1 - ELSEWHERE) * area[whole & side].sum() + ELSEWHERE * area[whole].sum()
            likely.append(value * (own / (own + left)) ** WHOLE)
        best = int(np.argmax(likely))
        if self.branches[nodes[best]].area > MOST_MEANT:
            least = max(LEAST_WITHIN, alone[best] / 2)
            within = [i for i in range(best) if self.clear[nodes[i]] and alone[i] >= least]
            best = max(within, key=lambda i: likely[i], default=best)
        chosen = best
        for above in range(best + 1, len(nodes)):
            own, all_of_it = self._pieces(nodes[chosen])[0], self._pieces(nodes[above])[0]
            equal = all_of_it.min() >= EQUAL * all_of_it.max()
            alike = self._of_a_size(nodes[above], nodes[chosen])
            if len(all_of_it) >= 2 * len(own) and equal and alike and likely[above] >= STILL_LIKELY * likely[best]:
                chosen = above
        return nodes[chosen]

    def around(self, node: int) -> float:
        """Mean length of the borders of a node, in diagonals of the box: the way around a limb where it begins."""
        branch = self.branches[node]
        # Of what ends at a gap, as if it were square.
        length = branch.border or np.sqrt(branch.area * self._patches.node_area.sum())
        return float(length) / self._pieces(node)[1]

    def _of_a_size(self, one: int, other: int) -> bool:
        """Whether the mean pieces of two nodes are."""
        ratio = self._pieces(one)[0].mean() / self._pieces(other)[0].mean()
        return bool(1 / ALIKE <= ratio <= ALIKE)

    def _pieces(self, node: int) -> tuple[Float64, int]:
        if node not in self._known_pieces:
            inside = self.branches[node].inside
            key = np.packbits(inside).tobytes()
            if key not in self._pieces_by_patches:
                self._pieces_by_patches[key] = pieces_and_borders(self._patches, inside)
            self._known_pieces[node] = self._pieces_by_patches[key]
        return self._known_pieces[node]

    def _clearest_cut(self) -> tuple[list[int], Bool]:
        """Return `cut` and `clear`. The best cut of a node is the node itself, or the best cuts of what it joins."""
        count = self._patches.borders.count
        worth, clear = np.zeros(len(self._height)), np.zeros(len(self._height), bool)
        cuts = [[node] for node in range(count)]
        for node, (one, other) in enumerate(self._children, start=count):
            own = self.branches[node].area * self.clarity(node) if self._may_be_held(node) else 0.0
            below = worth[one] + worth[other]
            worth[node], clear[node] = max(own, below), own > 0 and own >= below
            cuts.append([node] if clear[node] else cuts[one] + cuts[other])
        return cuts[-1], clear

    def shown(self) -> Int64:
        """(P,) the part of each patch in `cut`; what is too small for one goes where its border is the longest."""
        borders, area = self._patches.borders, self._patches.area
        part: Int64 = np.argmax([self.branches[node].inside for node in self.cut], axis=0)
        for small in sorted(set(part.tolist()), key=lambda number: area[part == number].sum()):
            if area[part == small].sum() >= LEAST_SHOWN:
                break
            ends = part[borders.pairs]
            between = (ends == small).any(axis=1) & (ends[:, 0] != ends[:, 1])
            if between.any():
                beside = ends[between].sum(axis=1) - small
                part[part == small] = np.bincount(beside, borders.length[between] + 1e-9).argmax()
        return part

    def _described(self) -> list[Branch]:
        """The nodes of the tree as parts."""
        patches, borders = self._patches, self._patches.borders
        creased = borders.length * borders.concavity.clip(0)
        area, length, crease = self._sums(patches.area), self._crossing(borders.length), self._crossing(creased)
        concavity = np.where(length > 0, crease / (length + SHORT), BRIDGE)  # nothing but small gaps, or the component
        above = np.where(self._parent >= 0, self._height[self._parent], self._height)
        step = (above - self._height) / (above + EVEN)
        inside = np.zeros((len(self._height), borders.count), bool)
        for row, first, size in zip(inside, self._first, self._size, strict=True):
            row[self._order[first : first + size]] = True
        described = zip(inside, area.tolist(), length.tolist(), concavity.tolist(), step.tolist(), strict=True)
        return [Branch(*each) for each in described]

    def _sums(self, of_node: Float64) -> Float64:
        """(N,) sums over the nodes below each and itself, of a number of each, or of each patch."""
        sums = np.zeros(len(self._height))
        sums[: len(of_node)] = of_node
        for node, (one, other) in enumerate(self._children, start=self._patches.borders.count):
            sums[node] += sums[one] + sums[other]
        return sums

    def _crossing(self, of_border: Float64) -> Float64:
        """(N,) sums over the borders of a node with what is around it: those of its patches, but for inner ones."""
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


def pieces_and_borders(patches: Patches, inside: Bool) -> tuple[Float64, int]:
    """Areas of the components of a part of patches `inside` (P,), but for small ones, and how many borders it has."""
    pairs = patches.borders.pairs.astype(np.int32)
    same = inside[pairs[:, 0]] == inside[pairs[:, 1]]
    piece = _core.components(len(inside), np.zeros((0, 3), np.int32), pairs[same])
    areas = np.bincount(piece, patches.area)
    own = np.zeros(len(areas), bool)
    own[piece[inside]] = True
    large = areas > SMALL_COMPONENT * areas[own].max()
    # Pieces and what is around them are a tree, with a border for each of its edges.
    return areas[large & own], max(int(large.sum()) - 1, 1)


def smoothed(patches: Patches, features: Float64) -> Float64:
    """(P, ≤ 24) main directions of features, evened out over the surface by diffusion that creases and steps hold back.

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
