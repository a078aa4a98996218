"""A copy of a mesh with fewer faces: quadric error simplification, as the paper does before it renders."""

from __future__ import annotations

import fast_simplification
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.mesh import Mesh
from dfd.mesh.normalization import normalization

__all__ = ["simplify"]


def simplify(mesh: Mesh, face_count: int) -> Mesh:
    """Simplify `mesh` to at most about `face_count` faces; one that has no more is returned as it is.

    Texture coordinates do not survive: the copy takes, vertex by vertex, the color of the nearest vertex of `mesh`.

    Raises
    ------
    ValueError
        If `face_count` is not at least 4, or all vertices are one point.

    Source: Garland and Heckbert 1997, through fast-simplification; paper, section 3.2.
    """
    face_count = check.whole("simplify", "face_count", face_count, minimum=4)
    if len(mesh.faces) <= face_count:
        return mesh
    faces = _faces_with_area(mesh)
    if len(faces) == 0:
        return mesh
    # Quadrics hold squared coordinates: around the origin and of size 1 they lose least.
    center, scale = normalization(mesh)
    normalized = (mesh.vertices - center) * scale
    vertices, faces = fast_simplification.simplify(normalized, faces, target_count=min(face_count, len(faces)))
    if len(faces) == 0 or not np.isfinite(vertices).all():
        return mesh
    # On flat ground the best place for a vertex is nearly free, and it may be put anywhere: not outside the box.
    vertices = np.clip(vertices, normalized.min(axis=0), normalized.max(axis=0))
    coarse = Mesh(vertices / scale + center, faces)
    if mesh.appearance is None:
        return coarse
    _, nearest = cKDTree(mesh.vertices).query(coarse.vertices)
    rows = np.arange(len(coarse.vertices), dtype=np.int32)
    coarse.appearance = Appearance(
        corners=rows,
        corner_faces=coarse.faces,
        face_material=np.zeros(len(coarse.faces), np.int32),
        materials=(Material(color=(1.0, 1.0, 1.0, 1.0)),),
        colors=_vertex_colors(mesh, mesh.appearance)[nearest],
    )
    return coarse


def _faces_with_area(mesh: Mesh) -> NDArray[np.int32]:
    """Return a copy of the faces that have an area: around others the simplification sees every collapse as a fold."""
    first, second, third = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return mesh.faces[np.cross(second - first, third - first).any(axis=1)]


def _vertex_colors(mesh: Mesh, appearance: Appearance) -> NDArray[np.float32]:
    """RGBA of every vertex, (V, 4), looked up in one of its faces."""
    corner = np.full(len(mesh.vertices), -1, np.int64)
    corner[mesh.faces.reshape(-1)] = np.arange(mesh.faces.size)
    used = corner >= 0
    colors = np.ones((len(mesh.vertices), 4), np.float32)
    colors[used] = appearance.albedo(corner[used] // 3, np.eye(3, dtype=np.float32)[corner[used] % 3])
    return colors
