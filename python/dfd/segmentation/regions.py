"""Measure connected regions of a shape, so that they can be compared with each other.

Lengths have the unit of `Patches`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.segmentation.patches import TINY
from dfd.segmentation.trees import Trees


@dataclass(frozen=True, eq=False)
class Regions:
    """Connected regions of patches, and their measures."""

    inside: Bool  # (R, P) the patches of each region
    area: Float64  # (R,) areas, as shares of the surface
    border: Float64  # (R,) lengths of the borders
    extents: Float64  # (R, 3) standard deviations of the positions along the principal axes, ascending
    reach: Float64  # (R,) distances from the middle of the border to the middle of the region, 0 without a border
    mean: Float64  # (R, K) mean `Trees.traits`
    contrast: Float64  # (R,) distances of `mean` from the mean traits of the patches around the region, 1 if none

    def __getitem__(self, rows: Int64) -> Regions:
        """Return the regions `rows` (N,)."""
        return Regions(**{name: value[rows] for name, value in vars(self).items()})


def measured(trees: Trees, inside: Bool) -> Regions:
    """Return the regions `inside` (R, P), and their measures."""
    patches, traits = trees.patches, trees.traits
    area, center, (one, other) = patches.area, patches.center, patches.borders.pairs.T
    share = inside @ area
    crossing, length = inside[:, one] != inside[:, other], np.maximum(patches.borders.length, TINY)
    border = crossing @ length
    middle = (inside @ (center * area[:, None])) / share[:, None]
    squares = (center[:, :, None] * center[:, None]).reshape(-1, 9) * area[:, None]
    spread = (inside @ squares).reshape(-1, 3, 3) / share[:, None, None] - middle[:, :, None] * middle[:, None]
    rim = crossing @ (length[:, None] * (center[one] + center[other]) / 2) / np.maximum(border, TINY)[:, None]
    beside = _beside(inside, patches.borders.pairs)
    weighted, outer = traits * area[:, None], beside @ area
    mean, around = (inside @ weighted) / share[:, None], (beside @ weighted) / np.maximum(outer, TINY)[:, None]
    alone = outer == 0
    return Regions(
        inside,
        share,
        border,
        np.sqrt(np.linalg.eigvalsh(spread).clip(0.0)),
        np.where(alone, 0.0, np.linalg.norm(middle - rim, axis=1)),
        mean,
        np.where(alone, 1.0, np.linalg.norm(mean - around, axis=1)),
    )


def all_regions(trees: Trees) -> Regions:
    """Return the connected components of all nodes of the trees, each once, in the order of the nodes."""
    found = {each.tobytes(): each for inside in trees.inside for each in trees.components(inside)}
    return measured(trees, np.array(list(found.values())))


def _beside(inside: Bool, pairs: Int64) -> Bool:
    """Return the patches (R, P) that are neighbors of each of the regions `inside` (R, P), but outside it."""
    count = inside.shape[1]
    both = np.concatenate([pairs, pairs[:, ::-1]]).T
    neighbors = csr_array((np.ones(both.shape[1], np.float32), tuple(both)), shape=(count, count))
    return np.asarray((neighbors @ inside.T.astype(np.float32)).T > 0) & ~inside
