"""Messages of the server with arrays."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from dfd.app.protocol.answers import Answer
from dfd.app.protocol.parts import Model, Vector


class MaterialEntry(Model):
    """A material; colors are display-referred (sRGB)."""

    color: tuple[float, float, float, float]
    texture: str | None  # name of the array with the picture file
    media_type: str | None
    wrap: tuple[Literal["repeat", "mirror", "clamp"], Literal["repeat", "mirror", "clamp"]]
    alpha_mode: Literal["OPAQUE", "MASK", "BLEND"]
    alpha_cutoff: float


class Group(Model):
    """Consecutive triangles of one material."""

    material: int  # index into `materials`
    start: int  # first triangle
    count: int


class MeshMessage(Answer):
    """The resting shape. A row is a vertex of the file, which is split at seams; weights belong to vertices.

    Arrays: `positions` float32 (R, 3), relative to `center`; `triangles` uint32 (F, 3), rows of the corners; `vertex`
    uint32 (R,), the vertex of each row; `normals` int16 (R, 4), of length 32767, the fourth 0. If the file has them:
    `uv` float32 (R, 2), v upwards; `colors` uint8 (R, 4), display-referred; and the picture files of textures.
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
    warnings: tuple[str, ...]  # warnings of reading the file, as sentences


class ColumnsMessage(Answer):
    """Columns in `state` that the page lacks. The page may delete columns that are no longer in `state`.

    Array: `values` uint16 (C, V), weights times 65535, one row for each number in `columns`.
    """

    type: Literal["columns"] = "columns"
    columns: tuple[int, ...]


class HeatMessage(Answer):
    """Answer to `probe` and `take_part`: `values` uint16 (V,), weights times 65535."""

    type: Literal["heat"] = "heat"
    vertex: int | None


class PositionsMessage(Answer):
    """Answer to `compute`: `positions` float32 (V, 3), relative to the mesh's center, and `normals` int16 (V, 4)."""

    type: Literal["positions"] = "positions"


class ColorsMessage(Answer):
    """Answer to `features`: `colors` uint8 (V, 4)."""

    type: Literal["colors"] = "colors"


def pack(message: Answer, **arrays: NDArray[Any]) -> bytes:
    """Return a message with arrays as bytes; see `dfd.app.protocol`."""
    whole = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    return save(whole, {"message": message.model_dump_json()})
