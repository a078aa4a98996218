"""Measure, on rigs, how much the surface folds at the border of a moving part."""

import numpy as np
import trimesh

import dfd
from bench.quality.anatomy import RiggedShape
from bench.quality.measures import session_of
from dfd.common.linear_algebra import Float64, Int64
from dfd.editing.weights.axis_motions import bendable_parts
from dfd.geometry.topology import first_at_place
from dfd.mesh.normals import face_normals
from dfd.posing.transforms import frame_of_normal

MOTION = 0.3  # length of the translation, which is perpendicular to the part's axis, as a fraction of the part's length
SMOOTH = 25.0  # largest fold of a smooth border, in degrees
LEAST_FACES = 5000  # in a mesh with fewer faces, the edges of a smooth surface already have large angles
LEAST_EDGES = 20  # a blend band, in which weights are between 0 and 1, is measured if it has at least this many edges
LEGEND = {
    "fold": "median over the handles, in degrees; the fold of a border is the 99th percentile of the changes of "
    f"dihedral angles in the blend band, if the part moves by {MOTION:.0%} of its length",
    "smooth": f"fraction of handles with a fold of at most {SMOOTH:g}°",
}


def judged(shape: RiggedShape, field: dfd.Field) -> dict[str, float]:
    """Return the numbers that `LEGEND` explains, for a handle of each joint; NaN if none has a blend band.

    All numbers are also NaN if the mesh has fewer than `LEAST_FACES` faces.
    """
    if len(shape.mesh.faces) < LEAST_FACES:
        return dict.fromkeys(LEGEND, np.nan)
    session, edges = session_of(shape.mesh, field), _edges(shape.mesh)
    found = [_fold(session, edges, int(first)) for first, *_ in shape.handles()]
    folds = np.array([each for each in found if each is not None])
    if not len(folds):
        return dict.fromkeys(LEGEND, np.nan)
    return {"fold": float(np.median(folds)), "smooth": float((folds <= SMOOTH).mean())}


def _fold(session: dfd.Deformer, edges: Int64, vertex: int) -> float | None:
    """Return the fold at the border of the part at a vertex, in degrees; None if the blend band is too small."""
    mesh, held = session.mesh, session.add(vertex)
    try:
        parts = bendable_parts(session.bound, session.edit, session.handle(held))
        if not parts:
            return None
        axis = parts[0].axis
        session.move(held, translation=MOTION * axis.length * np.asarray(frame_of_normal(axis.direction)[1]))
        weights = session.following[:, 0]
        in_band = ((weights > 0.01) & (weights < 0.99))[mesh.faces].any(axis=1)
        own = edges[in_band[edges].any(axis=1)]
        change = np.abs(_angles(session.vertices, mesh, own) - _angles(mesh.vertices, mesh, own))
        return float(np.nanquantile(change, 0.99)) if np.isfinite(change).sum() >= LEAST_EDGES else None
    finally:
        session.remove(held)


def _edges(mesh: dfd.Mesh) -> Int64:
    """Return the two faces (E, 2) at each edge between two faces."""
    faces = first_at_place(mesh)[mesh.faces]
    return np.asarray(trimesh.Trimesh(mesh.vertices, faces, process=False).face_adjacency, np.int64)


def _angles(vertices: Float64, mesh: dfd.Mesh, edges: Int64) -> Float64:
    """Return the dihedral angles (E,) at `edges` (E, 2), in degrees; NaN if a face has no area."""
    normals = face_normals(vertices, mesh.faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(length > 1e-12 * mesh.diagonal**2, length, np.nan)
    return np.degrees(np.arccos(np.clip((normals[edges[:, 0]] * normals[edges[:, 1]]).sum(axis=1), -1.0, 1.0)))
