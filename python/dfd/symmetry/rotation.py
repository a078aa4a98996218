"""Rotational symmetry: turns about an axis by which a shape comes to look like itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64
from dfd.field.field import Field
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.symmetry.evidence import SurfaceFeatures, gather
from dfd.symmetry.registration import registered

LARGEST_ORDER = 12
THRESHOLD = 0.25  # of `relative_score`, as for planes
_LANDED = 0.6  # share of the turned surface that has to lie on the surface
_NO_WORSE, _FIT_LEAVES = 1.5, 0.02  # a higher order may be so much less alike than the best, and is preferred
_SAME_AXIS = np.cos(np.radians(10.0))


@dataclass(frozen=True)
class RotationalSymmetry:
    """Turns by multiples of 360° / `order` about an axis, and how alike a shape looks after one."""

    axis: tuple[float, float, float]  #: (3,) unit vector
    point: tuple[float, float, float]  #: (3,) a point on the axis, mesh units
    order: int  #: How many turns make a full one, at least 2
    #: Mean of ‖Φ(p) − Φ(T p)‖ over points of the surface, for the turn T by 360° / `order`; 0 is perfect
    score: float = 0.0
    #: How much features change over how much they usually do between points so far apart, over the best
    #: four fifths of the surface's points that the turn moves; 0 is perfect, 1 no better than chance
    relative_score: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no axis, and an order below 2."""
        axis = check.array("RotationalSymmetry", "axis", self.axis, (3,), dtype=np.float64)
        if abs(np.linalg.norm(axis) - 1.0) > 1e-6:
            raise ArgumentError("axis", f"must have length 1, got {np.linalg.norm(axis):g}", "RotationalSymmetry")
        point = check.array("RotationalSymmetry", "point", self.point, (3,), dtype=np.float64)
        object.__setattr__(self, "axis", tuple(float(x) for x in axis))
        object.__setattr__(self, "point", tuple(float(x) for x in point))
        object.__setattr__(self, "order", check.whole("RotationalSymmetry", "order", self.order, minimum=2))

    @property
    def transforms(self) -> Float64:
        """The turns by 0, 1, … `order` − 1 steps as affine matrices, (order, 3, 4), mesh units."""
        steps = np.arange(self.order) * (2 * np.pi / self.order)
        turns = Rotation.from_rotvec(steps[:, None] * np.asarray(self.axis)).as_matrix()
        point = np.asarray(self.point)
        return np.concatenate([turns, (point - turns @ point)[:, :, None]], axis=2)

    def rotate(self, points: ArrayLike, steps: int = 1) -> Float64:
        """Turn (N, 3) points by `steps` · 360° / `order`, (N, 3), mesh units."""
        array = check.array("RotationalSymmetry", "points", points, ("N", 3), dtype=np.float64)
        matrix = self.transforms[steps % self.order]
        return array @ matrix[:, :3].T + matrix[:, 3]


def rotational_symmetries(field: Field, mesh: MeshLike, *, threshold: float = THRESHOLD) -> list[RotationalSymmetry]:
    """Find the axes about which `mesh` looks alike after a turn of 360° / n, n from 2 to 12.

    Principal axes and axes of the coordinates through the middle of the surface are moved to where the turned surface
    lies best on the surface. Of the orders of one axis the highest is given that is hardly less alike than the best:
    a shape of order 4 is one of order 2 as well.

    Symmetries with a `relative_score` of at most `threshold` are found, one for each axis, the most alike first.

    Raises ValueError if `field` is not one, or `threshold` is negative or not finite.
    """
    check.field("rotational_symmetries", field)
    threshold = check.number("rotational_symmetries", "threshold", threshold, minimum=0.0)
    evidence = gather(field, as_mesh(mesh))
    if evidence is None:
        return []
    judged = [_best_order(evidence, axis, point, threshold) for axis, point in _axes(evidence.points)]
    found: list[RotationalSymmetry] = []
    for symmetry in sorted(filter(None, judged), key=lambda symmetry: symmetry.relative_score):
        if not any(abs(np.dot(symmetry.axis, other.axis)) > _SAME_AXIS for other in found):
            found.append(symmetry)
    return found


def _axes(points: Float64) -> list[tuple[Float64, Float64]]:
    """Return unit axes (3,) to try and a point (3,) on each: none twice, those of the coordinates first."""
    middle = points.mean(axis=0)
    principal = np.linalg.svd(points - middle, full_matrices=False)[2] if len(points) >= 3 else np.eye(3)
    axes: list[Float64] = []
    for axis in [*np.eye(3), *principal]:
        if not any(abs(axis @ other) > _SAME_AXIS for other in axes):
            axes.append(axis)
    return [(axis, middle) for axis in axes]


def _best_order(
    evidence: SurfaceFeatures, axis: Float64, point: Float64, threshold: float
) -> RotationalSymmetry | None:
    """Return the symmetry of the highest order about an axis that is hardly worse than the best."""
    judged = []
    for order in range(2, LARGEST_ORDER + 1):
        moved = _refined(evidence, axis, point, order)
        images = _turned(evidence.points, *moved, order)
        off = evidence.tree.query(images)[0]
        if (off < 3 * evidence.spacing).mean() < _LANDED:
            continue
        dissimilarity, landed = evidence.dissimilarity(images)
        if landed >= _LANDED and dissimilarity <= threshold:
            judged.append((dissimilarity, order, moved))
    if not judged:
        return None
    most = _NO_WORSE * min(judged)[0] + _FIT_LEAVES
    dissimilarity, order, (axis, point) = max((each for each in judged if each[0] <= most), key=lambda each: each[1])
    return _symmetry(evidence, axis, point, order, dissimilarity)


def _refined(evidence: SurfaceFeatures, axis: Float64, point: Float64, order: int) -> tuple[Float64, Float64]:
    """Return the axis nearby, and a point on it, about which the turned surface lies best on the surface."""
    across = np.linalg.svd(axis[None])[2][1:]  # (2, 3) unit

    def varied(change: Float64) -> tuple[Float64, Float64]:
        leaning = axis + change[:2] @ across
        return leaning / np.linalg.norm(leaning), point + change[2:] @ across

    return varied(registered(evidence, lambda change: lambda points: _turned(points, *varied(change), order), 4))


def _turned(points: Float64, axis: Float64, point: Float64, order: int) -> Float64:
    """Return points (N, 3) turned by 360° / `order`."""
    turn = Rotation.from_rotvec(2 * np.pi / order * axis).as_matrix()
    return (points - point) @ turn.T + point


def _symmetry(
    evidence: SurfaceFeatures, axis: Float64, point: Float64, order: int, dissimilarity: float
) -> RotationalSymmetry:
    """Return the symmetry in mesh units, the largest component of its axis positive, with its score."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))]) + 0.0
    changed = evidence.features - evidence.features_at(_turned(evidence.points, axis, point, order))
    score = float(np.linalg.norm(changed, axis=1).mean())
    place = point * evidence.half + evidence.center
    return RotationalSymmetry(
        (float(axis[0]), float(axis[1]), float(axis[2])),
        (float(place[0]), float(place[1]), float(place[2])),
        order,
        score,
        dissimilarity,
    )
