"""The resting shape for the page: rows, triangles, materials."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dfd.app.protocol.binary_messages import Group, MaterialEntry, MeshMessage, pack
from dfd.common.linear_algebra import Float64, Int32, UInt8
from dfd.mesh.appearance import Material
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import vector

LONGEST_TEXTURE = 4096  # texels along a side, supported by every graphics card
JPEG_QUALITY = 92

Arrays = dict[str, NDArray[Any]]


def center_of(mesh: Mesh) -> Float64:
    """Return the center (3,) of the box, mesh units. Positions are sent relative to it, for precision in float32."""
    return mesh.bounds[0] / 2 + mesh.bounds[1] / 2


def mesh_message(mesh: Mesh, *, name: str, warnings: Sequence[str]) -> bytes:
    """Return the message that shows `mesh`."""
    rows, corner_faces = _rows(mesh)
    textures, materials = _materials(mesh)
    none = np.zeros(len(mesh.faces), np.int32)
    message = MeshMessage(
        name=name,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        parts=len(mesh.parts),
        center=vector("center", center_of(mesh)),
        diagonal=mesh.diagonal,
        groups=_material_runs(none if mesh.appearance is None else mesh.appearance.face_material),
        materials=materials,
        warnings=tuple(warnings),
    )
    return pack(message, **_row_arrays(mesh, rows), triangles=corner_faces.astype(np.uint32), **textures)


def _row_arrays(mesh: Mesh, rows: Int32) -> Arrays:
    """Return the arrays with one entry per row, by name."""
    arrays: Arrays = {
        "positions": (mesh.vertices[rows] - center_of(mesh)).astype(np.float32),
        "vertex": rows.astype(np.uint32),
        "normals": packed_normals(_row_normals(mesh, rows)),
    }
    appearance = mesh.appearance
    if appearance is not None:
        used = _corners(mesh)[0] >= 0
        if appearance.uv is not None:
            arrays["uv"] = appearance.uv[used]
        if appearance.colors is not None:
            arrays["colors"] = np.rint(appearance.colors[used] * 255).astype(np.uint8)
    return arrays


def _materials(mesh: Mesh) -> tuple[Arrays, tuple[MaterialEntry, ...]]:
    """Return the encoded textures as arrays, and the materials."""
    appearance = mesh.appearance
    arrays: Arrays = {}
    materials: list[MaterialEntry] = []
    for index, material in enumerate(appearance.materials if appearance is not None else (Material(),)):
        texture = media_type = None
        if material.texture is not None and appearance is not None and appearance.uv is not None:
            texture = f"texture{index}"
            data, media_type = _encode_texture(material.texture)
            arrays[texture] = np.frombuffer(data, np.uint8)
        looks = {name: getattr(material, name) for name in ("color", "wrap", "alpha_mode", "alpha_cutoff")}
        materials.append(MaterialEntry(texture=texture, media_type=media_type, **looks))
    return arrays, tuple(materials)


def packed_normals(normals: NDArray[np.floating[Any]]) -> NDArray[np.int16]:
    """Return unit normals (N, 3) as (N, 4) int16 in units of 1 / 32767; the fourth is 0, for alignment."""
    packed = np.zeros((len(normals), 4), np.int16)
    packed[:, :3] = np.rint(normals * 32767)
    return packed


def _corners(mesh: Mesh) -> tuple[Int32, Int32]:
    """Return the vertex (R,) of each row, -1 for rows without a face, and the rows (F, 3) of the faces' corners."""
    if mesh.appearance is not None:
        return mesh.appearance.corners, mesh.appearance.corner_faces
    if mesh.scene is not None:
        return mesh.scene.vertex, mesh.scene.corner_faces
    return np.arange(len(mesh.vertices), dtype=np.int32), mesh.faces


def _rows(mesh: Mesh) -> tuple[Int32, Int32]:
    """Return the result of `_corners` without rows that have no face."""
    vertex, corner_faces = _corners(mesh)
    used = vertex >= 0
    if used.all():
        return vertex, corner_faces
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return vertex[used], number[corner_faces]


def _row_normals(mesh: Mesh, rows: Int32) -> Float64:
    """Return unit normals (R, 3): those of the file, which keep sharp edges, or else smooth normals."""
    normals = mesh.normals[rows].astype(np.float64)
    scene = mesh.scene
    vertex, _ = _corners(mesh)
    if scene is None or len(vertex) != len(scene.vertex):  # face colors split rows
        return normals
    all_normals = np.zeros((len(vertex), 3))
    for primitive in scene.primitives:
        if primitive.geometry.normals is not None:
            all_normals[primitive.rows] = primitive.normals_to_scene(primitive.geometry.normals)
    file_normals = all_normals[vertex >= 0]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        file_normals = file_normals / np.linalg.norm(file_normals, axis=1, keepdims=True)
    return np.where(np.isfinite(file_normals).all(axis=1, keepdims=True), file_normals, normals)


def _material_runs(material_of: Int32) -> tuple[Group, ...]:
    """Return the runs of consecutive triangles with one material."""
    starts = np.flatnonzero(np.diff(material_of, prepend=-1)).tolist()
    ends = [*starts[1:], len(material_of)]
    return tuple(
        Group(material=int(material_of[start]), start=start, count=end - start)
        for start, end in zip(starts, ends, strict=True)
    )


def _encode_texture(texture: UInt8) -> tuple[bytes, str]:
    """Return a texture (rows, columns, 4) as a JPEG or PNG file, and its media type."""
    image = Image.fromarray(texture)
    if max(image.size) > LONGEST_TEXTURE:
        image.thumbnail((LONGEST_TEXTURE, LONGEST_TEXTURE))
    stream = io.BytesIO()
    if (texture[..., 3] == 255).all():
        image.convert("RGB").save(stream, "JPEG", quality=JPEG_QUALITY, subsampling=0)
        return stream.getvalue(), "image/jpeg"
    image.save(stream, "PNG", compress_level=1)
    return stream.getvalue(), "image/png"
