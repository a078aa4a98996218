"""Normalization of a shape: a map of its bounding box into the cube [−1, 1]³."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh


class Normalization(NamedTuple):
    """The map of a shape into the cube [−1, 1]³: subtract `center`, multiply by `scale`."""

    center: Float64  # (3,) center of the bounding box, in the shape's units
    scale: float  # 2 divided by the longest side of the bounding box

    def apply(self, points: NDArray[np.floating]) -> Float64:
        """Map points (…, 3) from the shape's units to the cube."""
        return (points - self.center) * self.scale

    def invert(self, points: NDArray[np.floating]) -> Float64:
        """Map points (…, 3) from the cube to the shape's units."""
        return points / self.scale + self.center


def box_normalization(low: Float64, high: Float64) -> Normalization | None:
    """Return the map of a box into [−1, 1]³; the box's longest side gets the length 2. Return None for a single point.

    `low` and `high` are opposite corners (3,) of the box.
    """
    low, high = low / 2, high / 2  # halved before they are added, so that the sum does not overflow
    half = float(np.max(high - low))
    return None if half < np.finfo(np.float64).tiny else Normalization(low + high, 1.0 / half)


def normalization(mesh: Mesh) -> Normalization:
    """Return the map of the bounding box of `mesh` into [−1, 1]³; the box's longest side gets the length 2.

    Raises ValueError if all vertices have the same position.
    """
    found = box_normalization(*mesh.bounds)
    if found is None:
        raise ValueError("`mesh` must have some extent, got all vertices at one point")
    return found
