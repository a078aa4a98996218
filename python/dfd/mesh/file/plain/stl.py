"""Read STL files with the colors that two programs store in them, and write them without colors.

The format: 3D Systems, "StereoLithography Interface Specification", 1989. Colors have five bits a channel, in the two
bytes of a face that the format leaves to programs. VisCAM stores blue in the lowest bits, and sets the highest bit of
faces with a color. Materialise Magics stores red there, and clears the highest bit of these faces; all others have the
color after "COLOR=" in the header.
"""

import codecs
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64, unit
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.edits import SAME, Edits, rounding, rows_as_text
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.primitives import Geometry, MeshInstance
from dfd.mesh.file.scene_file import FileSource, SceneFile
from dfd.mesh.file.text import UniqueNames, decoded, number

_HEADER = 84  # bytes before the first face of a binary file; the last four hold the number of faces
_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_COLOR = re.compile(rb"COLOR=(.{4})", re.DOTALL)
_OWN = 0x8000  # the highest bit of the attribute of a face
_NAME = re.compile(rb"(?im)^[ \t]*solid\b((?:(?!\bfacet\s+normal\b)[^\r\n])*)")
_END = re.compile(rb"(?im)^[ \t]*end[ \t]*solid\b[^\r\n]*")
_FACET_END = re.compile(rb"(?i)\bend[ \t]*facet\b")
_FACET = re.compile(rb"(?i)(?<!end)(?<!end[ \t])\bfacet\b")
_VERTEX = re.compile(rb"(?i)\bvertex" + rb"\s+([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)" * 3)
_NORMAL = re.compile(rb"(?i)\bfacet\s+normal" + rb"\s+(\S+)" * 3)


def read(path: Path, data: bytes, assets: AssetFolder, at_rest: bool) -> SceneFile:
    """Return the scene of an STL file, whose parts are its solids; raise ValueError if the file is malformed."""
    solids, names = _solids(data), UniqueNames()
    parts = [(names.unique((len(solids) > 1 and name) or path.stem), each) for name, each in solids]
    instances = [MeshInstance(name, name, each) for name, each in parts]
    return SceneFile.of(path, instances, source=FileSource(np.frombuffer(data, np.uint8)))


def _solids(data: bytes) -> list[tuple[str, Geometry]]:
    binary = _binary(data)
    if binary is not None:
        colors = _colors(data[: _HEADER - 4], binary["attribute"])
        return [("", _soup(binary["corners"].reshape(-1, 3), colors))]
    if data.removeprefix(codecs.BOM_UTF8).lstrip()[:5].lower() != b"solid":
        raise ValueError(f"it is cut off after {len(data)} bytes")
    text = _without_names(data)
    facets, ends = len(_FACET.findall(text)), len(_FACET_END.findall(text))
    if facets != ends or not _END.search(data):
        raise ValueError(f"it is cut off: it begins {facets} faces, ends {ends} of them and may lack others")
    solids, start = [], 0
    for end in [*(each.start() for each in _END.finditer(data)), len(data)]:
        found = _VERTEX.findall(text, start, end)
        if len(found) != 3 * len(_FACET_END.findall(text, start, end)):
            raise ValueError("one of its faces does not have three vertices")
        if found:
            name = _NAME.search(data, start, end)
            solids.append((decoded(name[1]).strip() if name else "", _soup(np.array(found, np.float64))))
        start = end
    return solids


def _colors(head: bytes, attribute: NDArray[np.uint16]) -> Float32 | None:
    """Return the colors (F, 4) of faces from their `attribute` (F,), NaN for faces without one; None if none has one.

    If the header names a color and no face has the bit that Magics clears, the file is not from Magics, or all its
    faces have the color of the header. Different attributes then decide for VisCAM.
    """
    marked = (attribute & _OWN) > 0
    red, green, blue = ((attribute >> shift & 31) / 31 for shift in (10, 5, 0))
    default = _COLOR.search(head)
    if default is not None and not (marked.all() and len(attribute) and (attribute != attribute[0]).any()):
        colors = np.column_stack([blue, green, red, np.ones(len(attribute))])
        colors[marked] = np.frombuffer(default[1], np.uint8) / 255
    elif not marked.any():
        return None
    else:
        colors = np.column_stack([red, green, blue, np.ones(len(attribute))])
        colors[~marked] = np.nan
    return colors.astype(np.float32)


