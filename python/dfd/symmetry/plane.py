"""The mirror plane: where it lies, what it makes of points, and how alike its two sides look."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64

# Loads SciPy, which the command line's help does without.
if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

# Half width of the band in which a symmetric edit passes from one side to the other, as a part of the longest side.
# Wide enough that no crease shows, narrow enough that what is mirrored stays on its own side.
DEFAULT_BAND = 0.03
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class SymmetryPlane:
    """The plane {p : normal · p = offset} in mesh units, and how alike its two sides look."""

    normal: tuple[float, float, float]  #: (3,) unit vector
    offset: float  #: Signed distance from the origin along `normal`, mesh units
    #: Mean of ‖Φ(v) − Φ(R v)‖ over the vertices, the quantity that the paper compares with ε; 0 is perfect
    score: float = 0.0
    #: How much features change across the plane over how much they usually do between points so far
    #: apart, over the best four fifths of the surface's points that the mirror moves: a part without its like counts
    #: little. 0 is perfect, 1 no better than chance
    relative_score: float = 0.0
    #: Half width, mesh units, over which a mirrored deformation passes from one side to the other; 0 switches at
    #: the plane, as Eq. 8 does
    band: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a plane that is none."""
        normal = check.array("SymmetryPlane", "normal", self.normal, (3,), dtype=np.float64)
        if abs(np.linalg.norm(normal) - 1.0) > 1e-6:
            raise ArgumentError("normal", f"must have length 1, got {np.linalg.norm(normal):g}", "SymmetryPlane")
        object.__setattr__(self, "normal", tuple(float(x) for x in normal))
        object.__setattr__(self, "offset", check.number("SymmetryPlane", "offset", self.offset))
        object.__setattr__(self, "band", check.number("SymmetryPlane", "band", self.band, minimum=0.0))

    @property
    def reflection(self) -> Float64:
        """(4, 4) R of Eq. 8: it takes points to their mirror images."""
        normal = np.asarray(self.normal)
        matrix = np.eye(4)
        matrix[:3, :3] -= 2.0 * np.outer(normal, normal)
        matrix[:3, 3] = 2.0 * self.offset * normal
        return matrix

    def signed_distance(self, points: ArrayLike) -> Float64:
        """Distance of (N, 3) points from the plane, (N,), mesh units; positive where the normal points."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        return array @ np.asarray(self.normal) - self.offset

    def reflect(self, points: ArrayLike) -> Float64:
        """Mirror images R p of (N, 3) points, (N, 3), mesh units."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        return array - 2.0 * self.signed_distance(array)[:, None] * np.asarray(self.normal)


def axis_name(normal: Sequence[float]) -> str:
    """The axis, "x", "y" or "z", that a plane's `normal` (3,) lies along, or lies nearest to."""
    return list(AXES)[int(np.argmax(np.abs(normal)))]


def axis_plane(mesh: Mesh, axis: str, *, band: float = 0.0) -> SymmetryPlane:
    """The plane across `axis` ("x", "y" or "z") through the center of the bounding box of `mesh`."""
    if axis not in AXES:
        raise ArgumentError("axis", f"must be x, y or z, got {axis!r}", "axis_plane")
    center = np.asarray(mesh.bounds, np.float64).mean(axis=0)
    return SymmetryPlane(AXES[axis], float(center @ np.asarray(AXES[axis])), band=band)


def plane_from_text(text: str, mesh: Mesh) -> SymmetryPlane:
    """Read a plane as people write it; its band is 3 % of the longest side of `mesh`.

    "x", "y" or "z" is across this axis through the center of the bounding box of `mesh`, "x=0.1" across it at this
    coordinate, mesh units, "0.6,0,0.8=0.1" across this direction, of any length, at this distance from the origin.

    Raises ValueError if `text` says none of these, a number is not finite or the direction has no length.
    """
    band = DEFAULT_BAND * float(np.max(mesh.extents))
    name, equals, value = (part.strip() for part in text.partition("="))
    if name in AXES and not equals:
        return axis_plane(mesh, name, band=band)
    try:
        offset = float(value)
        direction = AXES[name] if name in AXES else tuple(float(part) for part in name.split(","))
    except ValueError:
        direction, offset = (), 0.0
    if len(direction) != 3:
        raise ArgumentError("text", f"must be like x, x=0.1 or 0.6,0,0.8=0.1, got {text!r}", "plane_from_text")
    length = math.hypot(*direction)
    if not (math.isfinite(length) and math.isfinite(offset)):
        raise ArgumentError("text", f"must have finite numbers, got {text!r}", "plane_from_text")
    if length == 0:
        raise ArgumentError("text", f"must name a direction that has a length, got {text!r}", "plane_from_text")
    return SymmetryPlane((direction[0] / length, direction[1] / length, direction[2] / length), offset, band=band)


def plane_text(plane: SymmetryPlane) -> str:
    """Write a plane so that people and `plane_from_text` can read it."""
    for axis, normal in AXES.items():
        along = float(np.dot(plane.normal, normal))
        if abs(along) > 1 - 1e-12:
            return f"{axis}={math.copysign(1, along) * plane.offset + 0.0:.6g}"
    return f"{','.join(f'{part:.6g}' for part in plane.normal)}={plane.offset:.6g}"
