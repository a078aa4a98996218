"""What an OBJ file shows: its faces as triangles, by part and material."""

from __future__ import annotations

import itertools
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.appearance import Material
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.obj.text import ObjText, decoded, parse
from dfd.mesh.file.primitives import BareGeometry, Geometry, MeshInstance

# Many files describe no looks: what these need takes half a second to import.
if TYPE_CHECKING:
    from PIL import Image
    from trimesh.visual.material import SimpleMaterial

__all__ = ["ObjSource", "face_groups", "libraries", "picture_name", "read"]

_PICTURES = ("map_", "bump", "disp", "decal", "refl", "norm")  # how keywords that name one begin
_OPTIONS = re.compile(r"-(?:imfchan\s+\w+|\w+(?:\s+(?:on|off|[-+]?[\d.]+(?:[eE][-+]?\d+)?))+)\s+")

_GROUP_KEYWORDS = ("g", "o", "usemtl")  # where two kinds have one name, the first is meant


@dataclass(frozen=True)
class ObjSource:
    """What it takes to write an OBJ file again with other positions; its text is parsed once more when that is done."""

    data: bytes
    folder: Path
    corner_rows: NDArray[np.int32]  # (C,) row of each corner of its faces; −1 where a face has too few corners
    row_counts: tuple[int, ...]  # rows of each primitive


def read(
    text: ObjText, path: Path, assets: AssetFolder
) -> tuple[list[MeshInstance], dict[int, Material], NDArray[np.int64], ObjSource]:
    """Return what the file shows, how it looks, the vertex (R,) of each row, and what is needed to write it again.

    Parts are the file's `o`, or its `g` where it has not several `o`; within a part faces are sorted by material. The
    looks are those of the geometries' materials, by the materials' ids.

    Warns
    -----
    UserWarning
        If faces of fewer than three corners are left out.
    """
    materials = _Materials(text, assets)
    part_names, part = _parts(text, path.stem)
    material_names, material = _state_at_faces(text, "usemtl", "")
    known = np.array([name in materials.found for name in material_names], bool)
    material = np.where(known[material], material, -1)  # faces of materials that are nowhere described are alike
    faces = np.flatnonzero(text.sizes >= 3)
    if len(faces) < len(text.sizes):
        _warn_of_short_faces(text, path)
    order = faces
    if len(faces) and ((material != material[0]).any() or (part != part[0]).any()):
        order = faces[np.lexsort((_by_appearance(material)[faces], _by_appearance(part)[faces]))]
    key = part[order] * (len(material_names) + 1) + material[order] + 1
    bounds = np.flatnonzero(np.diff(key, prepend=-1, append=-1))
    first = np.cumsum(text.sizes) - text.sizes
    corner_rows = np.full(len(text.corners), -1, np.int32)
    instances, numbers, row_count = [], [], 0
    for begin, end in itertools.pairwise(bounds):
        some = order[begin:end]
        where = _ranges(first[some], text.sizes[some])
        rows, inverse = _distinct(text.corners[where])
        corner_rows[where] = inverse + row_count
        used = material[some[0]]
        geometry = _geometry(
            text,
            rows,
            inverse[_fans(text.sizes[some])],
            materials.found.get(material_names[used]) if used >= 0 else None,
        )
        name = part_names[part[some[0]]]
        instances.append(MeshInstance(name, name, geometry))
        numbers.append(rows[:, 0])
        row_count += len(rows)
    vertex = np.concatenate(numbers) if numbers else np.zeros(0, np.int64)
    return instances, materials.looks, vertex, ObjSource(text.data, path.parent, corner_rows, tuple(map(len, numbers)))


def libraries(text: ObjText, assets: AssetFolder) -> list[str]:
    """Return the files of materials that the text names; a line names one, which may have spaces, or several."""
    names = []
    for line in [rest for _, keyword, rest in text.statements if keyword == "mtllib" and rest]:
        names += [line] if " " not in line or assets.has(line) else line.split()
    return list(dict.fromkeys(names))


