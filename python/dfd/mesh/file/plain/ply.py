"""Read and write text and binary PLY files (Turk, "The PLY Polygon File Format", 1994).

Colors, texture coordinates and textures follow conventions of later programs.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.mesh.appearance import WHITE, Material
from dfd.mesh.colors import ranged
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.complete import existing_completed
from dfd.mesh.file.edits import Edits, far_origin
from dfd.mesh.file.moved import Saving, placed
from dfd.mesh.file.polygons import check_corners, long_faces, ranges, triangulate
from dfd.mesh.file.primitives import Geometry, MeshInstance
from dfd.mesh.file.scene_file import FileSource, SceneFile
from dfd.mesh.file.text import decoded, number, numbers, readable_numbers, shortened

_CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_SPELLED = dict(zip(_CODES, ("char", "uchar", "short", "ushort", "int", "uint", "float", "double"), strict=True))
_TYPES = {name: code for code in _CODES for name in (_SPELLED[code], np.dtype(code).name)}
_TYPES |= {"int64": "i8", "uint64": "u8", "long": "i8", "ulong": "u8"}  # beyond the format, as some programs write
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_CHANNELS = ("red", "green", "blue", "alpha")
_COLOR_NAMES = (_CHANNELS, tuple(f"diffuse_{each}" for each in _CHANNELS), ("r", "g", "b", "a"))
_NORMAL_NAMES = ("nx", "ny", "nz")
_POSITION_NAMES = ("x", "y", "z")
_LINE = re.compile(rb"[^\r\n]+")
_END = re.compile(rb"(?<![^\r\n])[ \t]*end_header[ \t]*(?=[\r\n]|$)")
_TYPE = re.compile(rb"\s*property\s+(\w+)", re.IGNORECASE)


@dataclass
class _Property:
    """A property of a PLY element, with its values in all rows of this element."""

    name: str
    dtype: np.dtype[Any]  # type of the values, according to the header
    type_span: tuple[int, int]  # bytes of the header at which the name of this type begins and ends; unused for lists
    stored: np.dtype[Any]  # type of the values in the body; 64-bit float in a text file, whose body is converted
    counts: np.dtype[Any] | None  # type of a list's length, which precedes the list in the body; None if it is no list
    values: NDArray[Any] = field(default_factory=lambda: np.zeros(0))  # values of all rows, one row after the other
    sizes: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))  # (rows,) number of values of each row
    places: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))  # (rows,) first byte in the body


_Element = dict[str, _Property]


@dataclass(frozen=True)
class _Content:
    """The parsed content of a file."""

    start: int  # byte of the file at which the body begins, after "end_header"
    order: str  # byte order, "<" or ">"; "" for a text file, whose body is converted to 64-bit floats
    pictures: tuple[str, ...]  # file names of textures
    elements: dict[str, _Element]  # the properties of each element by their names in lower case


def read(path: Path, data: bytes, assets: AssetFolder, at_rest: bool) -> SceneFile:
    """Return the scene of a PLY file.

    Raises ValueError if the file is malformed. Warns if faces with fewer than three corners are left out.
    """
    geometry, vertices, numbers = _geometry(path, data, assets)
    source = FileSource(np.frombuffer(data, np.uint8), numbers)
    instances = [MeshInstance(path.stem, path.stem, geometry)]
    return SceneFile.of(path, instances, own_vertices=vertices, source=source)


def _geometry(path: Path, data: bytes, assets: AssetFolder) -> tuple[Geometry, Float64, Int64]:
    """Return the geometry of a file, the file's vertices (V, 3), and each geometry vertex's index (N,) in the file."""
    content = _parse(data)
    vertex, face = content.elements.get("vertex", {}), content.elements.get("face", {})
    positions = _columns(vertex, ("x", "y", "z"))
    if positions is None:
        raise ValueError("its vertices have no x, y and z")
    corners, sizes, kept = _polygons(path, face, content.elements.get("tristrips", {}), len(positions))
    triangles = triangulate(positions, corners, sizes)
    if content.pictures[1:]:
        assets.notes.add(f"the textures after the first, {shortened(', '.join(content.pictures[1:]))}, are ignored")
    picture = next(iter(content.pictures), None)
    texels = None if picture is None else assets.texture(picture, shortened(picture))
    uv_names = next((names for names in _UV_NAMES if _columns(vertex, names) is not None), ())
    uv = _columns(vertex, uv_names) if uv_names else None
    origin = np.arange(len(positions))
    faces = corners[triangles]
    face_sizes = _indices(face)[1]
    of_corners = _corner_coordinates(face.get("texcoord"), face_sizes)
    if texels is not None and of_corners is not None:
        pairs = np.full((len(corners), 2), np.nan)  # triangle strips have none
        pairs[: int(kept.sum())] = of_corners[kept]
        known = np.isfinite(pairs).all(axis=1)
        keys = np.column_stack([corners, known, np.where(known[:, None], pairs, 0)])
        rows, where = np.unique(keys, axis=0, return_inverse=True)
        origin, faces = rows[:, 0].astype(np.int64), where.ravel()[triangles]
        uv, uv_names = np.where(rows[:, 1:2] > 0, rows[:, 2:], np.nan), ()
    normals, (colors, color_names), (face_colors, _) = _columns(vertex, _NORMAL_NAMES), _colors(vertex), _colors(face)
    if face_colors is not None:  # triangle strips have none
        face_colors = np.repeat(face_colors, np.maximum(face_sizes - 2, 0), axis=0)
        gap = np.full((len(faces) - len(face_colors), 4), np.nan, np.float32)
        face_colors = np.concatenate([face_colors, gap])
    read = {*_POSITION_NAMES, *(() if normals is None else _NORMAL_NAMES), *uv_names, *color_names}
    geometry = Geometry(
        positions[origin],
        faces,
        None if normals is None else normals[origin],
        uv if uv is None or len(uv) == len(origin) else uv[origin],
        None if colors is None else colors[origin],
        face_colors,
        None if texels is None else Material(WHITE, texels),
        {each.name: each.values[origin] for name, each in vertex.items() if each.counts is None and name not in read},
    )
    return geometry, positions, origin


def _polygons(path: Path, face: _Element, strips: _Element, count: int) -> tuple[Int64, Int64, Bool]:
    """Return each corner's vertex (C,), each polygon's number of corners (P,), and which corners of `face` are kept."""
    corners, sizes = _indices(face)
    long = long_faces(path, sizes)
    kept = np.repeat(long, sizes)  # faces with fewer than three corners are left out
    triangles = _strip_triangles(*_indices(strips))
    corners = np.concatenate([corners[kept], triangles.ravel()])
    check_corners(corners, count)
    return corners, np.concatenate([sizes[long], np.full(len(triangles), 3)]), kept


def _indices(element: _Element) -> tuple[Int64, Int64]:
    """Return the vertex indices of all faces or strips of an element, and the number of indices per face or strip."""
    found = element.get("vertex_indices", element.get("vertex_index"))
    if found is None:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    if found.counts is None or found.values.dtype.kind not in "iu":
        raise ValueError("its faces name vertices by something other than lists of whole numbers")
    return found.values.astype(np.int64), found.sizes


def _strip_triangles(values: Int64, sizes: Int64) -> Int64:
    """Return the triangles (F, 3) of triangle strips; a negative index ends a strip."""
    run = np.cumsum(values < 0) + np.repeat(np.arange(len(sizes)), sizes) * (len(values) + 1)
    index = np.arange(len(values))
    new = np.diff(run, prepend=-1) != 0
    begin = np.maximum.accumulate(np.where(new, index + (values < 0), 0))  # a run may begin with a negative index
    first = np.flatnonzero((values[:-2] >= 0) & (run[:-2] == run[2:])) if len(values) > 2 else np.zeros(0, np.int64)
    triangles = values[first[:, None] + np.arange(3)]
    odd = (first - begin[first]) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)  # other triangles have no area
    return triangles[distinct]


def _scalars(element: _Element, names: Sequence[str]) -> list[NDArray[Any]]:
    """Return the values of the named properties that exist and are not lists."""
    return [each.values for name in names if (each := element.get(name)) is not None and each.counts is None]


def _columns(element: _Element, names: Sequence[str]) -> Float64 | None:
    columns = _scalars(element, names)
    return np.stack(columns, axis=1).astype(np.float64) if len(columns) == len(names) else None


def _corner_coordinates(found: _Property | None, sizes: Int64) -> Float64 | None:
    """Return the texture coordinates (C, 2) of face corners; NaN for faces whose list has another length."""
    if found is None or found.counts is None or not len(sizes):
        return None
    fits = found.sizes == 2 * sizes
    if not (fits & (sizes > 0)).any():
        return None
    pairs = np.full((int(sizes.sum()), 2), np.nan)
    pairs[np.repeat(fits, sizes)] = found.values[np.repeat(fits, found.sizes)].astype(np.float64).reshape(-1, 2)
    return pairs


def _colors(element: _Element) -> tuple[Float32 | None, tuple[str, ...]]:
    """Return the colors (N, 4) of an element, NaN where they are missing, and the names of their properties."""
    for names in _COLOR_NAMES:
        for channels in (names, names[:3]):
            columns = _scalars(element, channels)
            if len(columns) == len(channels):
                if all(each.dtype.kind in "iu" and each.dtype.itemsize == 1 for each in columns):
                    columns = [each.view(f"{each.dtype.byteorder}u1") for each in columns]
                    return ranged(np.stack(columns, axis=1)), channels
                return ranged(np.stack([each.astype(np.float64) for each in columns], axis=1)), channels
    return None, ()


def _parse(data: bytes) -> _Content:
    mark = _END.search(data)
    head, body = (data, b"") if mark is None else (data[: mark.start()], data[mark.end() :])
    lines = [(line.start(), text) for line in _LINE.finditer(head) if (text := decoded(line[0]).strip())]
    if mark is None or lines[0][1].lower() != "ply":
        raise ValueError("it has no header of a PLY file")
    order, pictures = None, list[str]()
    layout: list[tuple[str, int, list[_Property]]] = []
    for place, line in lines[1:]:
        words, malformed = line.split(), ValueError(f"it has the malformed line {shortened(line)}")
        words[0] = words[0].lower()
        if words[0] == "format" and len(words) > 1 and words[1].lower() in _ORDERS:
            order = _ORDERS[words[1].lower()]
        elif words[:2] == ["comment", "TextureFile"] and len(words) > 2:
            pictures.append(line.split(None, 2)[2])
        elif words[0] == "element":
            if len(words) != 3 or not words[2].isdecimal():
                raise malformed
            layout.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            is_list = [each.lower() for each in words[1:2]] == ["list"]
            types = [each.lower() for each in (words[2:4] if is_list else words[1:2])]
            if not layout or len(words) != (5 if is_list else 3) or not set(types) <= set(_TYPES):
                raise malformed
            dtypes = [np.dtype((order or "=") + _TYPES[each]) for each in types]
            if dtypes[:-1] and dtypes[0].kind == "f":
                raise malformed
            stored = [np.dtype(np.float64) if order == "" else each for each in dtypes]
            found = _TYPE.match(head, place)
            assert found is not None
            counts = stored[0] if len(types) == 2 else None
            layout[-1][2].append(_Property(words[-1], dtypes[-1], found.span(1), stored[-1], counts))
    if order is None:
        raise ValueError("its header does not name a known format")
    start = 2 if body[:2] == b"\r\n" else 1  # the line break after the header
    content = _Content(mark.end(), order, tuple(pictures), {})
    if not order:  # parse a text file like a binary file of 64-bit floats
        line_count = len(head.splitlines()) + 1
        written, body, start = body, _text_as_floats(body, line_count), 0
    try:
        for name, count, properties in layout:
            if count > len(body):
                raise _cut_off(name, count)
            if count and properties:
                start = _read_rows(body, start, name, count, properties)
            for each in properties:
                each.values = _typed(each.values, each)
            content.elements.setdefault(name.lower(), {each.name.lower(): each for each in properties})
    except ValueError:
        if not order:
            _check_lines(written, layout, line_count)
        raise
    if not order and start < len(body):
        _check_lines(written, layout, line_count)
    return content


def _check_lines(text: bytes, layout: list[tuple[str, int, list[_Property]]], before: int) -> None:
    """Raise ValueError with the first row whose line has too many or too few numbers, if each row has a line.

    `before` lines precede the text.
    """
    lines = [(place, words) for place, line in enumerate(text.splitlines(), before) if (words := line.split())]
    rows = [(name, row, properties) for name, count, properties in layout if properties for row in range(count)]
    if len(lines) < len(rows):
        return
    for (line, words), (name, row, properties) in zip(lines, rows, strict=False):
        needed = 0
        for each in properties:
            size = number(words[needed]) if each.counts is not None and needed < len(words) else 0.0
            needed += 1 + (int(size) if 0 <= size < len(text) else 0)
        if len(words) != needed:
            has = f"has {len(words)} numbers, and {needed} are needed"
            raise ValueError(f"line {line}: row {row} of {shortened(name)} {has}")


def _text_as_floats(body: bytes, before: int) -> bytes:
    """Return the numbers of a text as 64-bit floats. `before` lines precede the text."""
    words = body.split()
    found = numbers(readable_numbers(body), np.float64, len(words))
    if found is None:
        for line, text in enumerate(body.splitlines(), before):
            for word in text.split():
                if numbers(readable_numbers(word), np.float64, 1) is None:
                    raise ValueError(f"line {line} must consist of numbers, got {shortened(decoded(word))}")
        raise ValueError("its body must consist of numbers")
    return found.tobytes()


def _cut_off(name: str, count: int) -> ValueError:
    return ValueError(f"it is cut off before the end of its {count} rows of {shortened(name)}")


def _read_rows(data: bytes, start: int, name: str, count: int, properties: list[_Property]) -> int:
    """Read `count` rows of an element, from byte `start`, into `properties`. Return the first byte after the rows."""

    def row_at(offset: int) -> tuple[list[int], list[int], int]:
        """Return the number of values and the first byte of each property in the row at `offset`, and the row's end."""
        lengths, places = [], []
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
            places.append(offset)
            offset += length * each.stored.itemsize
        return lengths, places, offset

    lengths, places, end = row_at(start)
    stride = end - start

    def repeats(each: _Property, length: int, place: int) -> bool:
        if each.counts is None:
            return True
        return bool((np.ndarray(count, each.counts, data, place - each.counts.itemsize, stride) == length).all())

    if start + count * stride <= len(data) and all(map(repeats, properties, lengths, places)):  # equal row sizes
        for each, length, place in zip(properties, lengths, places, strict=True):
            strides = (stride, each.stored.itemsize)
            each.values = np.ndarray((count, length), each.stored, data, place, strides).ravel()
            each.sizes, each.places = np.full(count, length), place + stride * np.arange(count)
        return start + count * stride
    rows, end = np.empty((count, 2, len(properties)), np.int64), start
    for row in rows:
        row[0], row[1], end = row_at(end)
    if end > len(data):
        raise _cut_off(name, count)
    for index, each in enumerate(properties):
        each.sizes, each.places = rows[:, :, index].T
        width = each.stored.itemsize
        where = np.repeat(each.places, each.sizes) + width * ranges(np.zeros(count, np.int64), each.sizes)
        letters = np.frombuffer(data, np.uint8)[where[:, None] + np.arange(width)]
        each.values = letters.ravel().view(each.stored)
    return end


