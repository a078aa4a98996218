"""Read OFF files, with normals, colors and texture coordinates; write positions and faces.

The format: Geomview, "OFF Files", 1996.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.mesh.colors import ranged
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.edits import Edits, rows_as_text
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.polygons import check_corners, long_faces, triangulate
from dfd.mesh.file.primitives import Geometry, MeshInstance
from dfd.mesh.file.scene_file import FileSource, SceneFile
from dfd.mesh.file.text import decoded, numbers, readable_numbers, shortened

_COMMENT = re.compile(rb"#[^\r\n]*")
_KIND = re.compile(r"((?:ST|C|N|4|n)*)OFF")  # the format has a fixed order, which some programs do not keep
_UNIT = 0.01  # largest difference of a unit normal's length from 1; text files round numbers
_LARGEST = 2.0**53  # floats hold all whole numbers up to this one


class _Columns(NamedTuple):
    """The columns of a vertex, by their first index, and their number in all."""

    scale: int | None  # the fourth coordinate, by which the others are divided
    normal: int | None
    color: int | None
    channels: int
    uv: int | None
    width: int


@dataclass(frozen=True)
class _Text:
    """The words of an OFF file, without its comments."""

    starts: Int64  # (W,) first byte of each word
    ends: Int64  # (W,) first byte after each word
    lines: Int64  # (W,) number of each word's line
    data: bytes  # the file, with blanks in place of comments and of numbers that NumPy cannot read

    def word(self, index: int) -> str:
        return decoded(self.data[self.starts[index] : self.ends[index]])


@dataclass(frozen=True)
class _Content:
    """The parsed content of a file."""

    text: _Text
    first: Int64  # (V,) index of each vertex's first word
    vertices: Float64  # (V, `columns.width`)
    columns: _Columns
    positions: Float64  # (V, 3)
    sizes: Int64  # (P,) number of corners of each face
    corners: Int64  # (C,)
    face_colors: Float32 | None  # (P, 4)
    notes: tuple[str, ...]  # warnings


def read(path: Path, data: bytes, assets: AssetFolder, at_rest: bool) -> SceneFile:
    """Return the scene of an OFF file.

    Raises ValueError if the file is malformed. Warns if faces with fewer than three corners are left out.
    """
    content = _parse(data)
    assets.notes.update(content.notes)
    vertices, columns, sizes = content.vertices, content.columns, content.sizes
    long = long_faces(path, sizes)
    corners = content.corners[np.repeat(long, sizes)]
    check_corners(corners, len(vertices))
    sizes = sizes[long]
    faces = corners[triangulate(content.positions, corners, sizes)]
    colors = None if columns.color is None else ranged(vertices[:, columns.color :][:, : columns.channels])
    of_faces = None
    if colors is None and content.face_colors is not None:
        of_faces = np.repeat(content.face_colors[long], sizes - 2, axis=0)
    geometry = Geometry(
        content.positions,
        faces,
        None if columns.normal is None else vertices[:, columns.normal :][:, :3],
        None if columns.uv is None else vertices[:, columns.uv :][:, :2],
        colors,
        of_faces,
    )
    source = FileSource(np.frombuffer(data, np.uint8), np.arange(len(vertices)))
    instances = [MeshInstance(path.stem, path.stem, geometry)]
    return SceneFile.of(path, instances, own_vertices=content.positions, source=source)


def _parse(data: bytes) -> _Content:
    text = _words(data)
    if not len(text.starts):
        raise ValueError("it has only comments")
    kind, counted = _kind(text.word(0))
    body = 0 if counted == "all" else 1
    if counted == "rest":  # such as OFF5 3 0
        text.starts[0] += len(kind)
        body = 0
    prefix = _KIND.fullmatch(kind)
    assert prefix is not None
    notes: list[str] = []
    if "n" in prefix[1]:  # nOFF: the number of dimensions precedes the counts
        if text.word(body) != "3":
            raise ValueError(f"its vertices have {shortened(text.word(body))} dimensions, and only 3 can be read")
        body += 1
    if body < len(text.starts) and text.word(body).upper() == "BINARY":
        raise ValueError("it is a binary OFF file, which cannot be read: save it as text")
    vertex_count, face_count, body = _counts(text, body)
    values, wrong = _numbers(text, body)
    most = [_columns(prefix[1], channels) for channels in ((4, 3) if "C" in prefix[1] else (0,))]
    lines = np.flatnonzero(np.diff(text.lines[body:], prepend=-1)) + body  # the first word of each line
    layouts: list[tuple[_Columns, Int64, _Faces, bool]] = []
    refusals: list[ValueError] = []
    for columns, by_lines in [(each, by_lines) for by_lines in (True, False) for each in most]:
        try:
            if by_lines:
                if len(lines) < vertex_count + face_count:
                    what = f"it should have {vertex_count} vertices and {face_count} faces"
                    raise ValueError(f"{what}, but has only {len(lines)} lines for them")
                first, begins = lines[:vertex_count], lines[vertex_count : vertex_count + face_count]
            else:
                first = body + columns.width * np.arange(vertex_count)
                begins = _free_begins(text, values, body + columns.width * vertex_count, face_count)
            _check_rows(text, wrong, first, columns.width, by_lines=by_lines)
            faces = _faces(text, values, wrong, begins, vertex_count, by_lines=by_lines)
        except ValueError as error:
            refusals.append(error)
            continue
        if (faces.sizes >= 3).all():
            layouts.insert(0, (columns, first, faces, by_lines))
            break
        if by_lines:
            layouts.append((columns, first, faces, by_lines))
    if not layouts:
        raise refusals[0]
    columns, first, found, by_lines = layouts[0]
    vertices = values[first[:, None] + np.arange(columns.width)]
    columns = _by_length(columns, vertices)
    positions = vertices[:, :3].copy()
    if columns.scale is not None:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            positions /= vertices[:, columns.scale, None]
    if by_lines and vertex_count:
        more = np.searchsorted(text.lines, text.lines[first], side="right") - first - columns.width
        if more.any():
            notes.append(
                f"{int(more.max())} further numbers of vertices, which its first line does not name, are ignored"
            )
    if found.by_index:
        notes.append("colors of faces by their index in a color map are ignored")
    return _Content(text, first, vertices, columns, positions, found.sizes, found.corners, found.colors, tuple(notes))


def _words(data: bytes) -> _Text:
    plain = _COMMENT.sub(lambda found: b" " * len(found[0]), readable_numbers(data))
    letters = np.frombuffer(plain, np.uint8)
    edges = np.flatnonzero(np.diff(letters > ord(" "), prepend=False, append=False)).reshape(-1, 2)
    breaks = np.flatnonzero((letters == ord("\n")) | (letters == ord("\r")))
    starts = edges[:, 0].copy()
    return _Text(starts, edges[:, 1], np.searchsorted(breaks, starts), plain)


def _kind(word: str) -> tuple[str, str]:
    """Return the keyword of a file, and where the counts are: "all" words, or the "rest" of the first, or "after" it.

    Files may omit the keyword, or write the number of vertices directly after it.
    """
    word = word.removeprefix("\ufeff")
    if word.isdecimal():
        return "OFF", "all"
    for spelled in (word, word.upper()):
        found = _KIND.match(spelled)
        if found and (found.end() == len(spelled) or spelled[found.end() :].isdecimal()):
            return found[0], "after" if found.end() == len(spelled) else "rest"
    raise ValueError(f"it begins with {shortened(word)}, not with OFF")


def _counts(text: _Text, body: int) -> tuple[int, int, int]:
    """Return the numbers of vertices and faces, and the index of the first word after the counts.

    The third count, of edges, may be missing if a line ends after the second count.
    """
    words = [text.word(index) for index in range(body, min(body + 3, len(text.starts)))]
    line = [int(np.count_nonzero(text.lines == each)) for each in text.lines[body : body + 3]]  # words in their lines
    own = int(np.count_nonzero(text.lines[body:] == text.lines[body])) if words else 0
    if own == 1 and line[1:2] != [1]:  # the next line is already a vertex
        words = words[:1]
    if len(words) < 2 or not all(each.isdecimal() for each in words[:2]):
        raise ValueError(
            "it must state its numbers of vertices and faces, "
            f"got {shortened(' '.join(words[:own])) if words else 'nothing'}"
        )
    third = len(words) > 2 and words[2].isdecimal() and (own > 2 or (own == 1 and line[2] == 1))
    return int(words[0]), int(words[1]), body + (3 if third else 2)


def _columns(prefix: str, channels: int) -> _Columns:
    """Return the columns of a vertex, in their order: position, normal, color, texture coordinates."""
    width = 4 if "4" in prefix else 3
    normal = width if "N" in prefix else None
    width += 3 if "N" in prefix else 0
    color = width if channels else None
    width += channels
    uv = width if "ST" in prefix else None
    return _Columns(3 if "4" in prefix else None, normal, color, channels, uv, width + (2 if "ST" in prefix else 0))


def _by_length(columns: _Columns, vertices: Float64) -> _Columns:
    """Return the columns with colors before normals, as some programs write them, if only these normals are unit."""
    if columns.normal is None or columns.color is None:
        return columns
    swapped = columns._replace(color=columns.normal, normal=columns.normal + columns.channels)

    def are_unit(each: _Columns) -> bool:
        lengths = np.linalg.norm(vertices[:, each.normal :][:, :3], axis=1)
        return bool((np.abs(lengths - 1) < _UNIT).all())

    return swapped if are_unit(swapped) and not are_unit(columns) else columns


def _numbers(text: _Text, body: int) -> tuple[Float64, Bool]:
    """Return the number that each word states, and which words state none (W,); these are NaN.

    Words before the index `body`, the keyword and the counts, are left out.
    """
    count = len(text.starts) - body
    wrong, values = np.zeros(len(text.starts), bool), np.full(len(text.starts), np.nan)
    found = numbers(text.data[text.starts[body] :], np.float64, count) if count > 0 else np.zeros(0)
    if found is not None:
        values[body:] = found
        return values, wrong
    for index in range(body, len(text.starts)):
        word = numbers(text.data[text.starts[index] : text.ends[index]], np.float64, 1)
        wrong[index] = word is None
        values[index] = np.nan if word is None else word[0]
    return values, wrong


def _check_rows(text: _Text, wrong: Bool, first: Int64, width: int, *, by_lines: bool) -> None:
    """Raise ValueError unless each vertex has `width` numbers, in its line if `by_lines`."""
    last = first + width - 1
    outside = last >= len(text.starts)
    inside = np.minimum(last, len(text.starts) - 1)
    bad = outside | wrong[np.minimum(first[:, None] + np.arange(width), len(text.starts) - 1)].any(axis=1)
    if by_lines:
        bad |= text.lines[inside] != text.lines[first]
    if bad.any():
        row = int(bad.argmax())
        words = range(int(first[row]), int(inside[row]) + 1)
        own = [text.word(each) for each in words if not by_lines or text.lines[each] == text.lines[words[0]]]
        raise ValueError(f"vertex {row} has the coordinates {shortened(' '.join(own))}")


class _Faces(NamedTuple):
    sizes: Int64  # (P,)
    corners: Int64  # (C,)
    colors: Float32 | None  # (P, 4)
    by_index: bool  # whether faces have a single number in place of a color


def _faces(text: _Text, values: Float64, wrong: Bool, begins: Int64, vertices: int, *, by_lines: bool) -> _Faces:
    """Return the faces that begin at the words `begins` (P,). Colors are the words that follow in a face's line."""
    stops = np.searchsorted(text.lines, text.lines[begins], side="right") if len(begins) else begins
    stated = values[begins]
    whole = (stated >= 0) & (stated < len(text.starts)) & (stated == np.trunc(stated))
    if not whole.all():
        face = int((~whole).argmax())
        raise ValueError(f"face {face} has {shortened(text.word(int(begins[face])))} corners")
    sizes = stated.astype(np.int64)
    left = stops - begins - 1 - sizes  # words after the corners
    if by_lines and (left < 0).any():
        face = int((left < 0).argmax())
        had = int(stops[face] - begins[face] - 1)
        raise ValueError(f"face {face} should have {sizes[face]} corners, but has {had}")
    start = np.repeat(begins + 1 - (np.cumsum(sizes) - sizes), sizes) + np.arange(int(sizes.sum()))
    if len(start) and int(start.max()) >= len(text.starts):
        raise ValueError("it is cut off before the end of its faces")
    corners = values[start]
    fine = ~wrong[start] & (corners == np.trunc(corners)) & (np.abs(corners) < _LARGEST)
    if not fine.all():
        raise ValueError(f"a face names the vertex {shortened(text.word(int(start[(~fine).argmax()])))}")
    indices = corners.astype(np.int64)
    check_corners(indices, vertices)
    if not by_lines:  # a face may end in a later line
        last = begins + sizes
        stops = np.searchsorted(text.lines, text.lines[last], side="right") if len(begins) else begins
        left = stops - last - 1
    colors = None
    for channels in (3, 4):
        colored = np.flatnonzero(left == channels)
        place = (begins + 1 + sizes)[colored, None] + np.arange(channels)
        if len(colored) and not wrong[place].any():
            colors = np.full((len(sizes), 4), np.nan, np.float32) if colors is None else colors
            colors[colored] = ranged(values[place])
    return _Faces(sizes, indices, colors, bool((left == 1).any()))


