"""Read and write OFF files: positions, faces and normals, without colors.

The format: Geomview, "OFF Files", 1996.
"""

import re
from pathlib import Path

import numpy as np

from dfd.common.edits import Edits, rows_as_text
from dfd.common.linear_algebra import Float64
from dfd.common.polygons import check_corners, triangulate
from dfd.common.text import decoded, numbers, readable_numbers, shortened
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.primitives import Geometry, MeshInstance
from dfd.mesh.file.scene_file import FileSource, SceneFile

_ROW = re.compile(rb"\s*(\S+\s+\S+\s+\S+)(?:\s+(\S+\s+\S+\s+\S+))?")  # position and normal of a vertex
_LINE = re.compile(rb"(?<![^\r\n])[^\r\n#]+")  # a line without its comment


def read(path: Path, data: bytes, assets: AssetFolder, at_rest: bool) -> SceneFile:
    """Return the scene of an OFF file; raise ValueError if the file is malformed."""
    geometry = _geometry(data)
    source = FileSource(np.frombuffer(data, np.uint8), np.arange(len(geometry.vertices)))
    instances = [MeshInstance(path.stem, path.stem, geometry)]
    return SceneFile.of(path, instances, own_vertices=geometry.vertices, source=source)


def _geometry(data: bytes) -> Geometry:
    data = readable_numbers(data)
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
    rows = [" ".join(line.split(None, width)[:width]) for line in rest[:vertex_count]]
    values = numbers(" ".join(rows).encode(), np.float64, vertex_count * width)
    if values is None:
        wrong = next(i for i, row in enumerate(rows) if numbers(row.encode(), np.float64, width) is None)
        raise ValueError(f"vertex {wrong} has the coordinates {shortened(rows[wrong])}")
    vertices = values.reshape(-1, width)
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
        indices = np.array(list(map(int, corners)), np.int64)
    except (ValueError, OverflowError):
        word = next(word for word in corners if not re.fullmatch(r"[-+]?\d{1,18}", word))
        raise ValueError(f"a face names the vertex {shortened(word)}") from None
    check_corners(indices, vertex_count)
    positions = vertices[:, :3].copy()
    faces = indices[triangulate(positions, indices, sizes)]
    return Geometry(positions, faces, vertices[:, 3:] if width > 3 else None)


def _lines(data: bytes) -> list[re.Match[bytes]]:
    """Return the lines of an OFF file without their comments. Lines that are then empty are left out."""
    return [line for line in _LINE.finditer(data) if line[0].strip()]


def rewrite(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return an OFF file, in which the positions and normals of `saving` replace those of its source."""
    data = saving.source.data.tobytes()
    lines = _lines(readable_numbers(data))
    lines = lines[1 if len(lines[0][0].split()) > 1 else 2 :]  # the keyword may have a line of its own
    old = _geometry(data)
    edits = Edits(data)
    for group, new, before in zip((1, 2), saving.of_vertices(), (old.vertices, old.normals), strict=True):
        if before is not None:
            rows = np.flatnonzero(((new != before) & ~np.isnan(new)).any(axis=1))
            found = [_ROW.match(data, *lines[row].span()) for row in rows]
            edits.replace([each.span(group) for each in found if each], rows_as_text(new[rows]))
    return {saving.target.name: edits.result()}, np.zeros(0)


def encode(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return an OFF file with each number in the shortest form that reads back exactly."""
    vertices, faces = saving.vertices, saving.faces
    head = [b"OFF", b"%d %d 0" % (len(vertices), len(faces))]
    lines = [*head, *rows_as_text(vertices), *(b"3 %d %d %d" % tuple(each) for each in faces.tolist()), b""]
    return {saving.target.name: b"\n".join(lines)}, np.zeros(0)
