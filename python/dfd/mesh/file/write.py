"""Writing a mesh: the scene of its file, with positions and normals moved and everything else as it was."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.gltf import export_glb, export_gltf
from trimesh.exchange.off import export_off
from trimesh.exchange.ply import export_ply
from trimesh.exchange.stl import export_stl

from dfd.common.files import atomic_write
from dfd.mesh.appearance import Appearance
from dfd.mesh.file import gltf_patch, moved_normals, obj_write, visuals
from dfd.mesh.file.parts import MovedPart
from dfd.mesh.file.read import ENDINGS, SceneFile
from dfd.mesh.normals import smooth_normals

__all__ = ["write"]


def write(
    path: str | os.PathLike[str],
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    *,
    appearance: Appearance | None = None,
    scene: SceneFile | None = None,
) -> None:
    """Write a mesh whose vertices are at `vertices` (V, 3), in the `scene` of its file where it has one.

    Raises what `Mesh.save` raises.
    """
    target = Path(path)
    ending = target.suffix.lower()
    if ending not in ENDINGS:
        raise ValueError(f"Mesh.save: `path` must end in {', '.join(ENDINGS)}, got {target}")
    if ending not in (".obj", ".off") and np.abs(vertices).max() > np.finfo(np.float32).max:
        raise ValueError(
            f"Mesh.save: `vertices` must fit in 32-bit floats for a {ending} file; .obj and .off have more"
        )
    files: dict[str, bytes]
    if ending == ".off":
        files = {target.name: export_off(_bare(vertices, faces), digits=17).encode()}
    elif ending == ".stl":
        files = {target.name: export_stl(_bare(vertices, faces))}
    elif scene is None:
        files = _encode_bare(target, vertices, faces)
    else:
        files = _encode_scene(target, vertices, faces, appearance, scene)
    _write(target, files)


def _write(target: Path, files: dict[str, bytes]) -> None:
    """Write all files beside their places, then rename them, `target` last: it never names a file that is not there."""
    names = sorted(files, key=lambda name: name != target.name)  # the first one entered is renamed last
    try:
        with ExitStack() as stack:
            for name in names:
                temporary = stack.enter_context(atomic_write(target.with_name(name)))
                temporary.write_bytes(files[name])
    except OSError as error:
        first = error  # each file on the way out puts its own sentence around that of the one that failed
        while isinstance(first.__cause__, OSError) and isinstance(first.__cause__.__cause__, OSError):
            first = first.__cause__
        raise first from first.__cause__


def _bare(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, process=False)


def _encode_bare(target: Path, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> dict[str, bytes]:
    """A mesh that no file knows: one part, smooth in formats that would show it faceted otherwise."""
    geometry = _bare(vertices, faces)
    if target.suffix.lower() in (".glb", ".gltf"):
        geometry.vertex_normals = smooth_normals(vertices, faces)
        return _encode_gltf(target, trimesh.Scene({"mesh": geometry}))
    if target.suffix.lower() == ".ply":
        return {target.name: export_ply(geometry, vertex_normal=False)}
    return {target.name: obj_write.encode(vertices, faces)}


def _encode_scene(
    target: Path,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    appearance: Appearance | None,
    scene: SceneFile,
) -> dict[str, bytes]:
    moved = _move(vertices, scene.vertices, scene)
    ending = target.suffix.lower()
    if ending == ".obj":
        return obj_write.encode_scene(target.name, vertices, scene, [each.normals for each in moved])
    if ending == ".ply":
        return {target.name: _encode_ply(vertices, faces, appearance, moved)}
    if scene.gltf is not None:
        return {target.name: gltf_patch.encode(scene.gltf, moved, binary=ending == ".glb")}
    return _encode_gltf(target, _rebuild(moved))


def _encode_gltf(target: Path, scene: trimesh.Scene) -> dict[str, bytes]:
    if target.suffix.lower() == ".glb":
        return {target.name: export_glb(scene)}
    files = export_gltf(scene, merge_buffers=True, embed_buffers=True)
    return {target.name: files["model.gltf"]}


def _encode_ply(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    appearance: Appearance | None,
    moved: Sequence[MovedPart],
) -> bytes:
    """One part stays as it is; several, and textures, which PLY has no room for, become coloured vertices."""
    first = moved[0]
    if len(moved) == 1 and not visuals.has_image(first.part.geometry):
        geometry = visuals.rebuilt(first.part.geometry, first.vertices, first.normals)
        geometry.apply_transform(first.part.transform)
        return bytes(export_ply(geometry, vertex_normal=first.normals is not None))
    if appearance is None:
        return bytes(export_ply(_bare(vertices, faces), vertex_normal=False))
    used, corners = np.unique(appearance.corner_faces, return_inverse=True)
    geometry = _bare(vertices[appearance.corners[used]], corners.reshape(-1, 3).astype(np.int32))
    geometry.visual.vertex_colors = np.rint(appearance.row_colors()[used] * 255).astype(np.uint8)
    return bytes(export_ply(geometry, vertex_normal=False))


def _move(vertices: NDArray[np.float64], before: NDArray[np.float64], scene: SceneFile) -> list[MovedPart]:
    """Bring moved positions and normals back into each part's own coordinates; what has not moved keeps its bits."""
    changed = (vertices != before).any(axis=1)
    normals = moved_normals.follow(vertices, before, changed, scene)
    result = []
    for part, part_normals in zip(scene.parts, normals, strict=True):
        rows = scene.vertex[part.rows]
        here = (rows >= 0) & changed[rows]
        local = part.geometry.vertices.view(np.ndarray).copy()
        if here.any():
            # a transform that flattens its part has no inverse; the pseudo-inverse moves within what is left
            back = np.linalg.pinv(part.transform[:3, :3])
            local[here] = (vertices[rows[here]] - part.transform[:3, 3]) @ back.T
        result.append(MovedPart(part, local, part_normals, part.normals, bool(here.any())))
    return result


def _rebuild(moved: Sequence[MovedPart]) -> trimesh.Scene:
    """Return a scene of the moved parts; a geometry that is placed twice is split where its places moved."""
    result = trimesh.Scene()
    taken: dict[str, MovedPart] = {}
    for each in moved:
        name = each.part.name
        first = taken.setdefault(name, each)
        if first is not each and (first.moved or each.moved):
            name = trimesh.util.unique_name(name, result.geometry)
        if first is each or name != each.part.name:
            result.geometry[name] = visuals.rebuilt(each.part.geometry, each.vertices, each.normals)
        result.graph.update(frame_to=each.part.node, matrix=each.part.transform, geometry=name)
    return result
