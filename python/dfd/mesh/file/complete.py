"""Add normals where a file has none, shaded as the file says (see `shading`)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.primitives import Geometry, MeshInstance, Primitive, place
from dfd.mesh.file.shading import SMOOTH, UNSAID, corner_normals
from dfd.mesh.normals import smooth_normals


def existing_completed(saving: Saving) -> Saving:
    """Give the smooth normal of its vertex to each row whose normal is missing, in the primitives that have normals."""
    rows = [_missing(each) if each.normals is not None else np.zeros(0, bool) for each in saving.moved]
    if not any(missing.any() for missing in rows):
        return saving
    normals, vertex = smooth_normals(saving.vertices, saving.faces).astype(np.float64), saving.file.vertex
    moved = zip(saving.moved, rows, strict=True)
    return replace(saving, moved=[_with_normals(each, some, normals[vertex[each.rows]]) for each, some in moved])


def all_completed(saving: Saving) -> tuple[list[Primitive], Int64]:
    """Return primitives that have normals, and the mesh vertex (R,) of each of their rows; −1 if no face uses a row.

    A vertex becomes several rows if its faces get different normals, or have their own colors. Meshes from arrays and
    from trimesh are smooth, and keep their vertices, except those at which faces show both sides.
    """
    scene, vertices, primitives = saving.scene, saving.vertices, saving.moved
    if scene is None:
        geometry = Geometry(vertices, saving.faces.astype(np.int64), smoothing=np.full(len(saving.faces), SMOOTH))
        primitives = place([MeshInstance("mesh", "mesh", geometry)])[0]
    group, normals = np.zeros((len(saving.faces), 3), np.int64), np.zeros((1, 3))
    if any(_missing(each).any() for each in primitives):
        group, normals = corner_normals(vertices, saving.faces, _smoothing(primitives))
    result, rows = [], []
    for each in primitives:
        vertex = np.arange(len(vertices)) if scene is None else scene.vertex[each.rows]
        own, faces = np.arange(len(vertex)), each.geometry.faces
        if each.geometry.face_colors is not None:
            own, faces = faces.ravel(), np.arange(faces.size).reshape(-1, 3)
        missing = _missing(each)[own]
        found = np.zeros((len(own), 3))
        if missing.any():
            own_group = np.where(missing[faces], _groups(each, group), -1)
            sources, divided, number = _split(faces, own_group, len(own))
            found = np.where(number[:, None] >= 0, normals[number], 0.0)
            if len(sources) > len(own):
                own, missing, faces = own[sources], missing[sources], divided
        taken = each if faces is each.geometry.faces else _taken(each, own, faces)
        result.append(_with_normals(taken, missing, found))
        rows.append(vertex[own].astype(np.int64))
    return result, np.concatenate(rows)


def _missing(each: Primitive) -> Bool:
    """Return which rows (N,) of a primitive have no normal: none is given, or it is zero or not finite."""
    if each.normals is None:
        return np.ones(len(each.vertices), bool)
    known: Bool = np.logical_and.reduce(np.isfinite(each.normals), axis=1) & each.normals.any(axis=1)
    return ~known


def _smoothing(primitives: Sequence[Primitive]) -> Int64:
    """Return the smoothing group (F,) of each face of the scene."""
    return np.concatenate(
        [
            np.full(len(each.geometry.faces), UNSAID) if each.geometry.smoothing is None else each.geometry.smoothing
            for each in primitives
        ]
    )


def _groups(each: Primitive, group: Int64) -> Int64:
    """Return the normals (F, 3) of the corners of a primitive, from those of the scene, whose winding may differ."""
    own = group[each.faces]
    return own[:, [0, 2, 1]] if each.mirrored else own


def _split(faces: Int64, group: Int64, count: int) -> tuple[Int64, Int64, Int64]:
    """Divide rows whose corners are in several groups: the first group keeps the row, the others get rows of their own.

    `faces` (F, 3) refer to `count` rows. Return the source (R,) of each row, the faces (F, 3), and the group (R,) of
    each row, or −1.
    """
    width = int(group.max()) + 2
    pairs, corner = np.unique(faces * width + group + 1, return_inverse=True)
    row, of_pair = np.divmod(pairs, width)
    further = np.diff(row, prepend=-1) == 0
    number = np.where(further, count - 1 + np.cumsum(further), row)
    groups = np.full(count + int(further.sum()), -1)
    groups[number] = of_pair - 1
    return np.concatenate([np.arange(count), row[further]]), number[corner.reshape(faces.shape)], groups


def _with_normals(each: Primitive, missing: Bool, found: Float64) -> Primitive:
    """Return a primitive with the normals `found` (N, 3), in scene coordinates, in its rows `missing` (N,)."""
    if not missing.any():
        return each
    found = found[missing]
    found[~found.any(axis=1)] = (0.0, 0.0, 1.0)  # glTF requires unit length
    normals = np.zeros(each.vertices.shape) if each.normals is None else each.normals.copy()
    normals[missing] = each.normals_from_scene(found, missing)
    return replace(each, normals=normals)


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
