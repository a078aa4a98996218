"""The sets of regions that a place holds at its levels: a part, and the regions that follow it.

Level 0 is the part of `choose.ladder` with its followers. Each larger set contains the set below it, component by
component, and each smaller set lies inside the set above it. So a higher level never moves less.
"""

from collections.abc import Sequence

import numpy as np

from dfd.common.linear_algebra import Bool
from dfd.segmentation.alike import Alike
from dfd.segmentation.border import snapped
from dfd.segmentation.follow import Follow


class Ladder:
    """The sets at the levels of one place. Each is computed once, from that of the next level nearer to 0."""

    def __init__(self, alike: Alike, regions: Sequence[Bool], middle: int, clear: bool = True) -> None:
        """Store the parts `regions`, from small to large, each (P,), of which number `middle` is that of level 0.

        `clear` says whether a part at the place has a clear border.
        """
        self.lowest, self.highest, self.clear = -middle, len(regions) - 1 - middle, clear
        self._alike, self._regions, self._middle = alike, regions, middle
        self._sets: dict[tuple[int, Follow], list[Bool]] = {}
        self._sides: tuple[tuple[Follow, int], dict[int, Bool]] | None = None

    def region(self, level: int) -> Bool:
        """Return the part (P,) at a level. A level beyond the lowest or the highest one stands for that level."""
        return self._regions[self._middle + self._within(level)]

    def components(self, level: int, follow: Follow) -> list[Bool]:
        """Return the components (P,) of the set at a level; the first is the component at the place."""
        level = self._within(level)
        if (level, follow) not in self._sets:
            region = self.region(level)
            if level == 0:
                found = [region, *(each.region for each in self._alike.followers(region, follow))]
            else:
                grow, nearer = (_larger, level - 1) if level > 0 else (_smaller, level + 1)
                found = grow(self._alike, self.components(nearer, follow), region, follow)
            self._sets[level, follow] = found
        return self._sets[level, follow]

    def side(self, level: int, follow: Follow, place: int) -> Bool:
        """Return the places (M,) of the set at a level, which contains `place` unless it is negative.

        The border is moved to creases nearby. Moved borders of neighboring levels do not cross.
        """
        level = self._within(level)
        if self._sides is None or self._sides[0] != (follow, place):
            self._sides = (follow, place), {}
        known = self._sides[1]
        if level not in known:
            inside: Bool = np.any(self.components(level, follow), axis=0)
            side = snapped(self._alike.trees.patches, inside, place if place >= 0 else None)
            if level:
                nearer = self.side(level - int(np.sign(level)), follow, place)
                side = side | nearer if level > 0 else side & nearer
            known[level] = side
        return known[level]

    def _within(self, level: int) -> int:
        return min(max(level, self.lowest), self.highest)


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
