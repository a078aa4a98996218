"""Read and write OFF and STL files: positions, faces and normals, without colors.

The formats: Geomview, "OFF Files", 1996; 3D Systems, "StereoLithography Interface Specification", 1989.
"""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64, unit
from dfd.mesh.file.assets import shortened
from dfd.mesh.file.edits import Edits, rows_as_text
from dfd.mesh.file.obj.text import decoded
from dfd.mesh.file.polygons import check_corners, triangulate
from dfd.mesh.file.primitives import Geometry

_STL_HEADER = 84  # bytes before the first face of a binary file; the last four hold the number of faces
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_LINE = re.compile(rb"(?<![^\r\n])[^\r\n#]+")  # a line without its comment
_NUMBERS = rb"\s+([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)" * 3
_STL_VERTEX = re.compile(rb"\bvertex" + _NUMBERS, re.IGNORECASE)
_STL_NORMAL = re.compile(rb"\bfacet\s+normal" + _NUMBERS, re.IGNORECASE)


def read_off(data: bytes) -> Geometry:
    """Return the vertices, faces and normals of an OFF file; raise ValueError if the file is malformed."""
    lines = [decoded(line[0]) for line in _lines(data)]
    if not lines:
        raise ValueError("it has only comments")
    kind, *first = lines[0].split()
    if kind.isdigit():  # files may omit the keyword
        kind, first = "OFF", [kind, *first]
    if not kind.upper().endswith("OFF"):
        raise ValueError(f"it begins with {shortened(kind)}, not with OFF")
    counts, rest = (first, lines[1:]) if first else (lines[1].split() if len(lines) > 1 else [], lines[2:])
    if len(counts) < 2 or not all(each.isdecimal() for each in counts[:2]):
        found = shortened(" ".join(counts)) if counts else "nothing"
        raise ValueError(f"it must state its numbers of vertices and faces, got {found}")
    vertex_count, face_count = int(counts[0]), int(counts[1])
    if len(rest) < vertex_count + face_count:
        raise ValueError(
            f"it should have {vertex_count} vertices and {face_count} faces, but has only {len(rest)} lines for them"
        )
    width = 6 if "N" in kind[:-3] and not {"4", "n"}.intersection(kind) else 3  # NOFF: a normal follows the position
    vertices = np.empty((vertex_count, width))
    for number, line in enumerate(rest[:vertex_count]):
        words = line.split(None, width)[:width]
        try:
            if len(words) < width:  # NumPy would repeat a single number
                raise ValueError
            vertices[number] = words
        except ValueError:
            raise ValueError(f"vertex {number} has the coordinates {shortened(' '.join(words))}") from None
    sizes, corners = np.empty(face_count, np.int64), []
    for number, line in enumerate(rest[vertex_count : vertex_count + face_count]):
        words = line.split()
        size = int(words[0]) if words[0].isdecimal() else -1
        if size < 3:
            raise ValueError(f"face {number} has {shortened(words[0])} corners, and 3 are needed")
        if len(words) <= size:
            raise ValueError(f"face {number} should have {size} corners, but has {len(words) - 1}")
        sizes[number] = size
        corners += words[1 : size + 1]
    try:
        numbers = np.array(list(map(int, corners)), np.int64)
    except (ValueError, OverflowError):
        wrong = next(word for word in corners if not re.fullmatch(r"[-+]?\d{1,18}", word))
        raise ValueError(f"a face names the vertex {shortened(wrong)}") from None
    check_corners(numbers, vertex_count)
    positions = vertices[:, :3].copy()
    faces = numbers[triangulate(positions, numbers, sizes)]
    return Geometry(positions, faces, vertices[:, 3:] if width > 3 else None)


def _lines(data: bytes) -> list[re.Match[bytes]]:
    """Return the lines of an OFF file without their comments. Lines that are then empty are left out."""
    return [line for line in _LINE.finditer(data) if line[0].strip()]


def rewrite_off(data: bytes, vertices: Float64, normals: Float64) -> bytes:
    """Return an OFF file, in which `vertices` (V, 3) and `normals` (V, 3) replace those of `data`."""
    lines = _lines(data)
    lines = lines[1 if len(lines[0][0].split()) > 1 else 2 :]  # the keyword may have a line of its own
    old = read_off(data)
    edits, written, before = Edits(data), vertices, old.vertices
    if old.normals is not None:
        written, before = np.hstack([vertices, normals]), np.hstack([before, old.normals])
    numbers = re.compile(rb"\s*(" + rb"\s+".join([rb"\S+"] * written.shape[1]) + rb")")
    rows = np.flatnonzero((written != before).any(axis=1))
    found = [numbers.match(data, *lines[row].span()) for row in rows]
    edits.replace([each.span(1) for each in found if each], rows_as_text(written[rows]))
    return edits.result()


