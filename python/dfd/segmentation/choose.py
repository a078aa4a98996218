"""Choose the part that a person means at a place, and its ladder of smaller and larger parts.

A candidate is a connected region at the place: the component of a tree node, alone or with the regions that only it
connects to the rest of the shape (`closed`). Five cues say how well its border separates it from its surroundings. A
softmax of a linear function of these cues gives the probability that a person means the candidate; all trees count
equally. The weights of the cues are learned (`bench.training.learn_parts`). The part is the candidate with the largest
expected IoU (intersection over union of areas) with the part that the person means. The things of the file (components,
objects and materials) are candidates, too. The next smaller and the next larger one are the levels beside the part.
"""

import json
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.segmentation.patches import BRIDGE
from dfd.segmentation.trees import SMALLEST, Trees, mean_along

# Differences are of the IoU at level 0, unless another number is named, at 16 places of every sixth mesh of
# `bench.quality people`; there, it is 0.681, the best within one level 0.789, and sets (`bench.quality alike`) 0.697.
# LARGEST: largest area of a candidate, as a share of the surface. With 0.9: −0.015; with 0.999: +0.004, but −0.005
# within one level.
LARGEST = 0.97
CUES = ("area", "area²", "contrast", "concavity", "girth")
# Added to a cue before its logarithm is taken, so that noise near 0 does not count. With 0.1 for all: −0.011.
FLOORS = {"contrast": 0.1, "concavity": 0.02, "girth": 0.5}
# CLEAR: least mean strength (`Trees`) of a clear border; a border without any crease has 0.057. It is also the least
# contrast that counts in `alike`: with 0.05, sets are 0.014 smaller; with 0.2, 0.002 larger.
CLEAR = 0.1
# STEP: smallest ratio between the areas of parts at neighboring levels. Within one level, with 1.5: −0.003; with 1.1:
# +0.001, but in more steps.
STEP = 1.25


class Candidates(NamedTuple):
    """The candidates at a patch, from small to large, and whether one of them has a clear border."""

    regions: Bool  # (K, P) the patches of each candidate
    nodes: Int64  # (K,) the tree node from which each candidate comes
    cues: Float64  # (K, 5) the cues, in the order of `CUES`
    votes: Int64  # (K,) number of trees that have the node from which each candidate comes
    own: Bool  # (K,) whether the candidate is a thing of the file
    clear: bool

    def overlaps(self, area: Float64) -> Float64:
        """Return the IoU (K, K) of all pairs of candidates. `area` (P,) are the areas of the patches."""
        common = (self.regions * area) @ self.regions.T.astype(np.float64)
        own = common.diagonal()
        return np.asarray(common / (own[:, None] + own - common), np.float64)


def candidates(trees: Trees, patch: int) -> Candidates:
    """Return the candidates at a patch. If no region has a suitable area, the only candidate is the whole shape."""
    area, found, own = trees.patches.area, dict[bytes, tuple[int, Bool]](), set[bytes]()
    nodes = np.flatnonzero(trees.inside[:, patch])
    for node in nodes[np.argsort(trees.areas[nodes], kind="stable")].tolist():
        region = component_at(trees, trees.inside[node], patch)
        if trees.own[node] and area @ region <= LARGEST:  # of several things, the largest has most counterparts
            own.add(region.tobytes())
            found[region.tobytes()] = node, region
        for each in (region, closed(trees, region)):
            if SMALLEST <= area @ each <= LARGEST:
                found.setdefault(each.tobytes(), (node, each))
    if not found:
        one = np.ones(1, np.int64)
        return Candidates(np.ones((1, len(area)), bool), nodes[:1], np.zeros((1, len(CUES))), one, one == 0, False)
    rows = np.array([cues(trees, region) for _, region in found.values()])
    nodes, regions = np.array([node for node, _ in found.values()]), np.array([each for _, each in found.values()])
    order = np.argsort(regions @ area, kind="stable")
    clear = any(trees.boundary(region) > CLEAR for region in regions)
    things = np.array([key in own for key in found])[order]
    return Candidates(regions[order], nodes[order], rows[order], trees.votes[nodes[order]], things, clear)