def _without_names(data: bytes) -> bytes:
    """Return the text of a file with blanks in place of the byte order mark and the lines with names of solids."""
    data = data.replace(codecs.BOM_UTF8, b"   ", 1) if data.startswith(codecs.BOM_UTF8) else data
    for pattern in (_NAME, _END):
        data = pattern.sub(lambda found: b" " * len(found[0]), data)
    return data


def rewrite(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return an STL file in which the positions of `saving` replace those of the face corners in its source.

    Faces that turn get new normals, each on the same side of the face as the old normal; a normal that is zero or not
    finite stays.
    """
    data, corners = saving.source.data.tobytes(), saving.vertices[saving.file.vertex]
    name, binary, placed = saving.target.name, _binary(data), corners.reshape(-1, 3, 3)
    if binary is not None:
        moved, old = binary.copy(), binary["corners"].astype(np.float64)
        changed = (placed != old).any(axis=(1, 2))
        moved["corners"][changed] = placed[changed]
        normals, turned = _turned(binary["normal"], old, placed)
        moved["normal"][turned] = normals[turned]
        return {name: data[:_HEADER] + moved.tobytes()}, rounding(corners)
    text = _without_names(data)
    places, turns = list(_VERTEX.finditer(text)), list(_NORMAL.finditer(text))
    old = np.array([each.groups() for each in places], np.float64)
    edits = Edits(data)
    changes = [(places, (corners != old).any(axis=1), corners)]
    if 3 * len(turns) == len(places):  # facets may lack normals
        known = np.array([[number(word) for word in each.groups()] for each in turns])
        normals, turned = _turned(known, old.reshape(-1, 3, 3), placed)
        changes.append((turns, turned, normals))
    for found, kept, values in changes:
        rows = np.flatnonzero(kept)
        edits.replace([(found[row].start(1), found[row].end(3)) for row in rows], rows_as_text(values[rows]))
    return {name: edits.result()}, np.zeros(0)


def encode(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return a binary STL file, and the distances by which its 32-bit floats move the corners of faces."""
    corners = saving.vertices[saving.faces]
    faces = np.zeros(len(corners), _FACE)
    faces["corners"], faces["normal"] = corners, _face_normals(corners)
    data = bytes(_HEADER - 4) + len(faces).to_bytes(4, "little") + faces.tobytes()
    return {saving.target.name: data}, rounding(corners.reshape(-1, 3))


def _binary(data: bytes) -> NDArray[Any] | None:
    """Return the faces (F,) of a binary STL file, as `_FACE` records; None for a text file."""
    if len(data) >= _HEADER:
        count = int.from_bytes(data[80:84], "little")
        length = _HEADER + _FACE.itemsize * count
        if len(data) == length:
            return np.frombuffer(data, _FACE, count, _HEADER)
        if b"facet" not in data.lower():
            raise ValueError(f"it should have {count} faces in {length} bytes, but has {len(data)} bytes")
    return None


def _face_normals(corners: Float64) -> Float64:
    """Return the unit normals (F, 3) of triangles (F, 3, 3); 0 for triangles without area."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.nan_to_num(unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])))


def _turned(normals: NDArray[Any], before: Float64, after: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """Return the normals (F, 3) of moved faces (F, 3, 3), and which of them are new (F,).

    A new normal is on the same side of its face as the old normal.
    """
    old, new, flat = normals.astype(np.float64), _face_normals(after), _face_normals(before)
    known = np.isfinite(old).all(axis=1) & new.any(axis=1) & (np.abs(new - flat).max(axis=1) > SAME)
    side = np.sign(np.einsum("fc,fc->f", flat, np.where(np.isfinite(old), old, 0)))[:, None]
    return side * new, known & (side[:, 0] != 0)


def _soup(corners: NDArray[np.floating], colors: Float32 | None = None) -> Geometry:
    """Return triangles that share no vertices, from the positions (3F, 3) of their corners and their colors (F, 4)."""
    return Geometry(corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3), face_colors=colors)
