"""How far a handle reaches in feature space when nobody says so."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.errors import ArgumentError

# A gap is what a tenth more vertices take: as many vertices as a part has tell how wide a gap behind it is.
MORE = 1.1
# Nearer than that lie differences within one part, farther away hardly anything that a person would call alike.
NEAREST, FARTHEST = 0.35, 0.9
# Fewer vertices than this part of all are noise around the handle itself.
FEWEST = 0.005


def auto_reach(distances: ArrayLike) -> float:
    """The reach that ends at the largest gap of a handle's sorted feature distances.

    From each vertex in the order of distance to the one after a tenth more of them, the gap is the distance between the
    two over their mean; the reach is the middle of the largest whose middle lies in [0.35, 0.9].

    Parameters
    ----------
    distances
        (V,) feature distances of the vertices from the handle, at least 0.

    Returns
    -------
    A number in [0.35, 0.9], or 1, the paper's reach, where no gap lies there.

    Raises ValueError if `distances` has another shape, or one of them is negative or not finite.
    """
    values = check.array("auto_reach", "distances", distances, ("V",), dtype=np.float64)
    if (values < 0).any():
        raise ArgumentError("distances", f"must be at least 0, got {values.min():g}", "auto_reach")
    ordered = np.sort(values)
    last = len(ordered) - 1
    first = max(1, round(FEWEST * len(ordered)))
    if last / MORE <= first:
        return 1.0
    near = np.unique(np.geomspace(first, last / MORE, 400).astype(np.int64))
    far = np.minimum((MORE * near).astype(np.int64) + 1, last)
    middle = (ordered[near] + ordered[far]) / 2
    inside = (middle >= NEAREST) & (middle <= FARTHEST)
    if not inside.any():
        return 1.0
    gap = np.where(inside, (ordered[far] - ordered[near]) / np.maximum(middle, NEAREST), -1.0)
    return float(middle[gap.argmax()]) if gap.max() > 0 else 1.0
