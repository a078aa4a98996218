"""Measure the distortion of a deformed surface, as in Fig. 22: area, angles, edges, volume, flipped faces."""

import igl
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float64, Int64, distinct_pairs, group_sums, unit
from dfd.common.normals import face_normals
from dfd.geometry.topology import face_areas, face_sides, first_at_place
from dfd.mesh.mesh import Mesh

FOLD = -0.5  # A face is folded if the cosines between its normal and its neighbors' normals sum to less than this.


def surface_metrics(mesh: Mesh, vertices: ArrayLike) -> dict[str, float | None]:
    """Return table columns for the distortion of `mesh` if its vertices move to `vertices` (V, 3), in mesh units.

    Area, angle and edge are mean absolute changes, weighted by areas or lengths at rest. Volume is the change of the
    enclosed volume, or None if the surface is open or encloses nothing. Flipped faces are faces that are folded
    after the deformation, but not at rest. A rigid motion changes no value. Faces without area at rest are ignored.

    Raises ValueError if `vertices` is not finite or not of the array shape (V, 3), or if no face has an area.
    """
    moved = check.array("surface_metrics", "vertices", vertices, mesh.vertices.shape, dtype=np.float64)
    # Both shapes are scaled to unit size, which keeps the precision for very small and very large shapes.
    center, size = mesh.bounds.mean(axis=0), max(mesh.diagonal, np.finfo(float).tiny)
    both = [np.ascontiguousarray(each - center) / size for each in (mesh.vertices, moved)]
    faces = first_at_place(mesh)[mesh.faces].astype(np.int64)
    faces = faces[face_areas(both[0], faces) > 0]
    if len(faces) == 0:
        raise ValueError("surface_metrics: `mesh` must have a face with an area, got none")
    resting, after = (trimesh.Trimesh(each, faces, process=False) for each in both)
    area, moved_area = (face_areas(each, faces) for each in both)
    angles, moved_angles = (np.nan_to_num(np.degrees(igl.internal_angles(each, faces))) for each in both)
    edges, edge = distinct_pairs(face_sides(faces), len(moved))
    length, moved_length = (np.linalg.norm(each[edges[:, 0]] - each[edges[:, 1]], axis=1) for each in both)
    folded, moved_folded = (_folded(each, faces, edge) for each in both)
    closed = resting.is_watertight and resting.is_winding_consistent and abs(resting.volume) > 1e-12
    return {
        "area %": 100 * float(np.abs(moved_area - area).sum() / area.sum()),
        "angle °": float(area / area.sum() @ np.abs(moved_angles - angles).mean(axis=1)),
        "edge %": 100 * float(np.abs(moved_length - length).sum() / length.sum()),
        "volume %": 100 * float(after.volume / resting.volume - 1) if closed else None,
        "flipped faces": int((moved_folded & ~folded).sum()),
    }


def _folded(vertices: Float64, faces: NDArray[np.integer], edge: Int64) -> Bool:
    """Return the mask (F,) of folded faces, see `FOLD`; `edge` (3 F,) are the edge indices of the faces' sides."""
    normals = unit(face_normals(vertices, faces))
    around = group_sums(edge, np.repeat(normals, 3, axis=0), edge.max() + 1)
    others = around[edge].reshape(-1, 3, 3).sum(axis=1) - 3 * normals
    return (others * normals).sum(axis=1) < FOLD
