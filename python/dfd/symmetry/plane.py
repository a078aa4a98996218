"""Define the mirror plane `SymmetryPlane`, which reflects points, and convert it from and to text."""

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

if TYPE_CHECKING:  # `dfd.mesh.mesh` imports SciPy, which the help of the command line does not need
    from dfd.mesh.mesh import Mesh

# Half of the width of the band in which the deformations of both sides are blended, as a fraction of the bounding box's
# longest side. A narrower band shows a crease. In a wider band, too much of each side gets the other's deformation.
DEFAULT_BAND = 0.03
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class SymmetryPlane:
    """The mirror plane {p : normal · p = offset} in mesh units, and the similarity of its two sides."""

    normal: tuple[float, float, float]  #: (3,) unit vector
    offset: float  #: Signed distance from the origin along `normal`, in mesh units
    #: Mean of ‖Φ(v) − Φ(R v)‖ over the vertices v, for the field Φ and the reflection R. 0 is perfect; in the paper,
    #: the score of a mirror plane is below a threshold ε
    score: float = 0.0
    #: Mean feature distance between surface samples and their mirror images, divided by the usual feature distance of
    #: samples that far apart. 0 is perfect, and chance gives about 1. Only the best 80 % of the moved samples count
    relative_score: float = 0.0
    #: Half of the width, in mesh units, of the band in which the deformations of both sides are blended. If it is 0,
    #: the deformations meet at the plane without a blend, as in Eq. 8
    band: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError if the normal is not a unit vector, or a number is not finite or too large."""
        normal = check.array("SymmetryPlane", "normal", self.normal, (3,), dtype=np.float64)
        length = math.hypot(*normal)
        if abs(length - 1.0) > 1e-6:
            raise ArgumentError("normal", f"must have length 1, got {length:g}", "SymmetryPlane")
        object.__setattr__(self, "normal", tuple(float(x) for x in normal))
        for name, least in (("offset", -check.LARGEST), ("band", 0.0)):
            number = check.number("SymmetryPlane", name, getattr(self, name), minimum=least, maximum=check.LARGEST)
            object.__setattr__(self, name, number)

    @property
    def reflection(self) -> Float64:
        """Return the matrix (4, 4) R of Eq. 8, which maps points to their mirror images."""
        normal = np.asarray(self.normal)
        matrix = np.eye(4)
        matrix[:3, :3] -= 2.0 * np.outer(normal, normal)
        matrix[:3, 3] = 2.0 * self.offset * normal
        return matrix

    def signed_distance(self, points: ArrayLike) -> Float64:
        """Return the distances (N,) of `points` (N, 3) from the plane, in mesh units; above 0 on the normal's side."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        return array @ np.asarray(self.normal) - self.offset

    def reflect(self, points: ArrayLike) -> Float64:
        """Return the mirror images (N, 3) of `points` (N, 3), in mesh units."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        return array - 2.0 * self.signed_distance(array)[:, None] * np.asarray(self.normal)


def axis_name(normal: Sequence[float]) -> str:
    """Return the axis, "x", "y" or "z", whose direction is nearest to a plane's `normal` (3,)."""
    return list(AXES)[int(np.argmax(np.abs(normal)))]


def axis_plane(mesh: Mesh, axis: str, *, band: float = 0.0) -> SymmetryPlane:
    """Return the plane perpendicular to `axis` ("x", "y" or "z") through the center of the bounding box of `mesh`.

    Raises ValueError if `axis` is another word.
    """
    check.choice("axis_plane", "axis", axis, tuple(AXES))
    center = np.asarray(mesh.bounds, np.float64).mean(axis=0)
    return SymmetryPlane(AXES[axis], float(center @ np.asarray(AXES[axis])), band=band)


def plane_from_text(text: str, mesh: Mesh) -> SymmetryPlane:
    """Return the plane that `text` describes, with a `band` of 3 % of the longest side of the bounding box of `mesh`.

    "x", "y" or "z" is the plane perpendicular to this axis through the center of the bounding box of `mesh`. "x=0.1" is
    the plane x = 0.1 in mesh units. "0.6,0,0.8=0.1" has the normal (0.6, 0, 0.8), scaled to length 1, and offset 0.1.

    Raises ValueError if `text` has another form, a number is not finite, or the normal is 0.
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
        raise ArgumentError("text", f"must have the form x, x=0.1 or 0.6,0,0.8=0.1, got {text!r}", "plane_from_text")
    length = math.hypot(*direction)
    if not (math.isfinite(length) and math.isfinite(offset)):
        raise ArgumentError("text", f"must have finite numbers, got {text!r}", "plane_from_text")
    if length == 0:
        raise ArgumentError("text", f"must have a normal other than 0, got {text!r}", "plane_from_text")
    return SymmetryPlane((direction[0] / length, direction[1] / length, direction[2] / length), offset, band=band)


def plane_text(plane: SymmetryPlane) -> str:
    """Return `plane` as a text that `plane_from_text` reads."""
    for axis, normal in AXES.items():
        along = float(np.dot(plane.normal, normal))
        if abs(along) > 1 - 1e-12:
            return f"{axis}={math.copysign(1, along) * plane.offset + 0.0:.6g}"
    return f"{','.join(f'{part:.6g}' for part in plane.normal)}={plane.offset:.6g}"
