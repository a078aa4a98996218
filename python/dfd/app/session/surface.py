"""Convert the resting shape to the message that the page draws."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol.messages import Group, MaterialEntry, MeshMessage
from dfd.common.linear_algebra import Bool, Float64, Int32, UInt8
from dfd.editing.edit import box_center
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.images import as_image
from dfd.mesh.mesh import Mesh

LONGEST_TEXTURE = 4096  # largest number of texels along a side; every graphics card supports it
JPEG_QUALITY = 92

Arrays = dict[str, NDArray[Any]]


def mesh_message(mesh: Mesh, *, name: str, warnings: Sequence[str]) -> tuple[MeshMessage, Arrays]:
    """Return the message that shows `mesh`, and its arrays. A row of them is a vertex with one normal, uv and color."""
    look, scene = mesh.appearance, mesh.scene
    if look is None:
        vertex = np.arange(len(mesh.vertices), dtype=np.int32) if scene is None else scene.vertex
        corner_faces = mesh.faces if scene is None else scene.corner_faces
        look = Appearance(vertex, corner_faces, np.zeros(len(mesh.faces), np.int32), (Material(),))
    used = look.corners >= 0  # rows that no face uses are left out
    rows, number = look.corners[used], np.cumsum(used, dtype=np.uint32) - np.uint32(1)
    arrays: Arrays = {
        "positions": centered(mesh, mesh.vertices[rows]),
        "vertex": rows.astype(np.uint32),
        "normals": packed_normals(_row_normals(mesh, look.corners, used)),
        "triangles": number[look.corner_faces],
    }
    if look.uv is not None:
        arrays["uv"] = look.uv[used]
    if look.colors is not None:
        arrays["colors"] = np.rint(look.colors[used] * 255).astype(np.uint8)
    materials = []
    for index, material in enumerate(look.materials):
        texture = media_type = None
        if material.texture is not None and "uv" in arrays:
            texture = f"texture{index}"
            data, media_type = _encode_texture(material.texture)
            arrays[texture] = np.frombuffer(data, np.uint8)
        looks = {name: getattr(material, name) for name in ("color", "wrap", "alpha_mode", "alpha_cutoff")}
        materials.append(MaterialEntry(texture=texture, media_type=media_type, **looks))
    message = MeshMessage(
        name=name,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        parts=len(mesh.parts),
        center=box_center(mesh),
        diagonal=mesh.diagonal,
        groups=_material_runs(look.face_material),
        materials=tuple(materials),
        warnings=tuple(warnings),
    )
    return message, arrays


def centered(mesh: Mesh, positions: Float64) -> NDArray[np.float32]:
    """Return positions (N, 3) relative to the center of the bounding box, because float32 is more precise near 0."""
    return (positions - box_center(mesh)).astype(np.float32)


def packed_normals(normals: NDArray[np.floating[Any]]) -> NDArray[np.int16]:
    """Return unit normals (N, 3) times 32767, as (N, 4) int16. The fourth number is 0 and aligns the rows."""
    return np.pad(np.rint(normals * 32767).astype(np.int16), ((0, 0), (0, 1)))


def _row_normals(mesh: Mesh, vertex: Int32, used: Bool) -> Float64:
    """Return unit normals (N, 3) of the `used` rows: the normals in the file if they are valid, else smooth normals."""
    normals = mesh.normals[vertex[used]].astype(np.float64)
    scene = mesh.scene
    if scene is None or len(vertex) != len(scene.vertex):  # if faces have colors, each face corner has a row
        return normals
    of_file = np.zeros((len(vertex), 3))
    for primitive in scene.primitives:
        if primitive.geometry.normals is not None:
            of_file[primitive.rows] = primitive.normals_to_scene(primitive.geometry.normals)
    of_file = of_file[used]
    known = np.isfinite(of_file).all(axis=1, keepdims=True) & of_file.any(axis=1, keepdims=True)
    return np.where(known, of_file, normals)


def _material_runs(material_of: Int32) -> tuple[Group, ...]:
    """Return the runs of consecutive triangles with one material."""
    starts = np.flatnonzero(np.diff(material_of, prepend=-1)).tolist()
    return tuple(
        Group(material=int(material_of[start]), start=start, count=end - start)
        for start, end in zip(starts, [*starts[1:], len(material_of)], strict=True)
    )


def _encode_texture(texture: UInt8) -> tuple[bytes, str]:
    """Return a texture (rows, columns, 4) as a JPEG or PNG file, and its media type."""
    image, stream = as_image(texture), io.BytesIO()
    image.thumbnail((LONGEST_TEXTURE, LONGEST_TEXTURE))  # does not enlarge
    kind = "jpeg" if image.mode == "RGB" else "png"
    image.save(stream, kind, quality=JPEG_QUALITY, subsampling=0, compress_level=1)
    return stream.getvalue(), f"image/{kind}"
