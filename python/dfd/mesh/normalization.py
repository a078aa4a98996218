"""Where the box around a shape lies and how long it is: what brings any shape to one size in one place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["box_normalization", "normalization"]


def box_normalization(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray[np.float64], float] | None:
    """Centre (3,) and factor that bring a box to [−1, 1] along its longest side; None where it is but a point.

    `low` and `high` are its corners (3,).
    """
    low, high = low / 2, high / 2  # halved before they meet, so that no sum overflows
    half = float(np.max(high - low))
    return None if half < np.finfo(np.float64).tiny else (low + high, 1.0 / half)


def normalization(mesh: Mesh) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and factor that bring the box of `mesh` to [−1, 1] along its longest side.

    Raises
    ------
    ValueError
        If all vertices are one point.
    """
    found = box_normalization(*mesh.bounds)
    if found is None:
        raise ValueError("render: `mesh` must have some extent, got all vertices at one point")
    return found
