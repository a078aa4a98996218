"""Distortion of a surface by a deformation, as in the paper's Fig. 22: area, angles, edges, volume, faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from igl.copyleft import cgal
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float64, distinct_pairs, group_sums, unit
from dfd.geometry.topology import face_areas, first_at_place
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import face_normals

MOST_TESTED = 200_000  # faces that are tested for self-intersection: exact arithmetic takes seconds there

# Sum of the cosines between a face and its neighbors: below it, the face is folded over, not just creased.
FOLD = -0.5


@dataclass(frozen=True)
class SurfaceMetrics:
    """How a moved surface differs from the resting one; rigid motion has no effect."""

    area: float  # mean of |A′/A − 1| over the surface, weighted by resting area A
    angle: float  # mean change of the faces' angles, degrees, weighted likewise
    edge_length: float  # mean of |l′/l − 1| over the edges, weighted by resting length l
    volume: float | None  # V′/V − 1 of the enclosed volume; None where the surface is open or encloses nothing
    flipped_faces: int  # faces that are folded over against the faces around them, and were not at rest
    self_intersecting_faces: int | None  # faces that pass through others; None above 200,000 faces
    self_intersecting_before: int | None  # the same at rest


def surface_metrics(mesh: Mesh, vertices: ArrayLike) -> SurfaceMetrics:
    """Measure what moving the vertices of `mesh` to `vertices` (V, 3), mesh units, does to its surface.

    Faces without area at rest count for nothing. Self-intersections are found by libigl.

    Raises ValueError if `vertices` is not finite or has another shape than those of the mesh, or no face has an area.
    """
    moved = check.array("surface_metrics", "vertices", vertices, mesh.vertices.shape, dtype=np.float64)
    # In units of the shape, around its middle: lengths far from 1 lose nothing.
    center, size = mesh.bounds.mean(axis=0), max(mesh.diagonal, np.finfo(float).tiny)
    resting, moved = (mesh.vertices - center) / size, (moved - center) / size
    faces = first_at_place(mesh)[mesh.faces]
    areas = face_areas(resting, faces)
    faces, areas = faces[areas > 0], areas[areas > 0]
    if len(faces) == 0:
        raise ValueError("surface_metrics: `mesh` must have a face with an area, got none")
    fraction = areas / areas.sum()
    edges = distinct_pairs(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), len(resting))[0]
    before, after = (np.linalg.norm(each[edges[:, 0]] - each[edges[:, 1]], axis=1) for each in (resting, moved))
    turned = np.abs(_angles(moved, faces) - _angles(resting, faces)).mean(axis=1)
    return SurfaceMetrics(
        area=float(np.abs(face_areas(moved, faces) - areas).sum() / areas.sum()),
        angle=float(fraction @ turned),
        edge_length=float(np.abs(after - before).sum() / before.sum()),
        volume=_volume_change(resting, moved, faces),
        flipped_faces=int((_folded(moved, faces) & ~_folded(resting, faces)).sum()),
        self_intersecting_faces=_self_intersecting(moved, faces),
        self_intersecting_before=_self_intersecting(resting, faces),
    )


def _angles(vertices: Float64, faces: NDArray[np.integer]) -> Float64:
    """(F, 3) angles at the corners, degrees; 0 where an edge has no length."""
    corners = vertices[faces]
    one, other = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    # atan2 keeps small angles, which arccos loses.
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=2), (one * other).sum(axis=2)
    return np.degrees(np.arctan2(sine, cosine))


def _volume_change(resting: Float64, moved: Float64, faces: NDArray[np.integer]) -> float | None:
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forth, uses = np.unique(directed, axis=0, return_counts=True)
    back = np.unique(directed[:, ::-1], axis=0)
    if len(forth) != len(back) or (uses != 1).any() or (forth != back).any():
        return None  # some edge lacks the face on its other side
    before, after = (np.linalg.det(each[faces]).sum() / 6 for each in (resting, moved))
    return None if abs(before) < 1e-12 else float(after / before - 1)


def _folded(vertices: Float64, faces: NDArray[np.integer]) -> Bool:
    """(F,) which faces look away from the mean of the faces across their edges."""
    normals = unit(face_normals(vertices, faces))
    edges, edge = distinct_pairs(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), len(vertices))
    around = group_sums(edge, np.repeat(normals, 3, axis=0), len(edges))
    others = around[edge].reshape(-1, 3, 3).sum(axis=1) - 3 * normals
    return (others * normals).sum(axis=1) < FOLD


def _self_intersecting(vertices: Float64, faces: NDArray[np.integer]) -> int | None:
    if len(faces) > MOST_TESTED:
        return None
    found = cgal.remesh_self_intersections(
        np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.int64), detect_only=True
    )
    return len(np.unique(found[2]))