def _typed(values: NDArray[Any], own: _Property) -> NDArray[Any]:
    """Return numbers with the type that the header states.

    Floats of a text file keep 64 bits, and so do all numbers of a property that do not fit its integer type.
    """
    dtype = own.dtype
    if values.dtype == dtype or dtype.kind == "f":
        return values
    limits, whole = np.iinfo(dtype), np.array_equal(values, np.trunc(values))
    if whole and (not len(values) or limits.min <= values.min() <= values.max() <= limits.max):
        return values.astype(dtype)
    if own.counts is None:
        return values
    what = "a number that is out of range for " + dtype.name if whole else "a fraction in place of a whole number"
    raise ValueError(f"a list of {shortened(own.name)} has {what}")


def rewrite(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return the source of `saving` with new positions and normals; old numbers stay where these are missing.

    Byte order and number types stay, except that the type becomes a 64-bit float if the old type is too coarse.
    """
    data, (vertices, normals) = saving.source.data.tobytes(), saving.of_vertices()
    content = _parse(data)
    edits, vertex, body = Edits(data), content.elements["vertex"], np.frombuffer(data, np.uint8)[content.start :]
    edges = np.flatnonzero(np.diff(body > ord(" "), prepend=False, append=False)).reshape(-1, 2) + content.start
    for names, values in ((_POSITION_NAMES, vertices), (_NORMAL_NAMES, normals)):
        old = _columns(vertex, names)
        if old is None:
            continue
        for name, column, before in zip(names, np.where(np.isnan(values), old, values).T, old.T, strict=True):
            each, stored = vertex[name], vertex[name].dtype
            with np.errstate(over="ignore", invalid="ignore"):
                if stored.kind != "f":
                    wide = not np.array_equal(column.astype(stored), column)
                else:
                    wide = stored.itemsize == 4 and names[0] == "x" and far_origin(saving.vertices) is not None
            if wide:
                edits.replace([each.type_span], [b"double"])
                stored = np.dtype(f"{content.order}f8")
            same = (column == before) | np.isnan(column)
            rows = np.flatnonzero(~same | (wide and content.order != ""))
            if content.order:
                spans = content.start + each.places[rows, None] + (0, each.dtype.itemsize)
                edits.replace(spans, column[rows].astype(stored).view(f"V{stored.itemsize}").tolist())
            else:
                new = column[rows].astype("f8" if stored.kind == "f" else stored).tolist()
                edits.replace(edges[each.places[rows] // 8], [b"%a" % value for value in new])
    return {saving.target.name: edits.result()}, np.zeros(0)


def encode(saving: Saving) -> tuple[dict[str, bytes], Float64]:
    """Return a binary PLY file. Several primitives are merged; textures, which PLY cannot store, become colors."""
    return {saving.target.name: _encoded(_merged(saving))}, np.zeros(0)


def _merged(saving: Saving) -> Geometry:
    scene, vertices, faces, look = saving.scene, saving.vertices, saving.faces, saving.look
    if scene is not None and len(saving.moved) == 1:
        first = existing_completed(saving).moved[0]
        geometry, material = first.geometry, first.geometry.material or Material(is_default=True)
        if geometry.uv is None or (material.texture is None and not material.is_default):
            normals = None if first.normals is None else first.normals_to_scene(first.normals)
            local = scene.local_faces(first).astype(np.int64)
            return replace(geometry, vertices=placed(first, vertices, scene)[0], faces=local, normals=normals)
    if look is None:
        return Geometry(vertices, faces.astype(np.int64))
    used_rows, corners = np.unique(look.corner_faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    return Geometry(vertices[look.corners[used_rows]], corners, colors=look.corner_colors(corners, len(used_rows)))


def _encoded(geometry: Geometry) -> bytes:
    """Return a binary PLY file; coordinates have 64 bits if 32-bit floats are too coarse."""
    vertex = _named("xyz", geometry.vertices, "<f4" if far_origin(geometry.vertices) is None else "<f8")
    vertex |= _named(("nx", "ny", "nz"), geometry.normals, "<f4") | _named("st", geometry.uv, "<f4")
    vertex |= _named(_CHANNELS, geometry.colors, "u1")
    for name, values in geometry.attributes.items():
        if values.shape[:1] == (len(geometry.vertices),) and re.fullmatch(r"\w+", name) and values.dtype.kind in "iuf":
            columns = values.reshape(len(values), -1).T
            names = [name] if values.ndim == 1 else [f"{name}_{index}" for index in range(len(columns))]
            for own, column in zip(names, columns, strict=True):
                vertex.setdefault(own, column if column.dtype.itemsize <= 4 else column.astype("f8"))
    channels = _named(_CHANNELS, geometry.face_colors, "u1")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(geometry.vertices)}"]
    head += [f"property {_SPELLED[values.dtype.str[1:]]} {name}" for name, values in vertex.items()]
    head += [f"element face {len(geometry.faces)}", "property list uchar int vertex_indices"]
    head += [f"property uchar {name}" for name in channels]
    counts = np.full(len(geometry.faces), 3, np.uint8)
    face: dict[str, NDArray[Any]] = {"count": counts, "corners": geometry.faces.astype(np.int32), **channels}
    return "\n".join([*head, "end_header", ""]).encode() + _rows(vertex) + _rows(face)


def _named(names: Sequence[str], values: NDArray[Any] | None, dtype: str) -> dict[str, NDArray[Any]]:
    """Return the columns of an array (N, K) by name, or {} for None. With `dtype` "u1", [0, 1] becomes 0 to 255."""
    if values is None:
        return {}
    stored = np.rint(values * 255) if dtype == "u1" else values
    return dict(zip(names, stored.astype(dtype).T, strict=True))


def _rows(columns: dict[str, NDArray[Any]]) -> bytes:
    """Return the little-endian bytes of rows with one value from each column."""
    layout = [(name, each.dtype.newbyteorder("<"), each.shape[1:]) for name, each in columns.items()]
    return np.rec.fromarrays(list(columns.values()), dtype=layout).tobytes()
