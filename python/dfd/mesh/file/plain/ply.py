"""Read and write PLY files, text and binary.

The format: Turk, "The PLY Polygon File Format", 1994, with colors, texture coordinates and textures as later programs
write them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.mesh.appearance import WHITE, Material
from dfd.mesh.file.assets import AssetFolder, shortened
from dfd.mesh.file.edits import Edits, far_origin
from dfd.mesh.file.materials import rgba
from dfd.mesh.file.obj.text import decoded
from dfd.mesh.file.polygons import check_corners, ranges, triangulate
from dfd.mesh.file.primitives import Geometry

_NAMES = (
    *("char", "uchar", "short", "ushort", "int", "uint", "float", "double"),
    *("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"),
)
_TYPES = dict(zip(_NAMES, ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8") * 2, strict=True))
_SPELLED = {code: name for name, code in _TYPES.items() if not name[-1].isdigit()}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_CHANNELS = ("red", "green", "blue", "alpha")
_KNOWN = {"x", "y", "z", "nx", "ny", "nz", *_CHANNELS, *(each for uv in _UV_NAMES for each in uv)}
_TEXTURE = re.compile(r"comment\s+TextureFile\s+(\S.*)")


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: np.dtype[Any]  # type of its values in the header
    stored: np.dtype[Any]  # type of its values in the data
    counts: np.dtype[Any] | None  # type of a list's length in the data; None if it is no list


@dataclass(frozen=True)
class _List:
    """A list property: the values of all rows in order, and the number of values of each row."""

    values: NDArray[Any]
    sizes: Int64


_Element = dict[str, "NDArray[Any] | _List"]
# values, sizes and byte offsets of a property without rows
_NOTHING = (np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64))


@dataclass(frozen=True)
class _Content:
    """The parsed content of a file."""

    lines: list[str]  # lines of the header
    start: int  # byte at which the body begins
    order: str  # byte order: "<" or ">"; "" for text
    elements: dict[str, _Element]
    types: dict[str, np.dtype[Any]]  # types of the properties of the first `vertex` element, by name
    # places: (V,) where the values of each such property are: byte offsets in the body, or numbers of words in a text
    places: dict[str, Int64]


def read(path: Path, data: bytes, assets: AssetFolder) -> tuple[Geometry, Float64, Int64]:
    """Return the geometry of a file, its vertices (V, 3), and the vertex (N,) of each row of the geometry.

    Raises ValueError if it has fewer numbers than stated, or vertex indices of faces are not integers. Warns if faces
    with fewer than three corners are left out.
    """
    content = _parse(data)
    lines, found = content.lines, content.elements
    vertex = found.get("vertex", {})
    positions = _columns(vertex, ("x", "y", "z"), np.float64)
    if positions is None:
        raise ValueError("its vertices have no x, y and z")
    face = found.get("face", {})
    polygons = _indices(face) or _List(np.zeros(0, np.int64), np.zeros(0, np.int64))
    corners, sizes, kept = _polygons(path, polygons, _indices(found.get("tristrips", {})), len(positions))
    triangles = triangulate(positions, corners, sizes)
    picture = next((match[1].strip() for line in lines if (match := _TEXTURE.match(line))), None)
    texels = None if picture is None else assets.texture(picture, shortened(picture))
    material = None if texels is None else Material(WHITE, texels)
    uv = next((each for names in _UV_NAMES if (each := _columns(vertex, names, np.float64)) is not None), None)
    of_corners = face.get("texcoord")
    numbers = np.arange(len(positions))
    faces = corners[triangles]
    if isinstance(of_corners, _List) and np.array_equal(of_corners.sizes, 2 * polygons.sizes) and material is not None:
        pairs = of_corners.values.astype(np.float64).reshape(-1, 2)[kept]
        rows, where = np.unique(np.column_stack([corners, pairs]), axis=0, return_inverse=True)
        numbers, uv, faces = rows[:, 0].astype(np.int64), rows[:, 1:], where.ravel()[triangles]
    others = {name: each for name, each in vertex.items() if isinstance(each, np.ndarray) and name not in _KNOWN}
    normals, colors = _columns(vertex, ("nx", "ny", "nz"), np.float64), _colors(vertex)
    face_colors = _colors(face)
    if face_colors is not None and len(face_colors) == len(polygons.sizes):
        face_colors = np.repeat(face_colors, np.maximum(polygons.sizes - 2, 0), axis=0)
    if face_colors is not None and len(face_colors) != len(faces):  # strips have none
        face_colors = None
    geometry = Geometry(
        positions[numbers],
        faces,
        None if normals is None else normals[numbers],
        uv,
        None if colors is None else colors[numbers],
        face_colors,
        material,
        {name: each[numbers] for name, each in others.items()},
    )
    return geometry, positions, numbers


def _polygons(path: Path, faces: _List, strips: _List | None, count: int) -> tuple[Int64, Int64, Bool]:
    """Return the corners (C,) of faces and strips, the size of each face, and which corners of `faces` are kept."""
    long = faces.sizes >= 3
    if not long.all():
        check.warn(
            f"load: `path` {path} has {int((~long).sum())} faces of fewer than three corners, the first is face "
            f"{long.argmin()}; they are left out",
            UserWarning,
        )
    kept = np.repeat(long, faces.sizes)
    corners, sizes = faces.values[kept].astype(np.int64), faces.sizes[long]
    if strips is not None:
        triangles = _strip_triangles(strips)
        corners = np.concatenate([corners, triangles.ravel()])
        sizes = np.concatenate([sizes, np.full(len(triangles), 3)])
    check_corners(corners, count)
    return corners, sizes, kept


def _indices(element: _Element) -> _List | None:
    found = element.get("vertex_indices", element.get("vertex_index"))
    if found is None:
        return None
    if not isinstance(found, _List) or found.values.dtype.kind not in "iu":
        raise ValueError("its faces name vertices by something other than lists of whole numbers")
    return found


def _strip_triangles(strips: _List) -> Int64:
    """Return the triangles (F, 3) of strips; -1 starts a new strip."""
    values = strips.values.astype(np.int64)
    run = np.cumsum(values < 0) + np.repeat(np.arange(len(strips.sizes)), strips.sizes) * (len(values) + 1)
    index = np.arange(len(values))
    new = np.diff(run, prepend=-1) != 0
    begin = np.maximum.accumulate(np.where(new, index + (values < 0), 0))  # each -1 precedes its run
    first = np.flatnonzero((values[:-2] >= 0) & (run[:-2] == run[2:])) if len(values) > 2 else np.zeros(0, np.int64)
    triangles = values[first[:, None] + np.arange(3)]
    odd = (first - begin[first]) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)  # repeated corners only turn the strip
    return triangles[distinct]


def _columns(element: _Element, names: tuple[str, ...], dtype: Any) -> NDArray[Any] | None:
    columns = [each for name in names if isinstance(each := element.get(name), np.ndarray)]
    return np.stack(columns, axis=1).astype(dtype) if len(columns) == len(names) else None


def _colors(element: _Element) -> Float32 | None:
    for prefix in ("", "diffuse_"):
        for names in (_CHANNELS, _CHANNELS[:3]):
            columns = [rgba(each[:, None])[:, 0] for name in names
                       if isinstance(each := element.get(prefix + name), np.ndarray)]  # fmt: skip
            if len(columns) == len(names):
                return rgba(np.stack(columns, axis=1))
    return None


def _parse(data: bytes) -> _Content:
    head, mark, body = data.partition(b"end_header")
    lines = [line.strip() for line in decoded(head).splitlines() if line.strip()]
    if not mark or not lines or lines[0].lower() != "ply":
        raise ValueError("it has no header of a PLY file")
    order, layout = None, []
    for line in lines[1:]:
        words = line.split()
        if words[0] == "format" and len(words) > 1 and words[1] in _ORDERS:
            order = _ORDERS[words[1]]
        elif words[0] == "element":
            if len(words) != 3 or not words[2].isdecimal():
                raise ValueError(f"it has the malformed line {shortened(line)}")
            layout.append((words[1], int(words[2]), list[_Property]()))
        elif words[0] == "property":
            types = words[2:4] if words[1:2] == ["list"] else words[1:2]
            if not layout or len(words) != (5 if words[1:2] == ["list"] else 3) or not set(types) <= set(_TYPES):
                raise ValueError(f"it has the malformed line {shortened(line)}")
            dtypes = [np.dtype((order or "=") + _TYPES[each]) for each in types]
            if dtypes[:-1] and dtypes[0].kind == "f":
                raise ValueError(f"it has the malformed line {shortened(line)}")
            stored = [np.dtype(np.float64) if order == "" else each for each in dtypes]
            layout[-1][2].append(_Property(words[-1], dtypes[-1], stored[-1], stored[0] if len(types) == 2 else None))
    if order is None:
        raise ValueError("its header does not name a known format")
    if order:  # the header ends with its line
        data, start = body, 2 if body[:2] == b"\r\n" else 1
    else:  # all numbers of a text as if they were the data of a binary file
        data, start = _numbers(body).tobytes(), 0
    content = _Content(lines, len(head) + len(mark), order, {}, {}, {})
    for name, count, properties in layout:
        if count > len(data):
            raise _cut_off(name, count)
        columns, start = _columns_of(data, start, name, count, properties) if count and properties else ([], start)
        element: _Element = {}
        for each, (values, sizes, places) in zip(properties, columns or [_NOTHING] * len(properties), strict=True):
            typed = _typed(values, each.dtype)
            element[each.name] = typed if each.counts is None else _List(typed, sizes)
            if name == "vertex" and name not in content.elements:
                content.types[each.name] = each.dtype
                content.places[each.name] = places if order else places // 8
        content.elements.setdefault(name, element)
    return content


def _cut_off(name: str, count: int) -> ValueError:
    return ValueError(f"it should have {count} of {shortened(name)}, but is cut off")


def _numbers(body: bytes) -> Float64:
    try:
        return np.array(body.split(), np.float64)
    except ValueError as error:
        raise ValueError(f"its numbers hold something else: {shortened(str(error))}") from error


def _columns_of(
    data: bytes, start: int, name: str, count: int, properties: list[_Property]
) -> tuple[list[tuple[NDArray[Any], Int64, Int64]], int]:
    """Return the values, sizes and byte offsets of each property in `count` rows from byte `start`, and the end."""

    def row_at(offset: int) -> tuple[list[int], int]:
        """Return the number of values of each property in the row at an offset, and the end of the row."""
        lengths = []
        for each in properties:
            length = 1
            if each.counts is not None:
                if offset + each.counts.itemsize > len(data):
                    raise _cut_off(name, count)
                stated = np.frombuffer(data, each.counts, 1, offset)[0]
                if not 0 <= stated <= len(data) or stated != int(stated):
                    raise ValueError(f"a list of {shortened(name)} has the length {stated:g}")
                length, offset = int(stated), offset + each.counts.itemsize
            lengths.append(length)
            offset += length * each.stored.itemsize
        return lengths, offset

    first, end = row_at(start)
    stride = end - start
    if start + count * stride <= len(data):  # in most files all rows have the same length
        columns, offset = [], start
        for each, length in zip(properties, first, strict=True):
            if each.counts is not None:
                if (np.ndarray((count,), each.counts, data, offset, (stride,)) != length).any():
                    break
                offset += each.counts.itemsize
            values = np.ndarray((count, length), each.stored, data, offset, (stride, each.stored.itemsize))
            columns.append((values.ravel(), np.full(count, length), offset + stride * np.arange(count)))
            offset += length * each.stored.itemsize
        else:
            return columns, start + count * stride
    sizes, places, end = np.empty((count, len(properties)), np.int64), np.empty(count, np.int64), start
    for row in range(count):
        places[row] = end
        sizes[row], end = row_at(end)
    if end > len(data):
        raise _cut_off(name, count)
    found, letters = [], np.frombuffer(data, np.uint8)
    for each, size in zip(properties, sizes.T, strict=True):
        places += 0 if each.counts is None else each.counts.itemsize
        width = each.stored.itemsize
        where = np.repeat(places, size) + width * ranges(np.zeros(count, np.int64), size)
        found.append((letters[where[:, None] + np.arange(width)].ravel().view(each.stored), size, places.copy()))
        places += size * width
    return found, end


def _typed(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the numbers of a text with the type in the header; floats stay 64-bit."""
    if values.dtype == dtype or dtype.kind == "f":
        return values
    if not np.array_equal(values, np.trunc(values)):
        raise ValueError("a whole number of it is written with a fraction")
    limits = np.iinfo(dtype)
    if len(values) and not limits.min <= values.min() <= values.max() <= limits.max:
        raise ValueError(f"a number of it is too large for the {dtype.name} that it should be")
    return values.astype(dtype)


