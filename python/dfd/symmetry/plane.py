"""The mirror plane: where it lies, what it makes of points, and how alike its two sides look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["AXES", "SymmetryPlane", "axis_name", "axis_plane"]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class SymmetryPlane:
    """The plane {p : normal · p = offset} in mesh units, and how alike its two sides look.

    Attributes
    ----------
    normal
        (3,) unit vector.
    offset
        Signed distance from the origin along `normal`, mesh units.
    score
        Mean of ‖Φ(v) − Φ(R v)‖ over the vertices, the quantity that the paper compares with ε; 0 is perfect.
    relative_score
        `score` over the mean distance of two arbitrary vertices' features; 1 is no better than chance.
    band
        Half width, mesh units, over which a mirrored deformation passes from one side to the other; 0 switches at
        the plane, as Eq. 8 does.
    """

    normal: tuple[float, float, float]
    offset: float
    score: float = 0.0
    relative_score: float = 0.0
    band: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a plane that is none."""
        normal = check.array("SymmetryPlane", "normal", self.normal, (3,), dtype=np.float64)
        if abs(np.linalg.norm(normal) - 1.0) > 1e-6:
            raise ValueError(f"SymmetryPlane: `normal` must have length 1, got {np.linalg.norm(normal):g}")
        object.__setattr__(self, "normal", tuple(float(x) for x in normal))
        object.__setattr__(self, "offset", check.number("SymmetryPlane", "offset", self.offset))
        object.__setattr__(self, "band", check.number("SymmetryPlane", "band", self.band, minimum=0.0))

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Distance of (N, 3) points from the plane, (N,), mesh units; positive where the normal points."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        distance: NDArray[np.float64] = array @ np.asarray(self.normal) - self.offset
        return distance

    def reflect(self, points: ArrayLike) -> NDArray[np.float64]:
        """Mirror images R p of (N, 3) points, (N, 3), mesh units."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        image: NDArray[np.float64] = array - 2.0 * self.signed_distance(array)[:, None] * np.asarray(self.normal)
        return image

    def matrix(self) -> NDArray[np.float64]:
        """R as a (3, 4) affine matrix in mesh units."""
        normal = np.asarray(self.normal)
        return np.column_stack([np.eye(3) - 2.0 * np.outer(normal, normal), 2.0 * self.offset * normal])


def axis_name(normal: Sequence[float]) -> str:
    """The axis, "x", "y" or "z", that a plane's `normal` (3,) lies along, or lies nearest to."""
    return list(AXES)[int(np.argmax(np.abs(normal)))]


def axis_plane(mesh: Mesh, axis: str, *, band: float = 0.0) -> SymmetryPlane:
    """The plane across `axis` ("x", "y" or "z") through the centre of the bounding box of `mesh`."""
    if axis not in AXES:
        raise ValueError(f"axis_plane: `axis` must be x, y or z, got {axis!r}")
    center = np.asarray(mesh.bounds, np.float64).mean(axis=0)
    return SymmetryPlane(AXES[axis], float(center @ np.asarray(AXES[axis])), band=band)
