"""Find the regions that look like a part: its mirror images, and others that people would call parts of its kind.

A logistic function of cues of two regions gives the probability that they are of one kind, such as two legs. Its
weights are learned (`bench.training.learn_alike`) from shapes whose parts and kinds are known. A region follows a part
if this probability is at least `LIKELY`, and if no more likely region overlaps it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import cache, cached_property
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.segmentation.choose import CLEAR
from dfd.segmentation.follow import Follow
from dfd.segmentation.patches import TINY
from dfd.segmentation.regions import Regions, all_regions, measured
from dfd.segmentation.trees import Trees

MOST = 64  # largest number of components of a part, because each needs a column of weights
# RANDOM: regions never look alike if their mean features differ as much as those of two random points. Without this
# bound, 2 of 288 places change, measured as in `choose`, but legs of one form and of quite different features follow.
RANDOM = 2**0.5
# LIKELY: least probability of a region that follows. On 25 labelled meshes (`bench.quality alike`), the IoU of sets is
# 0.661 with 0.5, 0.678 with 0.7 and 0.686 with 0.85; of what follows, 0.71, 0.82 and 0.88 is right.
LIKELY = 0.85
POSSIBLE = 1 / 3  # least probability of a region that is reported as left out
# MIRRORED: the areas of a region and of its mirror image have at most this ratio. Without this bound, the IoU of sets
# is 0.010 smaller, measured as in `choose`.
MIRRORED = 1.1
RATIOS = ("area", "border", "thickness", "width", "length", "reach", "contrast")
CUES = (*RATIOS, "features", "touching", "size", "clear")


class Likeness(NamedTuple):
    """A region that looks like a part."""

    region: Bool  # (P,) its patches
    probability: float  # that it is of the part's kind; 1 for a mirror image


class Alike:
    """The regions of one shape, and which of them look alike."""

    def __init__(self, trees: Trees) -> None:
        self.trees = trees
        self._last: tuple[Bool, Int64, Float64] | None = None

    @cached_property
    def regions(self) -> Bool:
        """Return all regions (R, P) that can follow a part."""
        return all_regions(self.trees)

    @cached_property
    def measures(self) -> Regions:
        """Return `regions` and their measures."""
        return measured(self.trees, self.regions)

    def followers(
        self, region: Bool, follow: Follow = "all", within: Bool | None = None, least: float = LIKELY
    ) -> list[Likeness]:
        """Return the mirror images of `region` (P,), and with "all" also other regions like it, the most likely first.

        The mirror images of each of these follow too, so that the set is symmetric. No two regions overlap. They lie
        inside `within` (P,) if it is given. `least` is the least probability of regions that are no mirror images.
        """
        taken = region.copy() if within is None else region | ~within
        found: list[Likeness] = []

        def take(regions: Iterable[Bool], probability: float) -> None:
            for each in regions:
                if len(found) < MOST - 1 and not (each & taken).any():
                    found.append(Likeness(each, probability))
                    taken[:] |= each

        if follow != "none":
            take(self._images(region), 1.0)
        if follow == "all":
            rows, likely = self._likely(region)
            for row, probability in zip(rows[likely >= least], likely.tolist(), strict=False):
                other = self.regions[row]
                if not (other & taken).any():
                    take((other, *self._images(other)), probability)
        return found

    def grown(self, component: Bool, like: Bool, taken: Bool) -> Bool:
        """Return the region around `component` (P,) that looks most like `like` (P,), without the patches `taken` (P,).

        If no region around it is likely to look so, `component` is returned.
        """
        rows, likely = self._likely(like)
        for row in rows[likely >= LIKELY]:
            other = self.regions[row]
            if other[component].all() and not (other & taken).any():
                return np.asarray(other)
        return component

    def _images(self, region: Bool) -> list[Bool]:
        """Return the mirror images (P,) of a region that are connected, and neither overlap nor touch it.

        Images of a region across the plane touch it: half a trunk is no counterpart of the other half.
        """
        patches = self.trees.patches
        images = self.trees.components(np.isin(patches.orbit, patches.orbit[region]) & ~region)
        area, around = patches.area @ region, self.trees.around(region)
        equal = [each for each in images if area / MIRRORED <= patches.area @ each <= area * MIRRORED]
        return [each for each in equal if not (each & around).any()]

    def _likely(self, region: Bool) -> tuple[Int64, Float64]:
        """Return the regions (N,) that do not overlap `region` (P,), the most likely first, and their probabilities."""
        if self._last is None or not np.array_equal(self._last[0], region):
            rows, cues, near = compared(self.trees, region, self.measures)
            constant, weights = _weights()
            likely = np.where(near, np.round(1 / (1 + np.exp(-constant - cues @ weights)), 9), 0.0)
            # Of equally likely regions, such as mirror images, the nearest comes first: this choice is symmetric, too.
            area, center = self.trees.patches.area, self.trees.patches.center
            middles = [(each * area) @ center / (each @ area)[..., None] for each in (region, self.regions[rows])]
            order = np.lexsort((np.round(np.linalg.norm(middles[1] - middles[0], axis=1), 9), -likely))
            self._last = region, rows[order], likely[order]
        return self._last[1:]


def compared(trees: Trees, region: Bool, regions: Regions) -> tuple[Int64, Float64, Bool]:
    """Compare a region (P,) with those of `regions` that do not overlap it.

    Return their indices (N,), the cues (N, C) of each pair, and whether the mean features (N,) are near enough.
    """
    rows = np.flatnonzero(~regions.inside[:, region].any(axis=1))
    own, others = measured(trees, region[None]), regions.some(rows)
    return rows, pair_cues(trees, own, others), np.linalg.norm(others.mean - own.mean, axis=1) < RANDOM


def pair_cues(trees: Trees, own: Regions, others: Regions) -> Float64:
    """Return the cues (N, C) of the pairs of one region `own` and N `others`, in the order of `CUES`.

    - area, border, thickness, width, length, reach, contrast: how much the measures of the regions differ, as absolute
      logarithms of their ratios. Thickness, width and length are the three extents.
    - features: distance of the mean features, in units of the mean contrast of both regions.
    - touching: whether the regions are neighbors.
    - size, clear: logarithms of the area and the contrast of `own`.
    """
    floor, count = trees.patches.spacing, len(others.area)
    measures = [
        (others.area, own.area, TINY),
        (others.border, own.border, floor),
        *((others.extents[:, axis], own.extents[:, axis], floor) for axis in range(3)),
        (others.reach, own.reach, floor),
        (others.contrast, own.contrast, CLEAR),
    ]
    apart = np.linalg.norm(others.mean - own.mean, axis=1) / ((others.contrast + own.contrast) / 2 + CLEAR)
    around = trees.around(own.inside[0])
    cues = [np.abs(np.log((other + least) / (one + least))) for other, one, least in measures]
    cues += [
        apart,
        others.inside[:, around].any(axis=1).astype(np.float64),
        *(np.full(count, float(np.log(value[0] + CLEAR))) for value in (own.area, own.contrast)),
    ]
    return np.stack(cues, axis=1)


@cache
def _weights() -> tuple[float, Float64]:
    stored = json.loads(files("dfd.segmentation").joinpath("alike_weights.json").read_text("utf-8"))
    return stored["constant"], np.array([stored["weights"][name] for name in CUES])
