"""Find the regions of a shape that look like a part: its mirror images, and regions of similar features and size."""

import numpy as np

from dfd.common.linear_algebra import Bool, Float64
from dfd.segmentation.choose import CLEAR, closed
from dfd.segmentation.patches import TINY
from dfd.segmentation.trees import Trees

MOST = 64  # largest number of components of a part, because each needs a column of weights
# Two regions are alike if their squared distance is below 1. It adds the squares of the distance between their mean
# features, in units of APART times the distance between the part and the patches around it, and of the logarithms of
# six ratios, in units of log(SIMILAR): of the areas, of the lengths of the borders, of their strengths, and of the
# three extents.
APART, SIMILAR = 1.5, 2.0
RANDOM = 2**0.5  # regions never look alike if their features differ as much as those of two random points


def alike(trees: Trees, node: int, region: Bool) -> list[Bool]:
    """Return the components (P,) of a part: `region` (P,), its mirror images, and other regions that look like it.

    `region` is a component of the tree node `node`, alone or closed. No two components overlap.
    """
    patches, core = trees.patches, region & trees.inside[node]
    whole = bool((region & ~core).any())
    found, taken = [region], region.copy()

    def take(component: Bool) -> None:
        grown = closed(trees, component) if whole else component
        if len(found) < MOST and not (grown & taken).any():
            found.append(grown)
            taken[:] |= grown

    own, images = _measures(trees, core), np.isin(patches.orbit, patches.orbit[core])
    for component in trees.components(trees.inside[node] & ~core):
        mirrored = patches.area @ (component & images) > patches.area @ component / 2
        if mirrored or _apart(own, _measures(trees, component)) < 1:
            take(component)
    if trees.boundary(core) > CLEAR:  # regions without a clear border resemble each other everywhere
        for component in _resembling(trees, core, own, taken):
            take(component)
    return found


def _resembling(trees: Trees, core: Bool, own: Float64, taken: Bool) -> list[Bool]:
    """Return the components (P,) of tree nodes outside `taken` that look like `core` (P,), the most similar first.

    `own` are the `_measures` of `core`.
    """
    around, apart = trees.around(core), np.linalg.norm(trees.means - trees.mean(core), axis=1)
    looks = np.square(apart / max(APART * trees.contrast(core), TINY))
    near = (looks < 1) & (apart < RANDOM) & (trees.areas >= trees.patches.area @ core / SIMILAR)
    near &= ~(trees.inside & (taken | around)).any(axis=1)  # what touches the part is beside it, and no counterpart
    found: list[tuple[float, int, Bool]] = []
    for node in np.flatnonzero(near).tolist():
        for component in trees.components(trees.inside[node]):
            total = float(looks[node]) + _apart(own, _measures(trees, component))
            if total < 1:
                found.append((total, node, component))
    return [component for *_, component in sorted(found, key=lambda each: each[:2])]


def _measures(trees: Trees, region: Bool) -> Float64:
    """Return the logarithms (6,) of a region's area, its border's length and strength, and its principal extents."""
    patches, length = trees.patches, trees.crossing(region)[1].sum()
    area, center = patches.area[region], patches.center[region]
    apart = center - area @ center / area.sum()
    extents = np.sqrt(np.linalg.eigvalsh((apart * area[:, None]).T @ apart / area.sum()).clip(0.0))
    return np.log(np.array([area.sum(), length, trees.boundary(region) + CLEAR, *(extents + patches.spacing)]) + TINY)


def _apart(one: Float64, other: Float64) -> float:
    """Return the squared distance of the `_measures` of two regions."""
    return float(np.square((one - other) / np.log(SIMILAR)).sum())
