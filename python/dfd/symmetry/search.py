"""Find the planes of visual symmetry, whose two sides look alike (paper, section 3.3.3)."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dfd.common import check
from dfd.common.linear_algebra import Float64
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.symmetry.evidence import SurfaceFeatures, surface_features
from dfd.symmetry.plane import DEFAULT_BAND, SymmetryPlane
from dfd.symmetry.plane_search import candidate_planes, mirrored, same_plane

_SCORED_VERTICES = 4_000  # largest number of vertices for a score, at even strides; the standard error is below 1 %
_AT_ONCE = 50_000  # vertices whose features are in memory together
RELATIVE_THRESHOLD = 0.25  # largest dissimilarity of a symmetry plane
# Largest dissimilarity of a plane, over that of the best plane, and the dissimilarity that remains after the fit. The
# front and the back of a figure also look alike, but far less than its two sides.
WORSE_THAN_BEST, FIT_LEAVES = 3.0, 0.01
LANDED = 0.5  # least share of samples with mirror images on the surface, among those that the reflection moves
# A plane is an inaccurate copy of a better plane if their angle and the difference of their offsets are below these
# bounds, and its dissimilarity is at least _COPY_RATIO times larger.
_COPY_ANGLE, _COPY_OFFSET, _COPY_RATIO = np.radians(20.0), 0.25, 1.3
# A plane is made perpendicular to an axis if the angle, the change of the offset and the added dissimilarity are
# below these bounds.
_SNAP_ANGLE, _SNAP_OFFSET, _SNAP_LOSS = np.radians(1.5), 0.012, 0.01


def symmetry_planes(
    field: Field,
    mesh: MeshLike,
    *,
    threshold: float | Literal["relative"] = "relative",
    candidates: Literal["any", "axes"] = "any",
) -> list[SymmetryPlane]:
    """Return the mirror planes of `mesh`, planes whose two sides look alike.

    Candidates are the bisecting planes of points with similar features, and planes perpendicular to principal axes or
    coordinate axes. With `candidates="any"`, each is fitted so that the mirror image of the surface is nearest to the
    surface, and nearly equal planes are merged. A plane nearly perpendicular to a coordinate axis is made exactly
    perpendicular if its dissimilarity hardly increases. The plane of a flat shape is not found, because its reflection
    moves no point.

    Parameters
    ----------
    threshold
        A number is the ε of the paper, which uses 0.1: planes with a smaller `score` are returned. "relative" returns
        planes with a `relative_score` of at most 0.25, and at most 3 times the best one plus 0.01. The right ε depends
        on the encoder and its block, because the spread of their features differs.
    candidates
        "any", or "axes" for the paper's three planes, perpendicular to the axes through the center of the box.

    Returns
    -------
    The planes, the most similar sides first, with a band of 3 % of the longest side; an empty list if there is none.

    Raises ValueError if `field` is not callable, `threshold` is another word, negative or not finite, or `candidates`
    is another word.

    Source: paper, section 3.3.3; planes from pairs of points: Mitra, Guibas and Pauly, "Partial and approximate
    symmetry detection for 3D geometry", 2006.
    """
    check.field("symmetry_planes", field)
    mesh = as_mesh(mesh)
    if threshold != "relative":
        threshold = check.number("symmetry_planes", "threshold", threshold, minimum=0.0)
    check.choice("symmetry_planes", "candidates", candidates, ("any", "axes"))
    planes = scored_planes(field, mesh, candidates=candidates)
    if threshold != "relative":
        return [plane for plane in planes if plane.score < threshold]
    most = min(RELATIVE_THRESHOLD, WORSE_THAN_BEST * planes[0].relative_score + FIT_LEAVES) if planes else 0.0
    return [plane for plane in planes if plane.relative_score <= most]


@dataclass(frozen=True)
class _Judged:
    row: Float64  # (4,) normalized, see `plane_search`
    dissimilarity: float
    landed: float  # share of the moved samples whose images lie on the surface


def scored_planes(field: Field, mesh: Mesh, *, candidates: Literal["any", "axes"] = "any") -> list[SymmetryPlane]:
    """Return the fitted planes with their scores, the most similar sides first; see `symmetry_planes`."""
    evidence = surface_features(field, mesh)
    if evidence is None:
        return []
    if candidates == "axes":
        judged = [_judged(evidence, np.append(normal, 0.0)) for normal in np.eye(3)]  # through the center of the box
    else:
        close = _without_copies([_judged(evidence, row) for row in candidate_planes(evidence)])
        judged = [_snapped(evidence, each) for each in close if each.landed >= LANDED and each.dissimilarity < 1]
    judged.sort(key=lambda each: each.dissimilarity)
    planes = [_plane(each.row, evidence) for each in judged]
    vertices = mesh.vertices
    if candidates != "axes":  # for "axes", all vertices are used, as in the paper
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


def _without_copies(judged: list[_Judged]) -> list[_Judged]:
    """Return the planes by ascending dissimilarity, without inaccurate copies of a much better plane."""
    kept: list[_Judged] = []
    for each in sorted(judged, key=lambda each: each.dissimilarity):
        if not any(
            same_plane(each.row, other.row, angle=_COPY_ANGLE, offset=_COPY_OFFSET)
            and each.dissimilarity > _COPY_RATIO * other.dissimilarity
            for other in kept
        ):
            kept.append(each)
    return kept


def _snapped(evidence: SurfaceFeatures, found: _Judged) -> _Judged:
    """Return the nearly equal plane perpendicular to an axis if its dissimilarity is hardly larger, else `found`."""
    axis = int(np.argmax(np.abs(found.row[:3])))
    if abs(found.row[axis]) < np.cos(_SNAP_ANGLE):
        return found
    normal = np.eye(3)[axis]
    offset = float(np.sign(found.row[axis]) * found.row[3])
    origin = float(-evidence.frame.center[axis] * evidence.frame.scale)
    for place in (origin, 0.0, offset):  # through the origin, through the center of the box, or at the found offset
        if abs(place - offset) < _SNAP_OFFSET:
            across = _judged(evidence, np.append(normal, place))
            if across.dissimilarity < found.dissimilarity + _SNAP_LOSS:
                return across
    return found


def _plane(row: Float64, evidence: SurfaceFeatures) -> SymmetryPlane:
    """Return a normalized plane (4,) in mesh units; the largest component of its normal is positive."""
    row = row * np.sign(row[np.argmax(np.abs(row[:3]))])
    normal = row[:3] + 0.0  # turns −0 into 0
    half = 1.0 / evidence.frame.scale
    offset = float(row[3] * half + normal @ evidence.frame.center)
    offset = 0.0 if abs(offset) < 1e-12 * half else offset  # a plane through the origin has a rounding error
    band = DEFAULT_BAND * 2 * half
    return SymmetryPlane((float(normal[0]), float(normal[1]), float(normal[2])), offset, band=band)
