"""Binary messages: a header that says what follows, then arrays; `dfd.app.protocol` describes the bytes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.protocol.binaries import Binary, Buffer

__all__ = ["pack", "unpack"]

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
