"""The sets of regions that a place holds at its levels: a part, and the regions that follow it.

Level 0 is the part of `choose.ladder` with its followers. Each larger set contains the set below it, component by
component, and each smaller set lies inside the set above it. So a higher level never moves less.
"""

from collections.abc import Sequence

import numpy as np

from dfd.common.linear_algebra import Bool
from dfd.segmentation.alike import Alike
from dfd.segmentation.follow import Follow


def components_at(alike: Alike, regions: Sequence[Bool], middle: int, level: int, follow: Follow) -> list[Bool]:
    """Return the components (P,) of the set at a level; the first is the component at the place.

    `regions` are the parts at the place from small to large, each (P,), and `middle` is the index of that of level 0.
    """
    current = [regions[middle], *(each.region for each in alike.followers(regions[middle], follow))]
    for step in range(1, abs(level) + 1):
        if level > 0:
            current = _larger(alike, current, regions[middle + step], follow)
        else:
            current = _smaller(alike, current, regions[middle - step], follow)
    return current


def _larger(alike: Alike, current: list[Bool], region: Bool, follow: Follow) -> list[Bool]:
    """Return `region` (P,) and its followers, so that they contain the components `current`.

    A component that no follower contains grows to a region around it that looks like `region`, or stays as it is.
    """
    found, taken = [region], region.copy()
    for each in alike.followers(region, follow):
        if not any(_cuts(each.region, component) for component in current):
            found.append(each.region)
            taken |= each.region
    for component in current[1:]:
        left = component & ~taken
        if not left.any():
            continue
        if np.array_equal(left, component):
            found.append(alike.grown(component, region, taken))
            taken |= found[-1]
        else:  # a region contains a part of this component: the rest joins that region
            largest = int(np.argmax([(each & component).sum() for each in found]))
            found[largest] = found[largest] | left
            taken |= left
    return found


def _smaller(alike: Alike, current: list[Bool], region: Bool, follow: Follow) -> list[Bool]:
    """Return `region` (P,) and its followers inside the components `current`, each inside one of them."""
    inside = np.any(current, axis=0)
    found = [each.region for each in alike.followers(region, follow, inside)]
    return [region, *(each for each in found if not any(_cuts(component, each) for component in current))]


def _cuts(one: Bool, other: Bool) -> bool:
    """Return whether `one` (P,) contains some patches of `other` (P,), but not all."""
    common = one & other
    return bool(common.any()) and not np.array_equal(common, other)
