"""A copy of a mesh with fewer faces: quadric error simplification, as the paper does before it renders."""

from __future__ import annotations

import fast_simplification
import numpy as np
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.common.linear_algebra import Float64, Int32
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.mesh import Mesh
from dfd.mesh.normalization import normalization
from dfd.mesh.normals import face_normals


def simplify(mesh: Mesh, face_count: int) -> Mesh:
    """Simplify `mesh` to at most about `face_count` faces; one that has no more is returned as it is.

    Textures are lost: each vertex of the copy takes the color of the nearest vertex of `mesh`.

    Raises ValueError if `face_count` is not at least 4, or all vertices are one point.

    Source: Garland and Heckbert 1997, through fast-simplification; paper, section 3.2.
    """
    face_count = check.whole("simplify", "face_count", face_count, minimum=4)
    if len(mesh.faces) <= face_count:
        return mesh
    # Around faces without area every collapse counts as a fold.
    faces = mesh.faces[face_normals(mesh.vertices, mesh.faces).any(axis=1)]
    if len(faces) == 0:
        return mesh
    # Quadrics hold squared coordinates: at the origin and with size 1, rounding is least.
    frame = normalization(mesh)
    normalized = frame.apply(mesh.vertices)
    vertices, faces = fast_simplification.simplify(normalized, faces, target_count=min(face_count, len(faces)))
    if len(faces) == 0 or not np.isfinite(vertices).all():
        return mesh
    # On flat regions the optimal position is ill-conditioned: clamp it to the box.
    vertices = np.clip(vertices, normalized.min(axis=0), normalized.max(axis=0))
    vertices = frame.invert(vertices)
    return Mesh(vertices, faces, appearance=_nearest_colors(mesh, vertices, faces))


def _nearest_colors(mesh: Mesh, vertices: Float64, faces: Int32) -> Appearance | None:
    """Color other vertices (V, 3), corners of `faces` (F, 3), like the nearest of `mesh`; None where that has none."""
    if mesh.appearance is None:
        return None
    used = np.unique(mesh.faces)
    nearest = used[cKDTree(mesh.vertices[used]).query(vertices)[1]]
    return Appearance(
        corners=np.arange(len(vertices), dtype=np.int32),
        corner_faces=np.asarray(faces, np.int32),
        face_material=np.zeros(len(faces), np.int32),
        materials=(Material(color=(1.0, 1.0, 1.0, 1.0)),),
        colors=mesh.vertex_colors()[nearest],
    )