def encode_off(vertices: Float64, faces: NDArray[np.integer]) -> bytes:
    """Return an OFF file with each number in the shortest form that reads back exactly."""
    head = [b"OFF", b"%d %d 0" % (len(vertices), len(faces))]
    return b"\n".join([*head, *rows_as_text(vertices), *(b"3 %d %d %d" % tuple(each) for each in faces.tolist()), b""])


def read_stl(data: bytes) -> list[tuple[str, Geometry]]:
    """Return the solids of an STL file with their names, which may be ""; raise ValueError if it is malformed."""
    binary = binary_stl(data)
    if binary is not None:
        return [("", _soup(binary["corners"].reshape(-1, 3)))]
    if data.lstrip()[:5].lower() != b"solid":
        raise ValueError(f"it is cut off after {len(data)} bytes")
    facets, ends = len(re.findall(rb"(?i)\bfacet\b", data)), len(re.findall(rb"(?i)\bendfacet\b", data))
    if facets != ends or b"endsolid" not in data.lower():
        raise ValueError(f"it is cut off: it begins {facets} faces, ends {ends} of them and may lack others")
    solids = []
    for solid in re.split(rb"(?im)^[ \t]*endsolid[^\n]*", data):
        found = _STL_VERTEX.findall(solid)
        if len(found) != 3 * len(re.findall(rb"(?i)\bendfacet\b", solid)):
            raise ValueError("one of its faces does not have three vertices")
        if found:
            name = re.match(rb"(?i)\s*solid[ \t]*([^\r\n]*)", solid)
            solids.append((decoded(name[1]).strip() if name else "", _soup(np.array(found, np.float64))))
    return solids


def rewrite_stl(data: bytes, corners: Float64) -> bytes:
    """Return an STL file in which the positions `corners` (3F, 3) replace those of the face corners in `data`.

    Moved faces get new normals, each on the same side of the face as the old normal; a zero normal stays zero.
    """
    binary = binary_stl(data)
    if binary is not None:
        moved, old = binary.copy(), binary["corners"].astype(np.float64)
        changed = (corners.reshape(-1, 3, 3) != old).any(axis=(1, 2))
        moved["corners"][changed] = corners.reshape(-1, 3, 3)[changed]
        moved["normal"][changed] = _turned(binary["normal"], old, corners.reshape(-1, 3, 3))[changed]
        return data[:_STL_HEADER] + moved.tobytes()
    places, turns = list(_STL_VERTEX.finditer(data)), list(_STL_NORMAL.finditer(data))
    if len(places) != len(corners) or 3 * len(turns) != len(corners):  # e.g. if a solid's name contains a keyword
        return encode_stl(corners)
    old = np.array([each.groups() for each in places], np.float64)
    normals = np.array([each.groups() for each in turns], np.float64)
    changed = (corners != old).any(axis=1)
    new = _turned(normals, old.reshape(-1, 3, 3), corners.reshape(-1, 3, 3))
    edits = Edits(data)
    for found, kept, values in ((places, changed, corners), (turns, changed.reshape(-1, 3).any(axis=1), new)):
        rows = np.flatnonzero(kept)
        edits.replace([(found[row].start(1), found[row].end(3)) for row in rows], rows_as_text(values[rows]))
    return edits.result()


def encode_stl(corners: Float64) -> bytes:
    """Return a binary STL file with faces whose corners have the positions `corners` (3F, 3)."""
    faces = np.zeros(len(corners) // 3, _STL_FACE)
    faces["corners"] = corners.reshape(-1, 3, 3)
    faces["normal"] = _face_normals(corners.reshape(-1, 3, 3))
    return bytes(_STL_HEADER - 4) + len(faces).to_bytes(4, "little") + faces.tobytes()


def binary_stl(data: bytes) -> NDArray[Any] | None:
    """Return the faces (F,) of a binary STL file, as `_STL_FACE` records; None for a text file."""
    if len(data) >= _STL_HEADER:
        count = int.from_bytes(data[80:84], "little")
        length = _STL_HEADER + _STL_FACE.itemsize * count
        if len(data) == length:
            return np.frombuffer(data, _STL_FACE, count, _STL_HEADER)
        if b"facet" not in data.lower():
            raise ValueError(f"it should have {count} faces in {length} bytes, but has {len(data)} bytes")
    return None


def _face_normals(corners: Float64) -> Float64:
    """Return the unit normals (F, 3) of triangles (F, 3, 3); 0 for triangles without area."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.nan_to_num(unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])))


def _turned(normals: NDArray[Any], before: Float64, after: Float64) -> Float64:
    """Return the normals (F, 3) of moved faces (F, 3, 3), each on the same side of its face as the old normal."""
    old, new = normals.astype(np.float64), _face_normals(after)
    side = np.sign(np.einsum("fc,fc->f", _face_normals(before), old))[:, None]
    return np.where((side == 0) | ~new.any(axis=1, keepdims=True), old, side * new)


def _soup(corners: NDArray[np.floating]) -> Geometry:
    """Return triangles that share no vertices, from the positions (3F, 3) of their corners."""
    return Geometry(corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3))
