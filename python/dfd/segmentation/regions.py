"""Measure connected regions of a shape, so that they can be compared with each other.

Lengths have the unit of `Patches`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

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
    mean: Float64  # (R, K) mean `Trees.values`
    contrast: Float64  # (R,) distances of `mean` from the mean values of the patches around the region, 1 if none

    def some(self, rows: Int64) -> Regions:
        """Return the regions with the indices `rows` (N,)."""
        return Regions(*(getattr(self, each.name)[rows] for each in fields(self)))


def measured(trees: Trees, inside: Bool) -> Regions:
    """Return the regions `inside` (R, P), and their measures."""
    patches, values = trees.patches, trees.values
    area, center, borders = patches.area[:, None], patches.center, patches.borders
    share = inside @ patches.area
    middle = (inside @ (center * area)) / share[:, None]
    squares = (center[:, :, None] * center[:, None]).reshape(-1, 9) * area
    spread = (inside @ squares).reshape(-1, 3, 3) / share[:, None, None] - middle[:, :, None] * middle[:, None]
    # Each patch has some length of border with each region. Borders of length 0 count as `TINY`.
    shared = borders.graph(np.maximum(borders.length, TINY))
    length = (shared @ inside.T.astype(np.float64)).T
    outer = np.where(inside, 0.0, length)  # (R, P) of the patches around a region
    inner = np.where(inside, (np.asarray(shared.sum(axis=1)).ravel() - length).clip(0.0), 0.0)
    border = outer.sum(axis=1)
    rim = (inner + outer) @ center / np.maximum(2 * border, TINY)[:, None]
    around = outer > 0
    mean, beside = inside @ (values * area) / share[:, None], around @ (values * area)
    beside /= np.maximum(around @ area, TINY)
    alone = border == 0
    return Regions(
        inside,
        share,
        border,
        np.sqrt(np.linalg.eigvalsh(spread).clip(0.0)),
        np.where(alone, 0.0, np.linalg.norm(middle - rim, axis=1)),
        mean,
        np.where(alone, 1.0, np.linalg.norm(mean - beside, axis=1)),
    )


def all_regions(trees: Trees) -> Bool:
    """Return the connected components (R, P) of all nodes of the trees, each once, in the order of the nodes."""
    found = {each.tobytes(): each for inside in trees.inside for each in trees.components(inside)}
    return np.array(list(found.values()))