def _geometry(
    text: ObjText, rows: NDArray[np.int64], faces: NDArray[np.int64], material: SimpleMaterial | None
) -> Geometry:
    """Return a geometry of distinct vertices, textures and normals (R, 3) and triangles of them (F, 3)."""
    positions = text.positions[rows[:, 0]]
    normals = text.normals[rows[:, 2]] if len(text.normals) and (rows[:, 2] >= 0).all() else None
    textured = bool((rows[:, 1] >= 0).any())
    if material is None and text.colors is None and not textured:
        return BareGeometry(positions, faces, normals)
    import trimesh
    from trimesh.visual import TextureVisuals

    options: dict[str, Any] = {} if normals is None else {"vertex_normals": normals}
    colors = None if text.colors is None else np.rint(text.colors[rows[:, 0]].clip(0, 1) * 255).astype(np.uint8)
    if material is not None or textured:
        uv = np.where(rows[:, 1:2] >= 0, text.uv[rows[:, 1]], 0) if textured else None
        options["visual"] = TextureVisuals(uv=uv, material=material)
        if colors is not None:
            options["visual"].vertex_attributes["color"] = colors
    elif colors is not None:
        options["vertex_colors"] = colors
    return trimesh.Trimesh(positions, faces, process=False, **options)


def _distinct(corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct rows (R, 3) of corners (C, 3), sorted, and which of them each corner is."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    span = [int(each) for each in high - low + 1]
    if span[0] * span[1] * span[2] < 2**62:
        key = ((corners[:, 0] - low[0]) * span[1] + (corners[:, 1] - low[1])) * span[2] + (corners[:, 2] - low[2])
        _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
        return corners[first], inverse
    rows, inverse = np.unique(corners, axis=0, return_inverse=True)
    return rows, inverse.ravel()


def _fans(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the corners (F, 3) of the triangles of polygons whose corners follow each other."""
    first = np.cumsum(sizes) - sizes
    start = np.repeat(first, sizes - 2)
    step = _ranges(np.zeros(len(sizes), np.int64), sizes - 2)
    return np.stack([start, start + step + 1, start + step + 2], axis=1)


def _ranges(starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the whole numbers from each start on, as many as its length says, one range after the other."""
    before = np.cumsum(lengths) - lengths
    return np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))


def _parts(text: ObjText, default: str) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of the parts and the part (P,) of each face."""
    for keyword in ("o", "g"):
        names, part = _state_at_faces(text, keyword, default)
        if len(part) and (part != part[0]).any():
            return names, part
    for keyword in ("o", "g"):  # one part: whichever names it
        names, part = _state_at_faces(text, keyword, default)
        if len(part) and part[0] > 0:
            return names, part
    return _state_at_faces(text, "", default)


def _state_at_faces(text: ObjText, keyword: str, default: str) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names that a keyword gave, `default` first, and which of them holds (P,) at each face."""
    names, numbers, lines, values = [default], {default: 0}, [-1], [0]
    for line, found, name in text.statements:
        if found == keyword:
            name = name or default
            if name not in numbers:
                numbers[name] = len(names)
                names.append(name)
            lines.append(line)
            values.append(numbers[name])
    return names, np.array(values)[np.searchsorted(lines, text.face_lines) - 1]


