"""Find the mirror planes of a shape: planes whose two sides have similar features (paper, section 3.3.3)."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from dfd.common import check
from dfd.common.linear_algebra import Float64
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.symmetry.evidence import SurfaceFeatures, surface_features
from dfd.symmetry.fit import fitted_planes
from dfd.symmetry.plane import AXES, DEFAULT_BAND, SymmetryPlane

# Largest number of vertices for a score, and of vertices whose features are in memory together. The standard error of a
# score is below 1 %.
_SCORED_VERTICES = 4_000
# Largest dissimilarity of a mirror plane (`SurfaceFeatures.dissimilarity`). With 0.2, 3 of 34 shapes lose a plane; with
# 0.3, 1 of them gets one more.
RELATIVE_THRESHOLD = 0.25
# A plane is not returned if its dissimilarity is above WORSE_THAN_BEST times that of the best plane. For example, a
# figure's left and right are so similar that the plane between its front and back is not returned. Without the rule, 6
# of 52 shapes get other planes.
WORSE_THAN_BEST = 3.0
# Of planes with a smaller angle, only the one with the least dissimilarity is kept. With 10° or 40°, planes of 34
# shapes stay the same.
_SAME_ANGLE = np.radians(20.0)
# A plane is made perpendicular to a coordinate axis if its angle changes by less than _SNAP_ANGLE, and its
# dissimilarity rises by less than _SNAP_LOSS. With 1.5°, the knight of DFD_MESHES keeps a plane that is 2° off;
# with 6°, planes of 2 of 34 shapes differ. With a loss of 0, 1 of them differs; with 0.02, none.
_SNAP_ANGLE, _SNAP_LOSS = np.radians(3.0), 0.01
# Largest rounding error of exactly mirrored vertices, in normalized coordinates. Without pairs of such vertices, planes
# of 52 shapes change by less than half a degree and 0.5 %, but are not exact.
_EXACT = 1e-6


def symmetry_planes(
    mesh: MeshLike,
    field: Field,
    *,
    threshold: float | Literal["relative"] = "relative",
    candidates: Literal["any", "axes"] = "any",
) -> list[SymmetryPlane]:
    """Return the mirror planes of `mesh`: planes whose two sides have similar features.

    With `candidates="any"`, candidates are planes through the middle of the surface in many directions. Each candidate
    is moved so that the mirror image of the surface is nearest to the surface. If planes are nearly parallel, the best
    of them is kept. A plane nearly perpendicular to a coordinate axis is made perpendicular if its `relative_score`
    hardly increases. The plane in which a flat shape lies is not found.

    Raises ValueError if `field` is not callable, or `threshold` or `candidates` is invalid.

    Source: paper, section 3.3.3.

    Parameters
    ----------
    mesh, field
        The shape and its feature field.
    threshold
        A number ε returns planes with a `SymmetryPlane.score` below ε; the paper uses 0.1. The best ε depends on the
        encoder and its block. "relative" returns planes with a `relative_score` of at most 0.25 and at most 3 r,
        where r is the lowest `relative_score` of all planes.
    candidates
        "any", or "axes" for the paper's three planes: perpendicular to x, y or z, through the bounding box's center.

    Returns
    -------
    The planes, sorted by ascending `relative_score`. Each `band` is 3 % of the longest side of the bounding box.

    Examples
    --------
    >>> import dfd
    >>> mesh = dfd.samples.robot().mesh
    >>> best, *others = dfd.symmetry_planes(mesh, dfd.distill(mesh))
    >>> [abs(round(number, 2)) for number in best.normal]
    [1.0, 0.0, 0.0]
    """
    check.field("symmetry_planes", field)
    mesh = as_mesh(mesh)
    if threshold != "relative":
        threshold = check.number("symmetry_planes", "threshold", threshold, minimum=0.0)
    check.choice("symmetry_planes", "candidates", candidates, ("any", "axes"))
    planes = scored_planes(field, mesh, candidates=candidates)
    if threshold != "relative":
        return [plane for plane in planes if plane.score < threshold]
    most = min(RELATIVE_THRESHOLD, WORSE_THAN_BEST * planes[0].relative_score) if planes else 0.0
    return [plane for plane in planes if plane.relative_score <= most]


def scored_planes(field: Field, mesh: Mesh, *, candidates: Literal["any", "axes"] = "any") -> list[SymmetryPlane]:
    """Return the candidates of `symmetry_planes` with their scores, sorted by ascending `relative_score`."""
    evidence = surface_features(field, mesh)
    if evidence is None:
        return []
    if candidates == "axes":
        found = [_compared(evidence, SymmetryPlane(normal, 0.0)) for normal in AXES.values()]
    else:
        distinct = _distinct([_compared(evidence, plane) for plane in fitted_planes(evidence.samples, np.zeros(3))])
        vertices = evidence.frame.apply(mesh.vertices)
        found = [_snapped(evidence, vertices, plane) for plane in distinct if plane.relative_score < 1]
    found.sort(key=lambda plane: plane.relative_score)
    planes = [_in_mesh_units(plane, evidence) for plane in found]
    vertices = mesh.vertices
    if candidates != "axes":  # for "axes", all vertices are used, as in the paper
        vertices = vertices[:: -(-len(vertices) // _SCORED_VERTICES)]
    totals = np.zeros(len(planes))
    for some in np.array_split(vertices, -(-len(vertices) // _SCORED_VERTICES)):
        features = field(some)
        totals += [np.linalg.norm(features - field(plane.reflect(some)), axis=1).sum() for plane in planes]
    return [replace(plane, score=float(total / len(vertices))) for plane, total in zip(planes, totals, strict=True)]


# In the following functions, planes are in the normalized coordinates of `dfd.symmetry.evidence`.


def _compared(evidence: SurfaceFeatures, plane: SymmetryPlane) -> SymmetryPlane:
    """Return the plane with its `relative_score`."""
    return replace(plane, relative_score=evidence.dissimilarity(plane.reflect(evidence.samples.points)))


def _distinct(planes: list[SymmetryPlane]) -> list[SymmetryPlane]:
    """Return the planes by ascending `relative_score`, without those nearly parallel to a better one."""
    kept: list[SymmetryPlane] = []
    for each in sorted(planes, key=lambda plane: plane.relative_score):
        if all(abs(np.dot(each.normal, other.normal)) < np.cos(_SAME_ANGLE) for other in kept):
            kept.append(each)
    return kept


def _snapped(evidence: SurfaceFeatures, vertices: Float64, found: SymmetryPlane) -> SymmetryPlane:
    """Return a plane near `found` and perpendicular to an axis if it maps the surface hardly worse, else `found`."""
    axis = int(np.argmax(np.abs(found.normal)))
    if abs(found.normal[axis]) < np.cos(_SNAP_ANGLE):
        return found
    offset = _offset_of_pairs(vertices, axis)
    if offset is None:
        offset = float(np.sign(found.normal[axis]) * found.offset)
    snapped = _compared(evidence, SymmetryPlane(list(AXES.values())[axis], offset))
    return snapped if snapped.relative_score < found.relative_score + _SNAP_LOSS else found


def _offset_of_pairs(vertices: Float64, axis: int) -> float | None:
    """Return the offset along `axis` of the plane in which most `vertices` (V, 3) are mirrored exactly, or None.

    Vertices that differ only along the axis are a pair. The result is the median of the middles of all pairs.
    """
    across = np.rint(np.delete(vertices, axis, axis=1) / _EXACT).astype(np.int64)
    order = np.lexsort((vertices[:, axis], *across.T))
    starts = np.flatnonzero(np.append(True, np.diff(across[order], axis=0).any(axis=1)))
    sizes = np.diff(np.append(starts, len(vertices)))
    paired = sizes > 1
    if sizes[paired].sum() < len(vertices) / 2:
        return None
    along = vertices[order, axis]
    return float(np.median((along[starts] + along[starts + sizes - 1])[paired])) / 2


def _in_mesh_units(plane: SymmetryPlane, evidence: SurfaceFeatures) -> SymmetryPlane:
    """Return the plane in mesh units. The component of its normal with the largest magnitude is positive."""
    sign = np.sign(max(plane.normal, key=abs))
    normal = sign * np.asarray(plane.normal) + 0.0  # turns −0 into 0
    half = 1.0 / evidence.frame.scale
    offset = float(sign * plane.offset * half + normal @ evidence.frame.center)
    offset = 0.0 if abs(offset) < 1e-12 * half else offset  # removes the rounding error of a plane through the origin
    return replace(plane, normal=tuple(normal), offset=offset, band=DEFAULT_BAND * 2 * half)
