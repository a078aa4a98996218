"""Simplify a mesh to fewer faces by quadric error metrics, as the paper does before rendering."""

import fast_simplification
import numpy as np
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.geometry.normalization import normalization
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import face_normals


def simplify(mesh: Mesh, face_count: int) -> Mesh:
    """Return a copy of `mesh` with at most about `face_count` faces.

    The copy has no textures. Each vertex of the copy has the color of the nearest vertex of `mesh`. If `mesh` does not
    have more than `face_count` faces, or has no face with an area, `mesh` itself is returned.

    Raises ValueError if `face_count` is less than 4, or all vertices are at one position. Source: Garland and
    Heckbert 1997, through fast-simplification; paper, section 3.2.
    """
    face_count = check.whole("simplify", "face_count", face_count, minimum=4)
    if len(mesh.faces) <= face_count:
        return mesh
    # The simplifier rejects every edge collapse near a face without area, as if the collapse folded the surface.
    faces = mesh.faces[face_normals(mesh.vertices, mesh.faces).any(axis=1)]
    if len(faces) == 0:
        return mesh
    # Quadrics contain squared coordinates, whose rounding errors are smallest for coordinates in [−1, 1].
    frame = normalization(mesh)
    normalized = frame.apply(mesh.vertices)
    vertices, faces = fast_simplification.simplify(normalized, faces, target_count=min(face_count, len(faces)))
    if len(faces) == 0 or not np.isfinite(vertices).all():
        return mesh
    # On flat surface, the optimal position of a merged vertex may be far away. Clamp positions to the bounding box.
    vertices = np.clip(vertices, normalized.min(axis=0), normalized.max(axis=0))
    vertices = frame.invert(vertices)
    if mesh.appearance is None:
        return Mesh(vertices, faces)
    used = np.unique(mesh.faces)
    nearest = used[cKDTree(mesh.vertices[used]).query(vertices)[1]]
    appearance = Appearance(
        corners=np.arange(len(vertices), dtype=np.int32),
        corner_faces=np.asarray(faces, np.int32),
        face_material=np.zeros(len(faces), np.int32),
        materials=(Material(color=(1.0, 1.0, 1.0, 1.0)),),
        colors=mesh.vertex_colors()[nearest],
    )
    return Mesh(vertices, faces, appearance=appearance)
