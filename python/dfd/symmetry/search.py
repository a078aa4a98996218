"""Visual symmetry: planes across which a shape looks alike (paper, section 3.3.3)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.symmetry.evidence import SurfaceFeatures, gather
from dfd.symmetry.plane import AXES, DEFAULT_BAND, SymmetryPlane, axis_plane
from dfd.symmetry.plane_search import candidate_planes, mirrored, same_plane

_SCORED_VERTICES = 4_000  # evenly strided, stand for more: the standard error of the mean is below 1 %
_AT_ONCE = 50_000  # vertices whose features are in memory together
RELATIVE_THRESHOLD = 0.25
# Front and back of a figure that spreads its arms look much alike too, though far less than its two sides: a plane must
# not be more than this many times as unlike as the best one, give or take what the fit itself leaves.
WORSE_THAN_BEST, FIT_LEAVES = 3.0, 0.01
LANDED = 0.5  # share of the moved surface whose image lies on the surface
# A plane that leans by little against one that fits much better is that plane, badly found.
_LEANS, _BESIDE, _WORSE = np.radians(20.0), 0.25, 1.3
_SNAP_ANGLE, _SNAP_OFFSET, _SNAP_LOSS = np.radians(1.5), 0.012, 0.01


def symmetry_planes(
    field: Field,
    mesh: MeshLike,
    *,
    threshold: float | Literal["relative"] = "relative",
    candidates: Literal["any", "axes"] = "any",
) -> list[SymmetryPlane]:
    """Find the planes across which `mesh` looks alike.

    Planes between points that look alike, and across the principal axes and the axes of the coordinates, are moved to
    where the surface lies best on its mirror image. Nearly equal ones are merged, and one nearly across an axis of the
    coordinates becomes so where this costs nothing. A flat shape's own plane, whose mirror moves nothing, is none.

    Parameters
    ----------
    threshold
        The paper's ε, 0.1 there: planes are found by their `score` alone, if it is smaller. With "relative", those are
        found whose `relative_score` is below a quarter (the spread of the features, and with it a fair ε, depends on
        the encoder and its block), but none beside a plane across which the shape looks far more alike.
    candidates
        "any", or "axes": the paper's three planes across the axes through the center of the box.

    Returns
    -------
    The planes found, the most alike first, with a band of 3 % of the longest side; empty when there is none.

    Raises ValueError if `field` is not one, `threshold` is another word, negative or not finite, or `candidates` is
    another word.

    Source: paper, section 3.3.3; planes from pairs of points: Mitra, Guibas and Pauly, "Partial and approximate
    symmetry detection for 3D geometry", 2006.
    """
    check.field("symmetry_planes", field)
    mesh = as_mesh(mesh)
    if threshold != "relative":
        threshold = check.number("symmetry_planes", "threshold", threshold, minimum=0.0)
    if candidates not in ("any", "axes"):
        raise ArgumentError("candidates", f"must be any or axes, got {candidates!r}", "symmetry_planes")
    planes = scored_planes(field, mesh, candidates=candidates)
    if threshold != "relative":
        return [plane for plane in planes if plane.score < threshold]
    most = min(RELATIVE_THRESHOLD, WORSE_THAN_BEST * planes[0].relative_score + FIT_LEAVES) if planes else 0.0
    return [plane for plane in planes if plane.relative_score <= most]


@dataclass(frozen=True)
class _Judged:
    row: Float64  # (4,) normalized, see `plane_search`
    dissimilarity: float
    landed: float


def scored_planes(field: Field, mesh: Mesh, *, candidates: Literal["any", "axes"] = "any") -> list[SymmetryPlane]:
    """All planes that were looked at closely with their scores, the most alike first; see `symmetry_planes`."""
    evidence = gather(field, mesh)
    if evidence is None:
        return []
    if candidates == "axes":
        judged = [_judged(evidence, _normalized(axis_plane(mesh, axis), evidence)) for axis in AXES]
    else:
        close = _without_leaning([_judged(evidence, row) for row in candidate_planes(evidence)])
        judged = [_snapped(evidence, each) for each in close if each.landed >= LANDED and each.dissimilarity < 1]
    judged.sort(key=lambda each: each.dissimilarity)
    planes = [_plane(each.row, evidence) for each in judged]
    vertices = mesh.vertices  # all of them for the paper's planes, as in the paper
    if candidates != "axes":
        vertices = vertices[:: -(-len(vertices) // _SCORED_VERTICES)]
    totals = np.zeros(len(planes))
    for some in np.array_split(vertices, -(-len(vertices) // _AT_ONCE)):
        features = field(some)
        totals += [np.linalg.norm(features - field(plane.reflect(some)), axis=1).sum() for plane in planes]
    return [
        replace(plane, score=float(total / len(vertices)), relative_score=each.dissimilarity)
        for plane, total, each in zip(planes, totals, judged, strict=True)
    ]


def _judged(evidence: SurfaceFeatures, row: Float64) -> _Judged:
    return _Judged(row, *evidence.dissimilarity(mirrored(evidence.points, row)))


def _without_leaning(judged: list[_Judged]) -> list[_Judged]:
    """Return planes, the most alike first, without those that lean by little against a much better one."""
    kept: list[_Judged] = []
    for each in sorted(judged, key=lambda each: each.dissimilarity):
        if not any(
            same_plane(each.row, other.row, angle=_LEANS, offset=_BESIDE)
            and each.dissimilarity > _WORSE * other.dissimilarity
            for other in kept
        ):
            kept.append(each)
    return kept


def _snapped(evidence: SurfaceFeatures, found: _Judged) -> _Judged:
    """Return the plane across an axis of the coordinates that is nearly the one found, if it is hardly less alike."""
    axis = int(np.argmax(np.abs(found.row[:3])))
    if abs(found.row[axis]) < np.cos(_SNAP_ANGLE):
        return found
    normal = np.eye(3)[axis]
    offset = float(np.sign(found.row[axis]) * found.row[3])
    origin = float(-evidence.center[axis] / evidence.half)
    for place in (origin, 0.0, offset):  # through the origin, the middle of the box, or where it was found
        if abs(place - offset) < _SNAP_OFFSET:
            across = _judged(evidence, np.append(normal, place))
            if across.dissimilarity < found.dissimilarity + _SNAP_LOSS:
                return across
    return found


def _normalized(plane: SymmetryPlane, evidence: SurfaceFeatures) -> Float64:
    """Return a plane of mesh units as a row (4,) in normalized coordinates."""
    normal = np.asarray(plane.normal)
    return np.append(normal, (plane.offset - normal @ evidence.center) / evidence.half)


def _plane(row: Float64, evidence: SurfaceFeatures) -> SymmetryPlane:
    """Return a row (4,) in normalized coordinates as a plane of mesh units, its largest component positive."""
    row = row * np.sign(row[np.argmax(np.abs(row[:3]))])
    normal = row[:3] + 0.0  # no negative zeros
    offset = float(row[3] * evidence.half + normal @ evidence.center)
    # what cancels but for rounding is a plane through the origin
    offset = 0.0 if abs(offset) < 1e-12 * evidence.half else offset
    band = DEFAULT_BAND * 2 * evidence.half
    return SymmetryPlane((float(normal[0]), float(normal[1]), float(normal[2])), offset, band=band)
