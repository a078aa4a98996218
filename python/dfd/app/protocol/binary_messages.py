"""What the server sends with arrays: the headers of its binary messages."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol.answers import Answer
from dfd.app.protocol.parts import Model, Vector


class Buffer(Model):
    """An array of a binary message; `offset` counts bytes from the end of the header."""

    name: str
    dtype: Literal["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32"]
    shape: tuple[int, ...]
    offset: int


class Binary(Answer):
    """The header of a binary message."""

    buffers: tuple[Buffer, ...]


class MaterialEntry(Model):
    """What one kind of surface looks like; colors are display-referred (sRGB)."""

    color: tuple[float, float, float, float]
    texture: str | None  # name of the buffer that holds the picture's file
    media_type: str | None
    wrap: tuple[Literal["repeat", "mirror", "clamp"], Literal["repeat", "mirror", "clamp"]]
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"]
    alpha_cutoff: float


class Group(Model):
    """A run of triangles of one material."""

    material: int  # index into `materials`
    start: int  # first triangle
    count: int


class MeshMessage(Binary):
    """The resting shape. A row is a vertex as the file has it, split at seams; weights belong to vertices.

    Buffers: `positions` float32 (R, 3), relative to `center`; `triangles` uint32 (F, 3), corners as rows; `vertex`
    uint32 (R,), the vertex of each row; `normals` int16 (R, 4), of length 32767, the fourth 0; where the file has them,
    `uv` float32 (R, 2), v upwards, and `colors` uint8 (R, 4), display-referred; and the textures' files.
    """

    type: Literal["mesh"] = "mesh"
    name: str
    vertices: int
    faces: int
    parts: int
    center: Vector
    diagonal: float
    groups: tuple[Group, ...]
    materials: tuple[MaterialEntry, ...]
    warnings: tuple[str, ...]  # of reading the file, sentences


class ColumnsMessage(Binary):
    """Columns that `state` names and the page has not got; it may forget those that `state` no longer names.

    Buffer `values` uint16 (C, V), weights times 65535, one row for each number of `columns`.
    """

    type: Literal["columns"] = "columns"
    columns: tuple[int, ...]


class HeatMessage(Binary):
    """Answer to `probe` and `take_part`: buffer `values` uint16 (V,), weights times 65535."""

    type: Literal["heat"] = "heat"
    vertex: int | None


class PositionsMessage(Binary):
    """Answer to `compute`: `positions` float32 (V, 3), relative to the mesh's center, and `normals` int16 (V, 4)."""

    type: Literal["positions"] = "positions"


class ColorsMessage(Binary):
    """Answer to `features`: `colors` uint8 (V, 4)."""

    type: Literal["colors"] = "colors"


ALIGNMENT = 8  # bytes


def pack(kind: type[Binary], arrays: Mapping[str, NDArray[Any]], **fields: Any) -> bytes:
    """The message of that kind with `arrays` as its buffers and `fields` in its header."""
    buffers: list[Buffer] = []
    parts: list[bytes] = []
    end = 0
    for name, array in arrays.items():
        data = array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()
        dtype: Any = array.dtype.name
        buffers.append(Buffer(name=name, dtype=dtype, shape=array.shape, offset=end))
        parts += [data, bytes(-len(data) % ALIGNMENT)]
        end += len(data) + len(parts[-1])
    header = kind(buffers=tuple(buffers), **fields).model_dump_json().encode()
    header += b" " * (-(4 + len(header)) % ALIGNMENT)
    return b"".join([len(header).to_bytes(4, "little"), header, *parts])


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The header and the arrays of a message, by their names."""
    start = 4 + int.from_bytes(message[:4], "little")
    header = json.loads(message[4:start])
    arrays = {}
    for each in header["buffers"]:
        count = int(np.prod(each["shape"], dtype=np.int64))
        flat = np.frombuffer(message, np.dtype(each["dtype"]).newbyteorder("<"), count, start + each["offset"])
        arrays[each["name"]] = flat.reshape(each["shape"])
    return header, arrays
