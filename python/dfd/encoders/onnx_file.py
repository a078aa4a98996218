"""Read the constant tensors and the nodes of an ONNX file, without the package `onnx`.

An ONNX file is one message of Protocol Buffers. The numbers of fields below are those of `onnx.proto`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32

FLOAT = 1  # `TensorProto.DataType` of float32


@dataclass(frozen=True)
class Node:
    """A node of the graph."""

    inputs: list[str]  # names of the tensors that it reads
    name: str
    kind: str  # the operation, such as MatMul


def read_graph(content: bytes) -> tuple[dict[str, Float32], list[Node]]:
    """Return the float32 constants by name, which are read-only, and the nodes of an ONNX file.

    Raises ValueError if `content` is truncated or is no ONNX file.
    """
    try:
        [graph] = (value for number, value in _fields(memoryview(content)) if number == 7)
        constants: dict[str, Float32] = {}
        nodes: list[Node] = []
        for number, value in _fields(graph):
            if number == 1:
                parts = list(_fields(value))
                inputs = [_text(part) for field, part in parts if field == 1]
                named = {field: _text(part) for field, part in parts if field in (3, 4)}
                nodes.append(Node(inputs, named.get(3, ""), named[4]))
            elif number == 5:
                parts = list(_fields(value))
                tensor = dict(parts)
                if tensor[2] == FLOAT and 9 in tensor:
                    shape = [part for field, part in parts if field == 1 and isinstance(part, int)]
                    constants[_text(tensor[8])] = np.frombuffer(tensor[9], "<f4").reshape(shape)
    except (IndexError, KeyError, TypeError, ValueError) as error:
        raise ValueError("read_graph: `content` is no whole ONNX file") from error
    return constants, nodes


def _fields(message: Any) -> Iterator[tuple[int, Any]]:
    """Yield the number and the value of each field: a whole number, or bytes. Packed lists stay bytes."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        if key & 7 == 0:
            value, at = _varint(message, at)
            yield key >> 3, value
            continue
        length, at = _varint(message, at) if key & 7 == 2 else ({1: 8, 5: 4}[key & 7], at)
        if at + length > len(message):
            raise ValueError("truncated")
        yield key >> 3, message[at : at + length]
        at += length


def _varint(message: Any, at: int) -> tuple[int, int]:
    """Return the whole number at a position, and the position after it."""
    value = shift = 0
    while True:
        byte = message[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at


def _text(value: Any) -> str:
    return bytes(value).decode()