def _by_appearance(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the values (P,) as numbers in the order in which they first appear."""
    _, first, inverse = np.unique(values, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


def _warn_of_short_faces(text: ObjText, path: Path) -> None:
    short = np.flatnonzero(text.sizes < 3)
    warnings.warn(
        f"load: `path` {path} has {len(short)} faces of fewer than three corners, the first in line "
        f"{text.face_lines[short[0]] + 1}; they are left out",
        stacklevel=6,  # where `load` is called
    )


def face_groups(data: bytes) -> dict[str, NDArray[np.int64]]:
    """Return the vertices (N,) of each group in the text of an OBJ file, ascending, by the group's name.

    Every word of a `g` line names a group, and so does the line as a whole; `o` and `usemtl` lines have one name each.
    A group has all faces of its name, wherever they are, and goes on where a line of another kind comes between. Faces
    before the first line of a kind are in no group of that kind, and groups without faces are left out.
    """
    text = parse(data)
    kept = np.repeat(text.sizes >= 3, text.sizes)  # faces of fewer corners are none of the mesh
    vertices = text.corners[kept, 0]
    found: dict[str, NDArray[np.int64]] = {}
    for keyword in _GROUP_KEYWORDS:
        names, state = _state_at_faces(text, keyword, "")
        state = np.repeat(state, text.sizes)[kept]
        order = np.argsort(state, kind="stable")
        bounds = np.searchsorted(state[order], np.arange(len(names) + 1))
        lines: dict[str, list[int]] = {}
        for number, name in enumerate(names):
            for word in dict.fromkeys([name, *(name.split() if keyword == "g" else [])]):
                lines.setdefault(word, []).append(number)
        for name, numbers in lines.items():
            corners = np.concatenate([order[bounds[number] : bounds[number + 1]] for number in numbers])
            if name and len(corners):
                found.setdefault(name, np.unique(vertices[corners]))
    return found


def picture_name(line: str) -> str:
    """Return the picture that a line of an MTL file names, without its options; "" where it names none."""
    keyword, _, rest = line.strip().replace("\t", " ").partition(" ")
    return _OPTIONS.sub("", rest).strip() if keyword.lower().startswith(_PICTURES) else ""


class _Materials:
    """The materials that an OBJ file uses, from the MTL files that it names."""

    def __init__(self, text: ObjText, assets: AssetFolder) -> None:
        self.found: dict[str, SimpleMaterial] = {}
        self.looks: dict[int, Material] = {}
        self._assets, self._images = assets, ImageCache()
        self._opened: dict[str, Image.Image] = {}
        used = {name for _, keyword, name in text.statements if keyword == "usemtl"}
        for library in libraries(text, assets):
            try:
                content = decoded(assets.read(library))
            except (ValueError, OSError):
                assets.unreadable.add(library)
                continue
            lines = _of_materials(content, used - set(self.found))
            if not lines:
                continue
            from trimesh.exchange.obj import parse_mtl

            for name, described in parse_mtl(lines, resolver=self).items():
                self.found[name] = self._material(described)

    def get(self, name: str) -> bytes:
        """Return the bytes of a picture; trimesh asks for them as it comes by, and goes on without."""
        try:
            data = self._assets.read(name)
            self._opened[name] = self._images.open(data)
        except (ValueError, OSError):
            self._assets.unreadable.add(name)
            raise
        return data

    def _material(self, described: dict[str, Any]) -> SimpleMaterial:
        """Return a material and note how it looks: its texture alone, or else its diffuse color.

        Programs disagree about the product of the two.
        """
        from trimesh.visual.material import SimpleMaterial

        image = described.pop("image", None)
        if image is not None:
            name = image.info["file_path"]
            described["image"] = self._opened[name]
            described["image"].info["file_path"] = name
        material = SimpleMaterial(**described)
        if image is not None:
            try:
                look = Material((1.0, 1.0, 1.0, 1.0), self._images.texels(described["image"]))
            except ValueError:
                self._assets.unreadable.add(name)
                look = Material()
            self.looks[id(material)] = look
        elif "map_kd" in described:
            self.looks[id(material)] = Material()
        return material


def _of_materials(content: str, names: set[str]) -> str:
    """Return the lines of an MTL file that describe materials of these names, without options of textures."""
    lines, inside = [], False
    for line in content.splitlines():
        keyword, _, rest = line.strip().replace("\t", " ").partition(" ")
        keyword, rest = keyword.lower(), " ".join(rest.split()) if keyword == "newmtl" else rest
        if keyword == "newmtl":
            inside = rest in names
        if inside:
            lines.append(f"map_Kd {picture_name(line)}" if keyword == "map_kd" else line)
    return "\n".join(lines)
