"""Measure how a deformation distorts a surface, as in the paper's Fig. 22: area, angles, edges, volume, faces."""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float64, Int64, distinct_pairs, group_sums, unit
from dfd.geometry.topology import face_areas, face_sides, first_at_place
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import face_normals

FOLD = -0.5  # sum of the cosines between a face and its neighbors; a folded face is below it, a creased one above


@dataclass(frozen=True)
class SurfaceMetrics:
    """Differences of a moved surface from the resting one; rigid motion has no effect."""

    area: float  # mean of |A′/A − 1| over the surface, weighted by resting area A
    angle: float  # mean change of the faces' angles, degrees, weighted likewise
    edge_length: float  # mean of |l′/l − 1| over the edges, weighted by resting length l
    volume: float | None  # V′/V − 1 of the enclosed volume; None where the surface is open or encloses nothing
    flipped_faces: int  # faces folded over against the faces around them, but not at rest


def surface_metrics(mesh: Mesh, vertices: ArrayLike) -> SurfaceMetrics:
    """Measure the distortion of the surface of `mesh` with its vertices moved to `vertices` (V, 3), mesh units.

    Faces without area at rest are left out.

    Raises ValueError if `vertices` is not finite or has another shape than those of the mesh, or no face has an area.
    """
    moved = check.array("surface_metrics", "vertices", vertices, mesh.vertices.shape, dtype=np.float64)
    # Unit size about the origin keeps the precision of very small and very large shapes.
    center, size = mesh.bounds.mean(axis=0), max(mesh.diagonal, np.finfo(float).tiny)
    resting, moved = (mesh.vertices - center) / size, (moved - center) / size
    faces = first_at_place(mesh)[mesh.faces]
    areas = face_areas(resting, faces)
    faces, areas = faces[areas > 0], areas[areas > 0]
    if len(faces) == 0:
        raise ValueError("surface_metrics: `mesh` must have a face with an area, got none")
    fraction = areas / areas.sum()
    edges, edge = distinct_pairs(face_sides(faces), len(resting))
    before, after = (np.linalg.norm(each[edges[:, 0]] - each[edges[:, 1]], axis=1) for each in (resting, moved))
    turned = np.abs(_angles(moved, faces) - _angles(resting, faces)).mean(axis=1)
    return SurfaceMetrics(
        area=float(np.abs(face_areas(moved, faces) - areas).sum() / areas.sum()),
        angle=float(fraction @ turned),
        edge_length=float(np.abs(after - before).sum() / before.sum()),
        volume=_volume_change(resting, moved, faces),
        flipped_faces=int((_folded(moved, faces, edge) & ~_folded(resting, faces, edge)).sum()),
    )


def _angles(vertices: Float64, faces: NDArray[np.integer]) -> Float64:
    """Return the angles (F, 3) at the corners, degrees; 0 where an edge has no length."""
    return np.nan_to_num(np.degrees(igl.internal_angles(np.ascontiguousarray(vertices), faces.astype(np.int64))))


def _volume_change(resting: Float64, moved: Float64, faces: NDArray[np.integer]) -> float | None:
    before, after = (trimesh.Trimesh(each, faces, process=False) for each in (resting, moved))
    closed = before.is_watertight and before.is_winding_consistent and abs(before.volume) > 1e-12
    return float(after.volume / before.volume - 1) if closed else None


def _folded(vertices: Float64, faces: NDArray[np.integer], edge: Int64) -> Bool:
    """Return whether each face (F,) faces away from its neighbors; `edge` (3 F,) is the edge of each side of a face."""
    normals = unit(face_normals(vertices, faces))
    around = group_sums(edge, np.repeat(normals, 3, axis=0), edge.max() + 1)
    others = around[edge].reshape(-1, 3, 3).sum(axis=1) - 3 * normals
    return (others * normals).sum(axis=1) < FOLD