def cues(trees: Trees, region: Bool) -> list[float]:
    """Return the cues of a candidate (P,), in the order of `CUES`.

    - area: logarithm of the candidate's share of the surface; area² is its square.
    - contrast: distance of the mean features of the candidate from those of the patches around it.
    - concavity: mean concavity along the border. Parts of animals and things meet in creases (Hoffman and Richards,
      "Parts of recognition", 1984).
    - girth: logarithm of the border's length, in sides of a square with the area of the candidate.
    """
    patches = trees.patches
    crossing, length = trees.crossing(region)
    share = float(patches.area @ region)
    values = {
        "contrast": trees.contrast(region),
        "concavity": mean_along(patches.borders.concavity[crossing].clip(0.0, 1.0), length, BRIDGE),
        "girth": float(length.sum() / np.sqrt(share)),
    }
    size = float(np.log(share))
    return [size, size * size, *(float(np.log(values[name] + FLOORS[name])) for name in CUES[2:])]


def probabilities(found: Candidates) -> Float64:
    """Return the probability (K,) that a person means each candidate. A region that n trees have counts n times."""
    likely = found.votes * np.exp(found.cues @ _weights())
    return np.asarray(likely / likely.sum(), np.float64)


@cache
def _weights() -> Float64:
    stored = json.loads(files("dfd.segmentation").joinpath("part_weights.json").read_text("utf-8"))
    return np.array([stored["weights"][name] for name in CUES])


def ladder(found: Candidates, area: Float64) -> tuple[list[int], int]:
    """Return the candidates at all levels, from small to large, and the position of level 0 among them.

    Level 0 has the largest expected IoU with the part that the person means, or is the thing of the file that is nearly
    the same. Level 1 is the smallest thing that contains it, if there is one. Otherwise, each next larger level adds
    most to the expected IoU of the best level so far, among candidates that contain the last one. Smaller levels are
    alike.
    """
    likely, overlaps = probabilities(found), found.overlaps(area)
    share = found.regions @ area
    best = int((overlaps @ likely).argmax())
    thing = int(np.where(found.own, overlaps[best], 0.0).argmax())
    if found.own[thing] and overlaps[best, thing] > 1 / STEP:
        best = thing
    smaller, larger = (_further(found, likely, overlaps, share, best, larger=larger) for larger in (False, True))
    return [*reversed(smaller), best, *larger], len(smaller)


def _further(
    found: Candidates, likely: Float64, overlaps: Float64, share: Float64, best: int, *, larger: bool
) -> list[int]:
    """Return the candidates at the levels beyond `best`, the candidate of level 0, in one direction."""
    levels, covered = [best], overlaps[best]
    while True:
        here = levels[-1]
        inner, outer = (here, slice(None)) if larger else (slice(None), here)
        nested = ~(found.regions[inner] & ~found.regions[outer]).any(axis=1)
        ratio = share / share[here] if larger else share[here] / share
        further = np.flatnonzero(nested & (ratio >= STEP))
        if len(further) == 0:
            return levels[1:]
        things = further[found.own[further]] if here == best else further[:0]
        gain = np.maximum(overlaps[further], covered) @ likely
        levels.append(int(things[ratio[things].argmin()] if len(things) else further[gain.argmax()]))
        covered = np.maximum(covered, overlaps[levels[-1]])


def component_at(trees: Trees, inside: Bool, patch: int) -> Bool:
    """Return the connected component of the patches `inside` (P,) that contains a patch, (P,) bool."""
    label = trees.labels(inside)
    return np.asarray(label == label[patch])


def closed(trees: Trees, inside: Bool) -> Bool:
    """Return the patches of a part and of all regions that only this part connects to the body, (P,) bool.

    An example is the hoof of a leg. `inside` (P,) is True for the patches of the part. The body is the largest
    component of the surface outside the part. If the body has less than half of that surface, `inside` is returned.
    """
    label = trees.labels(~inside)
    areas = np.bincount(label, np.where(inside, 0.0, trees.patches.area))
    return inside if areas.max() <= areas.sum() / 2 else np.asarray(label != areas.argmax())
