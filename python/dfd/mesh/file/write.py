"""Writing a mesh: the scene of its file with new positions and normals, and everything else unchanged."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dfd.common import check
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Bool, Float64, Int32
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.file import moved_normals
from dfd.mesh.file.gltf import patch as gltf_patch
from dfd.mesh.file.obj import patch as obj_patch
from dfd.mesh.file.obj import write as obj_write
from dfd.mesh.file.primitives import MovedPrimitive, UniqueNames
from dfd.mesh.file.read import ENDINGS
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.normals import smooth_normals

# trimesh takes a third of a second to import: only by what is not written in the file that it came from.
if TYPE_CHECKING:
    import trimesh


def write(
    path: str | os.PathLike[str],
    vertices: Float64,
    faces: Int32,
    *,
    appearance: Appearance | None = None,
    scene: SceneFile | None = None,
) -> None:
    """Write a mesh whose vertices are at `vertices` (V, 3), in the `scene` of its file where it has one.

    Raises what `Mesh.save` raises.
    """
    target = Path(path)
    ending = check.ending("Mesh.save", "path", target, ENDINGS)
    if ending not in (".obj", ".off") and np.abs(vertices).max() > np.finfo(np.float32).max:
        raise ValueError(f"Mesh.save: `vertices` must fit in 32-bit floats for a {ending} file; .obj, .off have more")
    if scene is not None:  # all vertices at one position move with the first of them
        vertices = vertices[scene.representative]
    files: dict[str, bytes]
    if ending == ".off":
        from trimesh.exchange.off import export_off

        files = {target.name: export_off(_bare(vertices, faces), digits=17).encode()}
    elif ending == ".stl":
        from trimesh.exchange.stl import export_stl

        files = {target.name: export_stl(_bare(vertices, faces))}
    elif scene is None:
        files = _encode_bare(target, vertices, faces)
    else:
        files = _encode_scene(target, vertices, faces, appearance, scene)
    _write(target, files)


def as_glb(vertices: Float64, faces: Int32, scene: SceneFile | None) -> bytes:
    """Return the GLB file of a mesh at rest whose `scene` is that of no glTF file.

    Each primitive is a node with a mesh of its own: in the order of the scene's, by the names that `UniqueNames` makes
    of its parts'.
    """
    if scene is None:
        return _encode_bare(Path("mesh.glb"), vertices, faces)["mesh.glb"]
    moved = [MovedPrimitive(each, each.geometry.vertices, each.normals, False) for each in scene.primitives]
    return _encode_gltf(Path("mesh.glb"), _rebuild(moved))["mesh.glb"]


def _write(target: Path, files: dict[str, bytes]) -> None:
    """Write all files under temporary names, then rename them, `target` last: it never references a missing file."""
    names = sorted(files, key=lambda name: name != target.name)  # the first one entered is renamed last
    try:
        with ExitStack() as stack:
            for name in names:
                temporary = stack.enter_context(atomic_write(target.with_name(name)))
                temporary.write_bytes(files[name])
    except OSError as error:
        first = error  # each enclosing `atomic_write` wraps the error again: find the first
        while isinstance(first.__cause__, OSError) and isinstance(first.__cause__.__cause__, OSError):
            first = first.__cause__
        raise first from first.__cause__


def _bare(vertices: Float64, faces: Int32) -> trimesh.Trimesh:
    import trimesh

    return trimesh.Trimesh(vertices, faces, process=False)


def _encode_bare(target: Path, vertices: Float64, faces: Int32) -> dict[str, bytes]:
    """A mesh without a scene: one part, with smooth normals in formats that would display it faceted."""
    ending = target.suffix.lower()
    if ending == ".obj":
        return {target.name: obj_write.encode(vertices, faces)}
    import trimesh
    from trimesh.exchange.ply import export_ply

    geometry = _bare(vertices, faces)
    if ending == ".ply":
        return {target.name: export_ply(geometry, vertex_normal=False)}
    geometry.vertex_normals = smooth_normals(vertices, faces)
    return _encode_gltf(target, trimesh.Scene({"mesh": geometry}))


def _encode_scene(
    target: Path, vertices: Float64, faces: Int32, appearance: Appearance | None, scene: SceneFile
) -> dict[str, bytes]:
    changed = (vertices != scene.vertices).any(axis=1)
    normals = moved_normals.follow(vertices, scene.vertices, changed, scene)
    ending = target.suffix.lower()
    if ending == ".obj" and scene.obj is not None:
        return obj_patch.encode(target, scene.obj, vertices, normals)
    if ending == ".obj":
        return obj_write.encode_scene(target, vertices, scene, normals)
    moved = _move(vertices, changed, normals, scene)
    if ending == ".ply":
        return {target.name: _encode_ply(vertices, faces, appearance, scene, moved)}
    if scene.gltf is not None:
        return {target.name: gltf_patch.encode(scene.gltf, moved, binary=ending == ".glb")}
    return _encode_gltf(target, _rebuild(moved))


def _encode_gltf(target: Path, scene: trimesh.Scene) -> dict[str, bytes]:
    from trimesh.exchange.gltf import export_glb, export_gltf

    if target.suffix.lower() == ".glb":
        return {target.name: export_glb(scene)}
    files = export_gltf(scene, merge_buffers=True, embed_buffers=True)
    return {target.name: files["model.gltf"]}


def _encode_ply(
    vertices: Float64, faces: Int32, appearance: Appearance | None, scene: SceneFile, moved: Sequence[MovedPrimitive]
) -> bytes:
    """One part is kept as it is; several parts, and textures, which PLY cannot store, become vertex colors."""
    from trimesh.exchange.ply import export_ply

    from dfd.mesh.file.in_trimesh import to_trimesh

    first = moved[0].primitive
    material = first.geometry.material or Material(is_default=True)
    if len(moved) == 1 and (first.geometry.uv is None or (material.texture is None and not material.is_default)):
        normals = None if moved[0].normals is None else first.normals_to_scene(moved[0].normals)
        turned = replace(first.geometry, faces=scene.local_faces(first).astype(np.int64))
        placed = first.to_scene(moved[0].vertices).copy()  # rows that no face uses have no vertex of the mesh
        used = scene.vertex >= 0
        placed[used] = vertices[scene.vertex[used]]
        geometry = to_trimesh(turned, placed, normals, gltf=False, written={})
        return bytes(export_ply(geometry, vertex_normal=normals is not None))
    if appearance is None:
        return bytes(export_ply(_bare(vertices, faces), vertex_normal=False))
    used_rows, corners = np.unique(appearance.corner_faces, return_inverse=True)
    geometry = _bare(vertices[appearance.corners[used_rows]], corners.reshape(-1, 3).astype(np.int32))
    geometry.visual.vertex_colors = np.rint(appearance.row_colors()[used_rows] * 255).astype(np.uint8)
    return bytes(export_ply(geometry, vertex_normal=False))


def _move(
    vertices: Float64, changed: Bool, normals: Sequence[Float64 | None], scene: SceneFile
) -> list[MovedPrimitive]:
    """Convert positions to each primitive's coordinates; unmoved ones are kept bit for bit."""
    result = []
    for each, own_normals in zip(scene.primitives, normals, strict=True):
        rows = scene.vertex[each.rows]
        here = (rows >= 0) & changed[rows]
        local = each.geometry.vertices
        if here.any():
            local = local.copy()
            local[here] = each.from_scene(vertices[rows[here]], here)
        result.append(MovedPrimitive(each, local, own_normals, bool(here.any())))
    return result


def _rebuild(moved: Sequence[MovedPrimitive]) -> trimesh.Scene:
    """Return a scene of the moved primitives; a geometry with several instances is split where they moved."""
    import trimesh

    from dfd.mesh.file.in_trimesh import to_trimesh

    result = trimesh.Scene()
    names, nodes = UniqueNames(), UniqueNames()
    first: dict[int, tuple[MovedPrimitive, str]] = {}
    written: dict[tuple[int, bool], Any] = {}
    for each in moved:
        geometry = each.primitive.geometry
        found = first.get(id(geometry))
        if found is None or each.moved or found[0].moved:
            name = names.unique(each.primitive.name)
            result.geometry[name] = to_trimesh(geometry, each.vertices, each.normals, gltf=True, written=written)
            first.setdefault(id(geometry), (each, name))
        else:
            name = found[1]
        result.graph.update(frame_to=nodes.unique(each.primitive.part), matrix=each.primitive.transform, geometry=name)
    return result