def rewrite(data: bytes, vertices: Float64, normals: Float64) -> bytes:
    """Return a file with other `vertices` and `normals` (V, 3), in the same byte order; NaN keeps a normal.

    Types stay, but coordinates become 64-bit floats if integers or 32-bit floats cannot represent them.
    """
    content = _parse(data)
    edits, body = Edits(data), np.frombuffer(data, np.uint8)[content.start :]
    edges = np.flatnonzero(np.diff(body > ord(" "), prepend=False, append=False)).reshape(-1, 2) + content.start
    for names, values in ((("x", "y", "z"), vertices), (("nx", "ny", "nz"), normals)):
        old = _columns(content.elements["vertex"], names, np.float64)
        if old is None:
            continue
        values = np.where(np.isnan(values), old, values)
        for name, column, before in zip(names, values.T, old.T, strict=True):
            dtype = content.types[name]
            with np.errstate(over="ignore", invalid="ignore"):
                if dtype.kind != "f":
                    wide = not np.array_equal(column.astype(dtype), column)
                else:
                    wide = dtype.itemsize == 4 and names[0] == "x" and far_origin(vertices) is not None
            stored = np.dtype(f"{content.order}f8") if wide else dtype
            if wide:
                edits.replace([_type_span(data, name)], [b"double"])
            rows = np.flatnonzero((column != before) | (wide and content.order != ""))
            places = content.places[name][rows]
            if content.order:
                spans = content.start + places[:, None] + (0, dtype.itemsize)
                packed = column[rows].astype(stored).tobytes()
                size = stored.itemsize
                new = [packed[start : start + size] for start in range(0, len(packed), size)]
            else:
                spans = edges[places]
                new = [b"%a" % each for each in column[rows].astype("f8" if stored.kind == "f" else stored).tolist()]
            edits.replace(spans, new)
    return edits.result()


