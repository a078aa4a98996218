"""OBJ files that keep every vertex once: seams of texture and normals are named by the faces, as the format means it.

(trimesh's writer repeats the vertices along every seam, which tears the surface and renumbers it for other programs.)
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.appearance import GREY
from dfd.mesh.file.materials import vertex_colors
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.file.visuals import is_stand_in, simple

__all__ = ["encode", "encode_scene"]

_SEPARATORS = re.compile(r"[/\\:*?\"<>|\0]")  # what no name of a file may hold, here or elsewhere
_LONGEST_NAME = 60  # letters of a material's name, which becomes part of a texture's


def encode(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> bytes:
    """Return the text of a file of plain vertices (V, 3) and faces (F, 3)."""
    return _lines("v", vertices) + _faces([faces])


def encode_scene(
    name: str,
    vertices: NDArray[np.float64],
    scene: SceneFile,
    normals: Sequence[NDArray[np.float64] | None],
) -> dict[str, bytes]:
    """Return the files of a scene: the OBJ file `name`, and its materials and textures, all named after it.

    Parameters
    ----------
    name
        Name of the OBJ file.
    vertices
        (V, 3) where the mesh's vertices are.
    scene
        The parts, their texture coordinates and materials.
    normals
        For each primitive None or (rows, 3), in its own coordinates.
    """
    stem = name.rsplit(".", 1)[0]
    materials = [getattr(each.geometry.visual, "material", None) for each in scene.primitives]
    library = _MaterialLibrary(stem)
    several = any(library.add(material) for material in materials)
    body: list[bytes] = []
    uv_count = normal_count = 0
    part = None
    for each, own_normals, material in zip(scene.primitives, normals, materials, strict=True):
        visual = each.geometry.visual
        local = each.geometry.faces.view(np.ndarray)
        columns: list[NDArray[np.integer] | None] = [scene.vertex[each.rows][local], None, None]
        if each.part != part:  # primitives of one part differ in their materials alone
            part = each.part
            body.append(f"o {_one_line(part)}\n".encode())
        uv = getattr(visual, "uv", None)
        if uv is not None and np.shape(uv) == (len(each.geometry.vertices), 2):
            body.append(_lines("vt", np.asarray(uv)))
            columns[1] = local + uv_count
            uv_count += len(uv)
        if own_normals is not None:
            placed = own_normals @ np.linalg.pinv(each.transform[:3, :3])
            length = np.linalg.norm(placed, axis=1, keepdims=True)
            body.append(_lines("vn", placed / np.where(length > 0, length, 1)))
            columns[2] = local + normal_count
            normal_count += len(own_normals)
        used = library.add(material)
        if used is None and several:  # a primitive without one would go on with that of the one before
            used = library.plain(1.0 if vertex_colors(each, linear=False) is not None else GREY)
        if used is not None:
            body.append(f"usemtl {used}\n".encode())
        body.append(_faces(columns))
    files = library.files
    head = f"mtllib {stem}.mtl\n".encode() if files else b""
    colors = _vertex_colors(scene)
    positions = vertices if colors is None else np.hstack([vertices, colors])
    return {name: head + _lines("v", positions) + b"".join(body), **files}


class _MaterialLibrary:
    """The materials of a scene as an MTL file and its textures."""

    def __init__(self, stem: str) -> None:
        self._images: dict[str, bytes] = {}
        self._stem = stem
        self._names: dict[int, str] = {}
        self._taken: set[str] = set()
        self._counts: dict[str, int] = {}
        self._text: list[bytes] = []

    @property
    def files(self) -> dict[str, bytes]:
        """The MTL file and its textures by name; none where no material was added."""
        return {**self._images, f"{self._stem}.mtl": b"".join(self._text)} if self._text else {}

    def add(self, material: Any) -> str | None:
        """Return the name of a material, written when it first comes; None for one that nothing is known of."""
        if material is None or is_stand_in(material):
            return None
        if id(material) not in self._names:
            name = self._unused(_one_line(str(material.name)).replace(" ", "_"))
            self._names[id(material)] = name
            # trimesh names the texture after the material; the stem keeps it from overwriting another file's
            files, _ = simple(material).to_obj(name=name)
            text = files.pop(f"{name}.mtl")
            for image, data in files.items():
                self._images[f"{self._stem}_{image}"] = data
                text = text.replace(f"map_Kd {image}".encode(), f"map_Kd {self._stem}_{image}".encode())
            self._text.append(text + b"\n\n")
        return self._names[id(material)]

    def plain(self, grey: float) -> str:
        """Return the name of a material of one grey, written when it first comes."""
        if (grey_id := -int(1000 * grey)) not in self._names:
            name = self._names[grey_id] = self._unused("plain")
            self._text.append(f"newmtl {name}\nKd {grey} {grey} {grey}\n\n".encode())
        return self._names[grey_id]

    def _unused(self, name: str) -> str:
        name = _SEPARATORS.sub("_", name)[:_LONGEST_NAME] or "material"
        numbered = name
        while numbered in self._taken:
            self._counts[name] = self._counts.get(name, 1) + 1
            numbered = f"{name}_{self._counts[name]}"
        self._taken.add(numbered)
        return numbered


def _vertex_colors(scene: SceneFile) -> NDArray[np.float64] | None:
    """Return RGB (V, 3) where vertices have colors; a vertex takes that of its last row."""
    look = scene.appearance
    if look is None or look.colors is None:
        return None
    colors = np.ones((len(scene.vertices), 3))
    used = look.corners >= 0
    colors[look.corners[used]] = look.colors[used, :3]
    return colors[scene.representative]


def _lines(kind: str, values: NDArray[np.float64]) -> bytes:
    """Return a line for each row, its numbers as short as they can be read back exactly."""
    numbers = [repr(value) for value in np.asarray(values, np.float64).ravel().tolist()]
    width = values.shape[1]
    template = f"{kind} {' '.join(['%s'] * width)}\n"
    return (template * len(values) % tuple(numbers)).encode()


def _faces(columns: Sequence[NDArray[np.integer] | None]) -> bytes:
    """Return the face lines of vertex, texture and normal numbers (F, 3) each, from 0."""
    given = [column + 1 for column in columns if column is not None]
    have_uv = len(columns) > 1 and columns[1] is not None
    have_normal = len(columns) > 2 and columns[2] is not None
    corner = {(False, False): "%d", (True, False): "%d/%d", (False, True): "%d//%d", (True, True): "%d/%d/%d"}
    template = f"f {' '.join([corner[have_uv, have_normal]] * 3)}\n"
    numbers = np.stack(given, axis=-1).ravel().tolist()
    return (template * (len(given[0])) % tuple(numbers)).encode()


def _one_line(name: str) -> str:
    return " ".join(name.split())