def _free_begins(text: _Text, values: Float64, begin: int, count: int) -> Int64:
    """Return the first words (`count`,) of faces from the word `begin`, each of which may end in a later line."""
    begins = []
    ends = np.append(np.flatnonzero(np.diff(text.lines)) + 1, len(text.lines))  # the end of each line
    for face in range(count):
        if begin >= len(text.starts):
            raise ValueError(f"it is cut off before the end of its {count} faces")
        size = values[begin]
        if not (0 <= size < len(text.starts) and size == int(size)):
            raise ValueError(f"face {face} has {shortened(text.word(begin))} corners")
        begins.append(begin)
        last = begin + int(size)
        begin = int(ends[np.searchsorted(ends, last, side="right")]) if last < len(text.starts) else last + 1
    return np.array(begins, np.int64)


def rewrite(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return an OFF file, in which the positions and normals of `saving` replace those of its source."""
    data = saving.source.data.tobytes()
    old = _parse(data)
    new, normals = saving.of_vertices()
    edits = Edits(data)
    changes = [(0, new, old.positions)]
    if old.columns.normal is not None:
        changes.append((old.columns.normal, normals, old.vertices[:, old.columns.normal :][:, :3]))
    for column, after, before in changes:
        rows = np.flatnonzero(((after != before) & ~np.isnan(after)).any(axis=1))
        values = after[rows]
        if column == 0 and old.columns.scale is not None:
            values = values * old.vertices[rows, old.columns.scale, None]
        words = old.first[rows, None] + column + np.arange(3)
        spans = np.stack([old.text.starts[words], old.text.ends[words]], axis=-1)
        edits.replace(spans, rows_as_text(values.reshape(-1, 1)))
    return {saving.target.name: edits.result()}, np.zeros(0)


def encode(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return an OFF file with each number in the shortest form that reads back exactly."""
    vertices, faces = saving.vertices, saving.faces
    head = [b"OFF", b"%d %d 0" % (len(vertices), len(faces))]
    lines = [*head, *rows_as_text(vertices), *(b"3 %d %d %d" % tuple(each) for each in faces.tolist()), b""]
    return {saving.target.name: b"\n".join(lines)}, np.zeros(0)
