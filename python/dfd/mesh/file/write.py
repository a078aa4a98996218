"""Writing of a mesh: the scene of its file with new positions and normals; all else stays."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Float64, Int32
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.file import moved_normals
from dfd.mesh.file.edits import COARSE, rounding
from dfd.mesh.file.gltf import patch as gltf_patch
from dfd.mesh.file.gltf.build import encode_scene
from dfd.mesh.file.obj import patch as obj_patch
from dfd.mesh.file.obj import write as obj_write
from dfd.mesh.file.plain import off_stl, ply
from dfd.mesh.file.primitives import Geometry, MeshInstance, MovedPrimitive, place
from dfd.mesh.file.read import ENDINGS
from dfd.mesh.file.scene_file import FileSource, SceneFile
from dfd.mesh.normals import smooth_normals


def write(
    path: str | os.PathLike[str],
    vertices: Float64,
    faces: Int32,
    *,
    appearance: Appearance | None = None,
    scene: SceneFile | None = None,
) -> Float64:
    """Write a mesh with its vertices at `vertices` (V, 3), within the `scene` of its file if given.

    Return the distances (N,) by which 32-bit floats of the file move vertices. Raises as `Mesh.save` does.
    """
    target = Path(path)
    ending = check.ending("Mesh.save", "path", target, ENDINGS)
    if ending in (".glb", ".gltf", ".stl") and np.abs(vertices).max() > np.finfo(np.float32).max:
        raise ValueError(f"Mesh.save: `vertices` must fit in 32-bit floats for a {ending} file; .obj, .off have more")
    if scene is not None:  # all vertices at one position move with the first vertex there
        vertices = vertices[scene.representative]
    moved = moved_primitives(vertices, scene)
    lost = np.zeros(0)
    files: dict[str, bytes]
    if scene is not None and scene.source is not None and scene.ending == ending:
        files, lost = _rewrite(target, scene.source, vertices, scene, moved)
    elif ending == ".obj":
        files = (
            {target.name: obj_write.encode(vertices, faces)}
            if scene is None
            else obj_write.encode_scene(target, vertices, scene, moved)
        )
    elif ending == ".off":
        files = {target.name: off_stl.encode_off(vertices, faces)}
    elif ending == ".stl":
        lost = rounding(vertices[faces.ravel()])
        files = {target.name: off_stl.encode_stl(vertices[faces.ravel()])}
    elif ending == ".ply":
        files = {target.name: _encode_ply(vertices, faces, appearance, scene, moved)}
    elif scene is not None and scene.gltf is not None:
        files = {target.name: gltf_patch.encode(scene.gltf, moved, binary=ending == ".glb")}
        kept = [each for each in moved if each.moved and gltf_patch.keeps_origin(scene.gltf, each)]
        lost = np.concatenate([lost, *(rounding(each.vertices) for each in kept)])
    else:
        files = {target.name: as_gltf(vertices, faces, scene, moved, binary=ending == ".glb")}
    _write(target, files)
    size = float(np.linalg.norm(np.ptp(vertices[faces.ravel()], axis=0)))
    if lost.max(initial=0.0) > COARSE * size:
        check.warn(
            f"Mesh.save: `path` {path} has 32-bit floats, which move vertices by up to {lost.max():.3g} "
            f"({100 * lost.max() / size:.2g} % of the shape); .ply, .obj and .off keep them",
            UserWarning,
        )
    return lost


def as_gltf(
    vertices: Float64, faces: Int32, scene: SceneFile | None, moved: Sequence[MovedPrimitive], *, binary: bool
) -> bytes:
    """Return the GLB or glTF file of a scene from another format, or of a mesh without a scene.

    Primitives without normals get smooth normals, because readers shade a glTF file without normals flat.
    """
    if scene is not None:
        moved = _smoothed(vertices, faces, scene, moved)
    else:
        geometry = Geometry(vertices, faces.astype(np.int64), smooth_normals(vertices, faces).astype(np.float64))
        (primitive,), _ = place([MeshInstance("mesh", "mesh", geometry)])
        moved = [MovedPrimitive(primitive, vertices, geometry.normals, False)]
    return encode_scene(moved, binary=binary)


def _smoothed(
    vertices: Float64, faces: Int32, scene: SceneFile, moved: Sequence[MovedPrimitive]
) -> Sequence[MovedPrimitive]:
    if all(each.normals is not None for each in moved):
        return moved
    normals = smooth_normals(vertices, scene.representative[faces])[scene.representative].astype(np.float64)
    # glTF requires unit length, also of vertices without a face of nonzero area.
    normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)
    return [
        each
        if each.normals is not None
        else replace(each, normals=each.primitive.normals_from_scene(normals[scene.vertex[each.primitive.rows]]))
        for each in moved
    ]


def _write(target: Path, files: dict[str, bytes]) -> None:
    """Write all files under temporary names, then rename them; `target` is last, so it references no missing file."""
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


def _rewrite(
    target: Path, source: FileSource, vertices: Float64, scene: SceneFile, moved: Sequence[MovedPrimitive]
) -> tuple[dict[str, bytes], Float64]:
    """Return the scene's own file with other positions, and the distances by which 32-bit floats of STL move them."""
    data, lost = source.data.tobytes(), np.zeros(0)
    normals = np.concatenate(
        [np.full(each.vertices.shape, np.nan) if each.normals is None else each.normals for each in moved]
    )
    if scene.ending == ".obj":
        return obj_patch.encode(target, vertices, scene, normals), lost
    if source.numbers is None:
        corners = vertices[scene.vertex]
        new = off_stl.rewrite_stl(data, corners)
        lost = lost if off_stl.binary_stl(data) is None else rounding(corners)
    else:
        of_vertices = np.full(vertices.shape, np.nan)
        of_vertices[source.numbers] = normals
        rewrite = ply.rewrite if scene.ending == ".ply" else off_stl.rewrite_off
        new = rewrite(data, vertices, of_vertices)
    return {target.name: new}, lost


def _encode_ply(
    vertices: Float64,
    faces: Int32,
    appearance: Appearance | None,
    scene: SceneFile | None,
    moved: Sequence[MovedPrimitive],
) -> bytes:
    """Return a PLY file; several parts are merged, and textures, which PLY cannot store, become vertex colors."""
    first = moved[0].primitive if len(moved) == 1 else None
    if first is not None and scene is not None:
        geometry = first.geometry
        material = geometry.material or Material(is_default=True)
        if geometry.uv is None or (material.texture is None and not material.is_default):
            placed = first.to_scene(moved[0].vertices).copy()  # the mesh has no vertex for rows that no face uses
            used = scene.vertex >= 0
            placed[used] = vertices[scene.vertex[used]]
            normals = None if moved[0].normals is None else first.normals_to_scene(moved[0].normals)
            local = scene.local_faces(first).astype(np.int64)
            return ply.encode(replace(geometry, vertices=placed, faces=local, normals=normals))
    if appearance is None:
        return ply.encode(Geometry(vertices, faces.astype(np.int64)))
    used_rows, corners = np.unique(appearance.corner_faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    colors = appearance.corner_colors(corners, len(used_rows))
    return ply.encode(Geometry(vertices[appearance.corners[used_rows]], corners, colors=colors))


def moved_primitives(vertices: Float64, scene: SceneFile | None) -> list[MovedPrimitive]:
    """Convert positions (V, 3) to each primitive's coordinates; unmoved rows keep their bits."""
    if scene is None:
        return []
    changed = (vertices != scene.vertices).any(axis=1)
    normals = moved_normals.follow(vertices, scene.vertices, changed, scene)
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
