"""Write OBJ files with each vertex once. Along seams, face corners have different texture and normal indices."""

import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from dfd.common.errors import one_line
from dfd.common.linear_algebra import Float64
from dfd.mesh.appearance import GRAY, Material
from dfd.mesh.file.complete import existing_completed
from dfd.mesh.file.edits import rows_as_text
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.file.text import UniqueNames
from dfd.mesh.images import as_png

_SEPARATORS = re.compile(r"[/\\:*?\"<>|\0]")  # characters that some systems do not allow in file names
_LONGEST_NAME = 60  # characters; longer names of materials are cut, because file names of textures contain the names


def encode(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return the files of a mesh, by name: an OBJ file, and the MTL file and textures of its scene."""
    if saving.scene is None:
        text = text_lines(b"v", saving.vertices) + text_faces([saving.faces])
        return {saving.target.name: text}, np.zeros(0)
    complete = existing_completed(saving)
    return _encode_scene(saving.target, saving.vertices, saving.scene, complete.moved), np.zeros(0)


def _encode_scene(target: Path, vertices: Float64, scene: SceneFile, moved: Sequence[Primitive]) -> dict[str, bytes]:
    """Return the files of a scene, by name: the OBJ file `target`, its MTL file and its textures.

    `vertices` (V, 3) are the positions of the mesh, and `moved` are the scene's primitives with moved normals.
    """
    companions = Companions(target)
    library = _MaterialLibrary(target.stem, companions)
    has_materials = any(library.add(each.geometry.material) for each in scene.primitives)
    body: list[bytes] = []
    uv_count = normal_count = 0
    part, said_flat = None, False
    for each in moved:
        local = scene.local_faces(each)
        columns: list[NDArray[np.integer] | None] = [scene.vertex[each.rows][local], None, None]
        if each.part != part:
            part = each.part
            body.append(f"o {one_line(part)}\n".encode())
        uv = each.geometry.uv
        if uv is not None:
            body.append(text_lines(b"vt", uv))
            columns[1] = local + uv_count
            uv_count += len(uv)
        if each.normals is not None:
            body.append(text_lines(b"vn", each.normals_to_scene(each.normals)))
            columns[2] = local + normal_count
            normal_count += len(each.normals)
        elif each.geometry.smoothing is not None and not each.geometry.smoothing.any() and not said_flat:
            said_flat = True  # only glTF files say this, and they say it of all faces without normals
            body.append(b"s off\n")
        used = library.add(each.geometry.material)
        if used is None and has_materials:  # without `usemtl`, the material of the previous primitive would apply
            used = library.plain(1.0 if each.geometry.colors is not None else GRAY)
        if used is not None:
            body.append(f"usemtl {used}\n".encode())
        body.append(text_faces(columns))
    head = f"mtllib {companions.add_library(library.text.encode())}\n".encode() if library.text else b""
    colors = _vertex_colors(scene)
    positions = vertices if colors is None else np.hstack([vertices, colors])
    return {target.name: head + text_lines(b"v", positions) + b"".join(body), **companions.files}


class Companions:
    """The files that are written next to an OBJ file; no existing file with other content is overwritten."""

    def __init__(self, target: Path) -> None:
        self.files: dict[str, bytes] = {}
        self._target = target

    def add(self, name: str, data: bytes) -> str:
        """Add a file and return its name, with a number appended if a file with other content has that name."""
        path, number = PurePosixPath(name), 1
        while not self._is_free(name, data):
            number += 1
            name = f"{path.stem}_{number}{path.suffix}"
        self.files[name] = data
        return name

    def add_library(self, text: bytes) -> str:
        """Add the MTL file and return its name."""
        return self.add(f"{self._target.stem}.mtl", text)

    def _is_free(self, name: str, data: bytes) -> bool:
        if name == self._target.name:
            return False
        if name in self.files:
            return self.files[name] == data
        path = self._target.with_name(name)
        if not (path.exists() or path.is_symlink()):
            return True
        return path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data


class _MaterialLibrary:
    """The materials of a scene, as the text of an MTL file and as texture files."""

    def __init__(self, stem: str, companions: Companions) -> None:
        self.text = ""
        self._stem, self._companions = stem, companions
        self._names: dict[int, str] = {}
        self._unique = UniqueNames(2)

    def add(self, material: Material | None) -> str | None:
        """Add a material on its first use, and return its name; None for a default material."""
        if material is None or material.is_default:
            return None
        if id(material) not in self._names:
            name = self._unused(one_line(material.name).replace(" ", "_"))
            self._names[id(material)] = name
            lines = [f"newmtl {name}", "Kd " + " ".join(f"{each:.6g}" for each in material.color[:3])]
            if material.texture is not None:  # the stem distinguishes textures of different OBJ files
                picture = self._companions.add(f"{self._stem}_{name}.png", as_png(material.texture))
                lines.append(f"map_Kd {picture}")
            self.text += "\n".join([*lines, "", ""])
        return self._names[id(material)]

    def plain(self, gray: float) -> str:
        """Add a material with the color `gray` on its first use, and return its name."""
        if (gray_id := -int(1000 * gray)) not in self._names:
            name = self._names[gray_id] = self._unused("plain")
            self.text += f"newmtl {name}\nKd {gray} {gray} {gray}\n\n"
        return self._names[gray_id]

    def _unused(self, name: str) -> str:
        return self._unique.unique(_SEPARATORS.sub("_", name)[:_LONGEST_NAME] or "material")


def _vertex_colors(scene: SceneFile) -> Float64 | None:
    """Return one RGB color for each vertex, (V, 3), also on seams; None if the scene has no colors."""
    appearance = scene.appearance
    if appearance is None or appearance.colors is None:
        return None
    colors = np.ones((len(scene.vertices), 3))
    used = appearance.corners >= 0
    colors[appearance.corners[used]] = appearance.colors[used, :3]
    return colors[scene.representative]


def text_lines(kind: bytes, values: NDArray[np.floating]) -> bytes:
    return b"".join(b"%s %s\n" % (kind, row) for row in rows_as_text(values))


def text_faces(columns: Sequence[NDArray[np.integer] | None]) -> bytes:
    """Return the `f` lines of faces; `columns` are the indices (F, 3) of positions, UVs and normals, from 0."""
    corner = b"/".join(b"" if column is None else b"%d" for column in columns).rstrip(b"/")
    template = b"f %s\n" % b" ".join([corner] * 3)
    numbers = np.stack([column + 1 for column in columns if column is not None], axis=-1)
    return b"".join(template % tuple(row) for row in numbers.reshape(len(numbers), -1).tolist())
