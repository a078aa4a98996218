"""Add normals where a file has none: smooth ones, but on both sides of two-sided sheets the side's own."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64, Int64, group_sums, unit
from dfd.common.normals import face_normals, split_sheets
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.primitives import Geometry, MeshInstance, Primitive, place

_LEAST = 0.1  # smallest cosine between a smooth normal and the normal of the vertex's own faces


def existing_completed(saving: Saving) -> Saving:
    """Give a normal to each vertex whose normal is missing, in the primitives that have normals."""
    if saving.scene is None or all(each.normals is None for each in saving.moved):
        return saving
    moved = [
        each if each.normals is None else _with_normals(each, saving, saving.scene.vertex[each.rows])
        for each in saving.moved
    ]
    return replace(saving, moved=moved)


def all_completed(saving: Saving) -> tuple[list[Primitive], Int64]:
    """Return primitives that have normals, and the mesh vertex (R,) of each of their rows; −1 if no face uses a row.

    A vertex becomes several rows if faces of both sides of a sheet share it, or if faces have their own colors.
    """
    scene, vertices, primitives = saving.scene, saving.vertices, saving.moved
    if scene is None:
        primitives = place([MeshInstance("mesh", "mesh", Geometry(vertices, saving.faces.astype(np.int64)))])[0]
    result, rows = [], []
    for each in primitives:
        vertex = np.arange(len(vertices)) if scene is None else scene.vertex[each.rows]
        own, faces = np.arange(len(vertex)), each.geometry.faces
        if each.geometry.face_colors is not None:
            own, faces = faces.ravel(), np.arange(faces.size).reshape(-1, 3)
        if each.normals is None:
            normals = face_normals(vertices, saving.faces[each.faces])
            sources, faces = split_sheets(faces, normals, len(own))
            own = own[sources]
        taken = each if faces is each.geometry.faces else _taken(each, own, faces)
        result.append(_with_normals(taken, saving, vertex[own]))
        rows.append(vertex[own].astype(np.int64))
    return result, np.concatenate(rows)


def _taken(each: Primitive, rows: Int64, faces: Int64) -> Primitive:
    """Return a primitive with the vertices `rows` (R,) of `each`, and with `faces` (F, 3) between these rows."""
    old = each.geometry
    uv, colors = (None if old.uv is None else old.uv[rows]), (None if old.colors is None else old.colors[rows])
    if old.face_colors is not None:
        colors = np.zeros((len(rows), 4), np.float32)
        colors[faces] = old.face_colors[:, None]
    attributes = {name: values[rows] for name, values in old.attributes.items()}
    geometry = Geometry(old.vertices[rows], faces, None, uv, colors, None, old.material, attributes)
    own = None if each.normals is None else each.normals[rows]
    return replace(each, geometry=geometry, vertices=each.vertices[rows], normals=own, moved=True)


def _with_normals(each: Primitive, saving: Saving, vertex: NDArray[np.integer]) -> Primitive:
    """Return a primitive in which each missing normal is computed from the faces around its vertex.

    `vertex` (N,) is the mesh vertex of each row. In meshes from arrays, only faces of the same row count.
    """
    given = np.zeros(each.vertices.shape) if each.normals is None else each.normals
    missing = ~(np.isfinite(given).all(axis=1) & given.any(axis=1))
    if not missing.any():
        return each
    scaled = saving.vertices / (float(np.ptp(saving.vertices, axis=0).max()) or 1.0)
    of_faces = face_normals(scaled, saving.faces)
    own = unit(_sums(each.geometry.faces, of_faces[each.faces], len(vertex)))
    around = own
    if saving.scene is not None:
        smooth = unit(_sums(saving.faces, of_faces, len(saving.vertices)))
        around = np.where(vertex[:, None] >= 0, smooth[vertex], 0.0)
    agrees = (np.einsum("ni,ni->n", around, own) >= _LEAST) | ~own.any(axis=1)
    found = np.where(agrees[:, None], around, own)
    found[~found.any(axis=1)] = (0.0, 0.0, 1.0)  # glTF requires unit length
    normals = given.copy()
    normals[missing] = each.normals_from_scene(found[missing], missing)
    return replace(each, normals=normals)


def _sums(faces: NDArray[np.integer], normals: Float64, count: int) -> Float64:
    """Return the sum (count, 3) of the normals (F, 3) of the faces (F, 3) at each vertex."""
    return group_sums(faces.ravel(), np.repeat(normals, 3, axis=0), count)
