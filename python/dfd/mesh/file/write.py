"""Write a mesh to a file. A mesh from a file keeps its scene, in which only positions and normals change."""

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Float64, Int32, Int64, group_sums
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.file.edits import COARSE, rounding
from dfd.mesh.file.gltf import patch as gltf_patch
from dfd.mesh.file.gltf.build import encode_scene
from dfd.mesh.file.obj import patch as obj_patch
from dfd.mesh.file.obj import write as obj_write
from dfd.mesh.file.plain import off_stl, ply
from dfd.mesh.file.primitives import Geometry, MeshInstance, Primitive, place
from dfd.mesh.file.read import ENDINGS
from dfd.mesh.file.scene_file import FileSource, SceneFile
from dfd.mesh.normals import face_normals, smooth_normals
from dfd.mesh.weld import weld


def write(
    path: str | os.PathLike[str], vertices: Float64, faces: Int32, look: Appearance | None, scene: SceneFile | None
) -> Float64:
    """Write a mesh with its vertices at `vertices` (V, 3). A mesh from a file keeps the other content of its `scene`.

    Return the distances (N,) by which rounding to 32-bit floats moves vertices. Only STL files, and moved glTF meshes
    with a skin or morph targets, give such distances; N is 0 for all other files. Raises the errors of `Mesh.save`.
    """
    target = Path(path)
    ending = check.ending("Mesh.save", "path", target, ENDINGS)
    if ending in (".glb", ".gltf", ".stl") and np.abs(vertices).max() > np.finfo(np.float32).max:
        raise ValueError(f"Mesh.save: `vertices` must fit in 32-bit floats for a {ending} file; use .obj or .off")
    if scene is not None:
        vertices = vertices[scene.representative]  # all vertices at one position move with the first vertex there
    moved = moved_primitives(vertices, scene)
    lost = np.zeros(0)
    files: dict[str, bytes] = {}
    if scene is not None and scene.source is not None and scene.source.path.suffix.lower() == ending:
        files, lost = _rewrite(target, scene.source, vertices, scene, moved)
    elif ending == ".obj" and scene is not None:
        files = obj_write.encode_scene(target, vertices, scene, moved)
    elif ending == ".obj":
        files[target.name] = obj_write.encode(vertices, faces)
    elif ending == ".off":
        files[target.name] = off_stl.encode_off(vertices, faces)
    elif ending == ".stl":
        lost = rounding(vertices[faces.ravel()])
        files[target.name] = off_stl.encode_stl(vertices[faces.ravel()])
    elif ending == ".ply":
        files[target.name] = _encode_ply(vertices, faces, look, scene, moved)
    elif scene is not None and scene.gltf is not None:
        files[target.name] = gltf_patch.encode(scene.gltf, moved, binary=ending == ".glb")
        kept = [each for each in moved if each.moved and gltf_patch.keeps_origin(scene.gltf, each)]
        lost = np.concatenate([lost, *(rounding(each.vertices) for each in kept)])
    else:
        files[target.name] = as_gltf(vertices, faces, scene, moved, binary=ending == ".glb")
    _write(target, files)
    size = float(np.linalg.norm(np.ptp(vertices[faces.ravel()], axis=0)))
    if lost.max(initial=0.0) > COARSE * size:
        check.warn(
            f"Mesh.save: `path` {path} has 32-bit floats, which move vertices by up to {lost.max():.3g} "
            f"({100 * lost.max() / size:.2g} % of the shape); .ply, .obj and .off files avoid this",
            UserWarning,
        )
    return lost


def as_gltf(
    vertices: Float64, faces: Int32, scene: SceneFile | None, moved: Sequence[Primitive], *, binary: bool
) -> bytes:
    """Return a GLB or glTF file of a mesh that was not read from such a file, with the positions `vertices` (V, 3).

    Primitives without normals get smooth normals, because glTF viewers use flat shading for primitives without normals.
    """
    if scene is None:
        normals = smooth_normals(vertices, faces).astype(np.float64)
        moved, _ = place([MeshInstance("mesh", "mesh", Geometry(vertices, faces.astype(np.int64), normals))])
    elif any(each.normals is None for each in moved):
        normals = smooth_normals(vertices, scene.representative[faces])[scene.representative].astype(np.float64)
        # glTF requires normals of unit length, even at vertices whose faces have no area.
        normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)
        moved = [
            each
            if each.normals is not None
            else replace(each, normals=each.normals_from_scene(normals[scene.vertex[each.rows]]))
            for each in moved
        ]
    return encode_scene(moved, binary=binary)


def _write(target: Path, files: dict[str, bytes]) -> None:
    """Write all files under temporary names, then rename them: `target` last, because it refers to the other files."""
    names = sorted(files, key=lambda name: name != target.name)  # the file entered first is renamed last
    try:
        with ExitStack() as stack:
            for name in names:
                temporary = stack.enter_context(atomic_write(target.with_name(name)))
                temporary.write_bytes(files[name])
    except OSError as error:
        first = error  # each enclosing `atomic_write` wraps the error again; find the innermost error
        while isinstance(first.__cause__, OSError) and isinstance(first.__cause__.__cause__, OSError):
            first = first.__cause__
        raise first from first.__cause__


