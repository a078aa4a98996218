"""Export a shape cut into parts, as groups of an OBJ file or as materials of a glTF file."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.files import write_file
from dfd.common.linear_algebra import Float32, Float64, Int32, Int64
from dfd.export.gltf.document import GltfDocument
from dfd.mesh.file.gltf.header import MODES_READ, Header, item, objects
from dfd.mesh.file.gltf.read import triangles
from dfd.mesh.file.obj.write import text_faces, text_lines
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.mesh import Mesh
from dfd.segmentation.parts import Part

ENDINGS = (".obj", ".glb", ".gltf")


def export_parts(mesh: Mesh, parts: Sequence[Part], path: str | os.PathLike[str]) -> None:
    """Write a mesh with its parts, as groups "part_1" … of an OBJ file, or as materials of a glTF file.

    A face belongs to the part that contains most of its corners. If the mesh was read from a glTF file, a new glTF file
    keeps all other content of that file. Each part gets copies of the materials on its faces, named after the part.
    An OBJ file keeps texture coordinates, but no materials.

    Raises ValueError if the file ending is not supported, or there are no parts. Raises OSError if the file cannot be
    written; an existing file stays unchanged.
    """
    ending = check.ending("export_parts", "path", path, ENDINGS)
    target = Path(path)
    if not parts:
        raise ArgumentError("parts", "must hold a part, got none", "export_parts")
    of_vertex = np.argmax([part.mask for part in parts], axis=0)
    if ending == ".obj":
        of_face = _most(of_vertex[mesh.faces])
        groups = [(f"part_{number + 1}", np.flatnonzero(of_face == number)) for number in range(len(parts))]
        appearance = mesh.appearance
        uv = None if appearance is None or appearance.uv is None else (appearance.uv, appearance.corner_faces)
        write_file(target, _grouped(mesh.vertices, mesh.faces, uv, groups))
    else:
        document = GltfDocument(mesh)
        for node, primitives in document.parts().items():
            _split(document, node, primitives, of_vertex)
        document.write(target)


def _grouped(
    vertices: Float64, faces: Int32, uv: tuple[Float32, Int32] | None, groups: Sequence[tuple[str, Int64]]
) -> bytes:
    """Return an OBJ file with the faces (F, 3) in `groups`, each of which is a name and the indices of its faces.

    `uv` holds texture coordinates (R, 2), with v pointing up, and the index (F, 3) of each face corner's coordinates.
    """
    text = [text_lines(b"v", vertices), b"" if uv is None else text_lines(b"vt", uv[0])]
    for name, own in groups:
        if len(own):
            text += [f"g {name}\n".encode(), text_faces([faces[own], None if uv is None else uv[1][own]])]
    return b"".join(text)


def _most(corners: Int64) -> Int64:
    """Return the index of each face's part (F,): the part of most corners. `corners` (F, 3) has the corners' parts."""
    return np.sort(corners, axis=1)[:, 1]


def _split(document: GltfDocument, node: int, primitives: Sequence[Primitive], of_vertex: Int64) -> None:
    """Split each primitive of a node into one primitive for each part. `of_vertex` (V,) has each vertex's part."""
    content, of_number = document.own_mesh(node), {each.source[2]: each for each in primitives}
    split: list[Header] = []
    for number, primitive in enumerate(content["primitives"]):
        if number not in of_number or primitive.get("mode", 4) not in MODES_READ:
            split.append(primitive)
            continue
        rows = document.vertex[of_number[number].rows]
        faces = triangles(document.corners(node, number), primitive.get("mode", 4))
        of_face = _most(np.where(rows >= 0, of_vertex[rows], 0)[faces])
        for part in np.unique(of_face).tolist():
            indices = document.accessor(faces[of_face == part].astype("<u4").ravel())
            material = _material(document, primitive.get("material"), part)
            split.append({**primitive, "mode": 4, "indices": indices, "material": material})
    content["primitives"] = split


def _material(document: GltfDocument, material: object, part: int) -> int:
    """Return the index of the copy of `material` for the part with the index `part`. Add the copy if it is missing."""
    materials = objects(document.header, "materials")
    own = item(document.header, "materials", material)
    name = f"part {part + 1}" if own is None else f"{own.get('name') or f'material {material}'} part {part + 1}"
    found = next((number for number, each in enumerate(materials) if each.get("name") == name), None)
    return document.append("materials", {**(own or {}), "name": name}) if found is None else found
