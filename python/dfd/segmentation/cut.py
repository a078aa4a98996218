"""Divide the whole shape into parts: each patch belongs to the part that a handle there holds."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import dijkstra

from dfd.common.linear_algebra import Bool, Int64
from dfd.segmentation.alike import Alike
from dfd.segmentation.choose import candidates, ladder
from dfd.segmentation.patches import ACROSS, TINY
from dfd.segmentation.trees import Trees

# HANDLES: number of patches at which a part is found; the first orbits are spread evenly over the surface. With 64, the
# Rand distance (`bench.quality people`) of 13 shapes is 0.0005 larger.
HANDLES = 128
# SAME_IOU: two regions are the same part if their intersection over union is at least this. With 0.3, the Rand distance
# is 0.006 larger; with 0.7, 0.001.
SAME_IOU = 0.5
# LEAST_AREA: smallest area of a part in a cut of the whole shape, as a share of the surface. Without, 13 shapes
# (`bench.quality people`) have 124 parts in place of 116, with the same Rand distance, and the sample of an animal has
# two parts of 9 vertices.
LEAST_AREA = 0.005


@dataclass(frozen=True)
class Ladders:
    """The parts at H patches, which are spread evenly over the surface."""

    handles: Int64  # (H,)
    parts: list[tuple[Bool, int]]  # masks (N, P) of the parts, the smallest first, and the index of the most likely one


def ladders_of(trees: Trees) -> Ladders:
    """Return the parts from which `cut_labels` chooses."""
    handles = np.unique(trees.patches.orbit, return_index=True)[1][:HANDLES]
    parts = []
    for handle in handles.tolist():
        found = candidates(trees, handle)
        rungs, middle = ladder(found, trees.patches.area)
        parts.append((found.regions[rungs], middle))
    return Ladders(handles, parts)


def cut_labels(trees: Trees, ladders: Ladders, count: int | None = None) -> Int64:
    """Return the part of each patch, (P,). A part that is too small joins the part that it touches most.

    If `count` is given, handles find smaller parts until there are as many, and then the smallest parts join others.
    """
    label = _labels(trees, ladders, 0)
    lowest = -max(middle for _, middle in ladders.parts)
    for level in range(-1, lowest - 1, -1):
        if count is None or len(np.unique(label)) >= count:
            break
        finer = _labels(trees, ladders, level)
        if len(np.unique(finer)) > len(np.unique(label)):
            label = finer
    while count is not None and len(np.unique(label)) > count:
        area = np.bincount(label, trees.patches.area)
        beside = {number: _beside(trees, label, number) for number in np.unique(label).tolist()}
        small = min((number for number in beside if beside[number] >= 0), key=area.__getitem__, default=None)
        if small is None:
            break
        label = np.where(label == small, beside[small], label)
    return label


def _labels(trees: Trees, ladders: Ladders, level: int) -> Int64:
    """Return the part of each patch, (P,), for parts at a level."""
    alike, groups = Alike(trees), list[list[Bool]]()  # the components of each part
    of_handle = np.empty(len(ladders.handles), np.int64)
    for row, (regions, middle) in enumerate(ladders.parts):
        region = regions[max(middle + level, 0)]
        same = [number for number, group in enumerate(groups) if any(_overlap(trees, region, one) for one in group)]
        if not same:
            same = [len(groups)]
            groups.append([region, *(each.region for each in alike.followers(region))])
        of_handle[row] = same[0]
    return _without_fragments(trees, _nearest(trees, ladders.handles, of_handle, groups))


def _nearest(trees: Trees, handles: Int64, of_handle: Int64, groups: list[list[Bool]]) -> Int64:
    """Return the part of each patch, (P,): that of the nearest handle whose part contains the patch, if there is one.

    A handle also stands for its mirror images, and for every patch of the counterparts that no handle of another part
    lies on.
    """
    count = len(trees.patches.area)
    label, best = np.zeros(count, np.int64), np.full(count, np.inf)
    taken = np.isin(trees.patches.orbit, trees.patches.orbit[handles])
    for number, group in enumerate(groups):
        own = trees.patches.orbit[handles[of_handle == number]]
        starts = np.isin(trees.patches.orbit, own)
        for component in group[1:]:
            if not (component & taken).any() or (component & starts).any():
                starts |= component & ~taken
        apart = dijkstra(trees.links, indices=np.flatnonzero(starts), min_only=True)
        apart[~np.any(group, axis=0)] += ACROSS
        nearer = apart < best
        label[nearer], best[nearer] = number, apart[nearer]
    return label


def _overlap(trees: Trees, one: Bool, other: Bool) -> bool:
    area = trees.patches.area
    return bool(area @ (one & other) >= SAME_IOU * (area @ (one | other)))


def _without_fragments(trees: Trees, label: Int64) -> Int64:
    patches = trees.patches
    for small in sorted(set(label.tolist()), key=lambda number: patches.area[label == number].sum()):
        if patches.area[label == small].sum() >= LEAST_AREA:
            break
        beside = _beside(trees, label, small)
        if beside >= 0:
            label[label == small] = beside
    return label


def _beside(trees: Trees, label: Int64, part: int) -> int:
    """Return the part that a part touches most; −1 if it touches none."""
    borders = trees.patches.borders
    ends = label[borders.pairs]
    between = (ends == part).any(axis=1) & (ends[:, 0] != ends[:, 1])
    if not between.any():
        return -1
    return int(np.bincount(ends[between].sum(axis=1) - part, borders.length[between] + TINY).argmax())