def _rewrite(
    target: Path, source: FileSource, vertices: Float64, scene: SceneFile, moved: Sequence[Primitive]
) -> tuple[dict[str, bytes], Float64]:
    """Return the contents of the rewritten files by name, and the distances by which a binary STL file rounds."""
    data, lost, ending = source.data.tobytes(), np.zeros(0), source.path.suffix.lower()
    normals = np.concatenate(
        [np.full(each.vertices.shape, np.nan) if each.normals is None else each.normals for each in moved]
    )
    if ending == ".obj":
        return obj_patch.encode(target, vertices, source, normals), lost
    if source.numbers is None:
        corners = vertices[scene.vertex]
        new = off_stl.rewrite_stl(data, corners)
        lost = lost if off_stl.binary_stl(data) is None else rounding(corners)
    else:
        of_vertices = np.full(vertices.shape, np.nan)
        of_vertices[source.numbers] = normals
        rewrite = ply.rewrite if ending == ".ply" else off_stl.rewrite_off
        new = rewrite(data, vertices, of_vertices)
    return {target.name: new}, lost


def _encode_ply(
    vertices: Float64, faces: Int32, look: Appearance | None, scene: SceneFile | None, moved: Sequence[Primitive]
) -> bytes:
    """Return a PLY file. Several primitives are merged. Textures, which PLY cannot store, become vertex colors."""
    if scene is not None and len(moved) == 1:
        first, geometry = moved[0], moved[0].geometry
        material = geometry.material or Material(is_default=True)
        if geometry.uv is None or (material.texture is None and not material.is_default):
            placed = first.to_scene(first.vertices).copy()  # the mesh has no vertex for rows that no face uses
            used = scene.vertex >= 0
            placed[used] = vertices[scene.vertex[used]]
            normals = None if first.normals is None else first.normals_to_scene(first.normals)
            local = scene.local_faces(first).astype(np.int64)
            return ply.encode(replace(geometry, vertices=placed, faces=local, normals=normals))
    if look is None:
        return ply.encode(Geometry(vertices, faces.astype(np.int64)))
    used_rows, corners = np.unique(look.corner_faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    colors = look.corner_colors(corners, len(used_rows))
    return ply.encode(Geometry(vertices[look.corners[used_rows]], corners, colors=colors))


def moved_primitives(vertices: Float64, scene: SceneFile | None) -> list[Primitive]:
    """Return the primitives after the mesh moves to `vertices` (V, 3). Unmoved vertices keep their exact values."""
    if scene is None:
        return []
    changed = (vertices != scene.vertices).any(axis=1)
    result = []
    for each, own_normals in zip(scene.primitives, moved_normals(vertices, scene.vertices, scene), strict=True):
        rows = scene.vertex[each.rows]
        here = (rows >= 0) & changed[rows]
        local = each.vertices
        if here.any():
            local = local.copy()
            local[here] = each.from_scene(vertices[rows[here]], here)
        result.append(replace(each, vertices=local, normals=own_normals, moved=bool(here.any())))
    return result


def moved_normals(vertices: Float64, before: Float64, scene: SceneFile) -> list[Float64 | None]:
    """Return the new normals of each primitive in local coordinates; None for a primitive without normals in the file.

    The vertices move from `before` (V, 3) to `vertices` (V, 3). Rows, which are vertices of primitives, belong to one
    smooth surface if they have equal positions and equal normals, even on both sides of a texture seam. These rows get
    one new normal: the area-weighted mean of the normals of their faces. Rows with equal positions and different
    normals lie on different sides of a sharp edge. Rows whose faces have not moved keep the exact normals of the file.
    """
    own = [each.normals for each in scene.primitives]
    changed = (vertices != before).any(axis=1)
    if not changed.any() or all(normals is None for normals in own):
        return own
    placed = np.concatenate(
        [
            np.zeros(each.vertices.shape) if each.normals is None else each.normals_to_scene(each.normals)
            for each in scene.primitives
        ]
    )
    _, normal = weld(placed)
    key = scene.vertex.astype(np.int64) * (int(normal.max()) + 1) + normal
    first, group = np.unique(key, return_index=True, return_inverse=True)[1:]
    faces = group[scene.corner_faces]
    stale = np.zeros(len(first), bool)
    stale[faces[changed[scene.faces].any(axis=1)]] = True
    new = _normal_sums(vertices, scene, faces, len(first))
    # If the winding of faces contradicts the old normals, as under mirroring transforms, new normals are flipped.
    inward = np.einsum("ij,ij->i", _normal_sums(before, scene, faces, len(first)), placed[first]) < 0
    new[inward] *= -1
    stale &= np.linalg.norm(new, axis=1) > 0
    result: list[Float64 | None] = []
    for each, normals in zip(scene.primitives, own, strict=True):
        if normals is not None:
            here = group[each.rows]
            normals = normals.copy()
            normals[stale[here]] = each.normals_from_scene(new[here[stale[here]]], stale[here])
        result.append(normals)
    return result


def _normal_sums(vertices: Float64, scene: SceneFile, faces: Int64, count: int) -> Float64:
    """Return the sum (count, 3) of the face normals of each group; a normal is as long as twice its face's area."""
    return group_sums(faces.ravel(), np.repeat(face_normals(vertices, scene.faces), 3, axis=0), count)
