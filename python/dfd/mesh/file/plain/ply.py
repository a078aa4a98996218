"""PLY files, text and binary.

The format: Turk, "The PLY Polygon File Format", 1994, with the colors, texture coordinates and texture of programs that
came later.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.appearance import Material
from dfd.mesh.file.assets import AssetFolder, shortened
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.materials import rgba
from dfd.mesh.file.obj.text import decoded
from dfd.mesh.file.polygons import ranges, triangulate
from dfd.mesh.file.primitives import Geometry

__all__ = ["read"]

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_KNOWN = {
    *("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha"),
    *(each for uv in _UV_NAMES for each in uv),
}
_TEXTURE = re.compile(r"comment\s+TextureFile\s+(\S.*)")


@dataclass(frozen=True)
class _Property:
    name: str
    dtype: np.dtype[Any]
    counts: np.dtype[Any] | None  # of a list, what its length is stored as


@dataclass(frozen=True)
class _List:
    """A list property: all values one after the other, and how many each row has."""

    values: NDArray[Any]
    sizes: NDArray[np.int64]


_Element = dict[str, "NDArray[Any] | _List"]


def read(path: Path, data: bytes, assets: AssetFolder) -> tuple[Geometry, NDArray[np.float64], NDArray[np.int64]]:
    """Return what a file shows, its own vertices (V, 3), and the vertex (N,) of each row of the geometry.

    Raises
    ------
    ValueError
        If it holds fewer numbers than it says, or a face names vertices by numbers that are not whole.

    Warns
    -----
    UserWarning
        If faces of fewer than three corners are left out.
    """
    head, mark, body = data.partition(b"end_header")
    lines = [line.strip() for line in decoded(head).splitlines() if line.strip()]
    if not mark or not lines or lines[0].lower() != "ply":
        raise ValueError("it has no header of a PLY file")
    found = _elements(lines, body)
    vertex = found.get("vertex", {})
    if not all(isinstance(vertex.get(name), np.ndarray) for name in "xyz"):
        raise ValueError("its vertices have no x, y and z")
    positions = _columns(vertex, ("x", "y", "z"), np.float64)
    assert positions is not None
    corners, sizes = _corners(path, found, len(positions))
    triangles = triangulate(positions, corners.values, sizes)
    picture = next((match[1].strip() for line in lines if (match := _TEXTURE.match(line))), None)
    material = None if picture is None else _material(picture, assets)
    uv = next((each for names in _UV_NAMES if (each := _columns(vertex, names, np.float64)) is not None), None)
    of_corners = found.get("face", {}).get("texcoord")
    numbers = np.arange(len(positions))
    faces = corners.values[triangles]
    if isinstance(of_corners, _List) and np.array_equal(of_corners.sizes, 2 * corners.sizes) and material is not None:
        pairs = of_corners.values.astype(np.float64).reshape(-1, 2)[corners.kept]
        rows, where = np.unique(np.column_stack([corners.values, pairs]), axis=0, return_inverse=True)
        numbers, uv, faces = rows[:, 0].astype(np.int64), rows[:, 1:], where.ravel()[triangles]
    others = {name: each for name, each in vertex.items() if isinstance(each, np.ndarray) and name not in _KNOWN}
    normals, colors = _columns(vertex, ("nx", "ny", "nz"), np.float64), _colors(vertex)
    face_colors = _colors(found.get("face", {}))
    if face_colors is not None and len(face_colors) == len(corners.sizes):
        face_colors = np.repeat(face_colors, np.maximum(corners.sizes - 2, 0), axis=0)
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


@dataclass(frozen=True)
class _Corners:
    """The corners of faces of at least three."""

    values: NDArray[np.int64]  # (C,) their vertices
    kept: NDArray[np.bool_]  # which of the file's corners they are
    sizes: NDArray[np.int64]  # of all faces of the file


def _corners(path: Path, found: dict[str, _Element], count: int) -> tuple[_Corners, NDArray[np.int64]]:
    """Return the corners of polygons and of triangle strips, and how many each polygon has."""
    lists = [_indices(found.get("face", {})), _indices(found.get("tristrips", {}))]
    faces = lists[0] or _List(np.zeros(0, np.int64), np.zeros(0, np.int64))
    values = faces.values.astype(np.int64)
    if len(short := np.flatnonzero(faces.sizes < 3)):
        warnings.warn(
            f"load: `path` {path} has {len(short)} faces of fewer than three corners, the first is face {short[0]}; "
            "they are left out",
            stacklevel=6,  # where `load` is called
        )
    kept = np.repeat(faces.sizes >= 3, faces.sizes)
    values, sizes = values[kept], faces.sizes[faces.sizes >= 3]
    if lists[1] is not None:
        strips = _strip_triangles(lists[1])
        values = np.concatenate([values, strips.ravel()])
        sizes = np.concatenate([sizes, np.full(len(strips), 3)])
    if len(values) and not 0 <= values.min() <= values.max() < count:
        wrong = values.min() if values.min() < 0 else values.max()
        raise ValueError(f"a face names vertex {wrong}, but there are {count}")
    return _Corners(values, kept, faces.sizes), sizes


def _indices(element: _Element) -> _List | None:
    found = element.get("vertex_indices", element.get("vertex_index"))
    if found is None:
        return None
    if not isinstance(found, _List) or found.values.dtype.kind not in "iu":
        raise ValueError("its faces name vertices by something other than lists of whole numbers")
    return found


def _strip_triangles(strips: _List) -> NDArray[np.int64]:
    """Return the triangles (F, 3) of strips; -1 in one begins another."""
    values = strips.values.astype(np.int64)
    run = np.cumsum(values < 0) + np.repeat(np.arange(len(strips.sizes)), strips.sizes) * (len(values) + 1)
    place = np.arange(len(values))
    new = np.diff(run, prepend=-1) != 0
    begin = np.maximum.accumulate(np.where(new, place + (values < 0), 0))  # a -1 stands before its own run
    first = np.flatnonzero((values[:-2] >= 0) & (run[:-2] == run[2:])) if len(values) > 2 else np.zeros(0, np.int64)
    triangles = values[first[:, None] + np.arange(3)]
    odd = (first - begin[first]) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)  # repeated corners only turn the strip
    result: NDArray[np.int64] = triangles[distinct]
    return result


def _material(picture: str, assets: AssetFolder) -> Material | None:
    images = ImageCache()
    try:
        return Material((1.0, 1.0, 1.0, 1.0), images.texels(images.open(assets.read(picture))))
    except (ValueError, OSError):
        assets.unreadable.add(shortened(picture))
        return None


def _columns(element: _Element, names: tuple[str, ...], dtype: Any) -> NDArray[Any] | None:
    columns = [each for name in names if isinstance(each := element.get(name), np.ndarray)]
    return np.stack(columns, axis=1).astype(dtype) if len(columns) == len(names) else None


def _colors(element: _Element) -> NDArray[np.float32] | None:
    for prefix in ("", "diffuse_"):
        for names in (("red", "green", "blue", "alpha"), ("red", "green", "blue")):
            columns = [rgba(each[:, None])[:, 0] for name in names
                       if isinstance(each := element.get(prefix + name), np.ndarray)]  # fmt: skip
            if len(columns) == len(names):
                return rgba(np.stack(columns, axis=1))
    return None


def _elements(lines: list[str], body: bytes) -> dict[str, _Element]:
    """Return the properties of each element by their names."""
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
            layout[-1][2].append(_Property(words[-1], dtypes[-1], dtypes[0] if len(types) == 2 else None))
    if order is None:
        raise ValueError("its header does not name a known format")
    text = order == ""
    if text:
        data, start = _numbers(body), 0
    else:  # the header ends with its line
        start = 2 if body[:2] == b"\r\n" else 1
        data = np.frombuffer(body, np.uint8)
    found: dict[str, _Element] = {}
    for name, count, properties in layout:
        if count > len(data):
            raise ValueError(f"it should have {count} of {shortened(name)}, but is cut off")
        element, start = _rows(data, start, name, count, properties, text)
        found.setdefault(name, element)
    return found


def _numbers(body: bytes) -> NDArray[Any]:
    words = body.split()
    try:
        return np.array(words, np.float64) if words else np.zeros(0)
    except ValueError as error:
        raise ValueError(f"its numbers hold something else: {shortened(str(error))}") from error


def _rows(
    data: NDArray[Any], start: int, name: str, count: int, properties: list[_Property], text: bool
) -> tuple[_Element, int]:
    """Return the properties of `count` rows from `start` on, and where they end."""
    width = [1 if text else each.dtype.itemsize for each in properties]
    head = [0 if each.counts is None else 1 if text else each.counts.itemsize for each in properties]
    cut = ValueError(f"it should have {count} of {shortened(name)}, but is cut off")

    def value(place: int, dtype: np.dtype[Any]) -> int:
        if place + (1 if text else dtype.itemsize) > len(data):
            raise cut
        found = data[place] if text else data[place : place + dtype.itemsize].view(dtype)[0]
        if not 0 <= found <= len(data) or found != int(found):
            raise ValueError(f"a list of {shortened(name)} has the length {found:g}")
        return int(found)

    if count == 0 or not properties:
        starts = [np.zeros(0, np.int64)] * len(properties)
        sizes = [np.zeros(0, np.int64) if each.counts is not None else None for each in properties]
        return _gathered(data, properties, starts, sizes, text), start
    # most files have rows that are all alike: as the first, in one step
    place = start
    first: list[int] = []
    lengths: list[int | None] = []
    for each, size, before in zip(properties, width, head, strict=True):
        length = 1 if each.counts is None else value(place, each.counts)
        first.append(place + before)
        lengths.append(None if each.counts is None else length)
        place += before + length * size
    stride = place - start
    rows = np.arange(count) * stride
    if start + count * stride <= len(data):
        all_starts = [each + rows for each in first]
        if all(
            each.counts is None or (_gather(data, where - before, each.counts, text) == size).all()
            for each, where, before, size in zip(properties, all_starts, head, lengths, strict=True)
        ):
            full = [None if size is None else np.full(count, size) for size in lengths]
            return _gathered(data, properties, all_starts, full, text), start + count * stride
    found_starts = np.empty((len(properties), count), np.int64)
    found_sizes = np.ones((len(properties), count), np.int64)
    place = start
    for row in range(count):
        for number, each in enumerate(properties):
            if each.counts is not None:
                found_sizes[number, row] = value(place, each.counts)
            found_starts[number, row] = place + head[number]
            place += head[number] + int(found_sizes[number, row]) * width[number]
    if place > len(data):
        raise cut
    listed = [None if each.counts is None else found_sizes[number] for number, each in enumerate(properties)]
    return _gathered(data, properties, list(found_starts), listed, text), place


def _gathered(
    data: NDArray[Any],
    properties: list[_Property],
    starts: list[NDArray[np.int64]],
    sizes: list[NDArray[np.int64] | None],
    text: bool,
) -> _Element:
    found: _Element = {}
    for each, where, size in zip(properties, starts, sizes, strict=True):
        if size is None:
            found[each.name] = _gather(data, where, each.dtype, text)
            continue
        width = 1 if text else each.dtype.itemsize
        places = np.repeat(where, size) + width * ranges(np.zeros(len(size), np.int64), size)
        found[each.name] = _List(_gather(data, places, each.dtype, text), size)
    return found


def _gather(data: NDArray[Any], places: NDArray[np.int64], dtype: np.dtype[Any], text: bool) -> NDArray[Any]:
    """Return the values at places: numbers of a text, or first bytes of values."""
    if text:
        values = data[places]
        if dtype.kind in "iu" and not np.array_equal(values, np.trunc(values)):
            raise ValueError("a whole number of it is written with a fraction")
        limits = np.iinfo(dtype) if dtype.kind in "iu" else None
        if limits is not None and len(values) and not limits.min <= values.min() <= values.max() <= limits.max:
            raise ValueError(f"a number of it is too large for the {dtype.name} that it should be")
        return values.astype(np.float64 if dtype.kind == "f" else dtype)
    if not len(places):
        return np.zeros(0, dtype)
    return np.ascontiguousarray(data[places[:, None] + np.arange(dtype.itemsize)]).view(dtype)[:, 0]