def _type_span(data: bytes, name: str) -> tuple[int, int]:
    """Return the start and end, in the header, of the type of a property of the first `vertex` element."""
    begin = re.search(rb"^[ \t]*element[ \t]+vertex\b", data, re.MULTILINE)
    start = begin.end() if begin else 0
    found = re.compile(rb"^[ \t]*property[ \t]+(\w+)[ \t]+%s[ \t]*\r?$" % name.encode(), re.MULTILINE).search(
        data, start
    )
    assert found is not None
    return found.span(1)


def encode(geometry: Geometry) -> bytes:
    """Return a little-endian file; coordinates have 64 bits if 32-bit floats are too coarse."""
    vertex = _named("xyz", geometry.vertices, "<f4" if far_origin(geometry.vertices) is None else "<f8")
    vertex |= _named(("nx", "ny", "nz"), geometry.normals, "<f4") | _named("st", geometry.uv, "<f4")
    vertex |= _named(_CHANNELS, geometry.colors, "u1")
    for name, values in geometry.attributes.items():
        if values.shape == (len(geometry.vertices),) and re.fullmatch(r"\w+", name) and values.dtype.kind in "iuf":
            vertex.setdefault(name, values if values.dtype.itemsize <= 4 else values.astype("f8"))
    channels = _named(_CHANNELS, geometry.face_colors, "u1")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(geometry.vertices)}"]
    head += [f"property {_SPELLED[values.dtype.str[1:]]} {name}" for name, values in vertex.items()]
    head += [f"element face {len(geometry.faces)}", "property list uchar int vertex_indices"]
    head += [f"property uchar {name}" for name in channels]
    counts = np.full(len(geometry.faces), 3, np.uint8)
    face: dict[str, NDArray[Any]] = {"count": counts, "corners": geometry.faces.astype(np.int32), **channels}
    return "\n".join([*head, "end_header", ""]).encode() + _rows(vertex) + _rows(face)


def _named(names: Sequence[str], values: NDArray[Any] | None, dtype: str) -> dict[str, NDArray[Any]]:
    """Return the columns of an array (N, K) by name, or {} for None; the type "u1" is for colors in [0, 1]."""
    if values is None:
        return {}
    stored = np.rint(values * 255) if dtype == "u1" else values
    return dict(zip(names, stored.astype(dtype).T, strict=True))


def _rows(columns: dict[str, NDArray[Any]]) -> bytes:
    """Return rows with one value of each column, little-endian."""
    (count,) = {len(values) for values in columns.values()}
    rows = np.empty(count, [(name, each.dtype.newbyteorder("<"), each.shape[1:]) for name, each in columns.items()])
    for name, values in columns.items():
        rows[name] = values
    return rows.tobytes()
