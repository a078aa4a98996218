"""A small skinned file."""

from __future__ import annotations

import json
import struct

import numpy as np


def skinned_figure(weights: bytes | None = None) -> bytes:
    """A GLB with a skinned triangle, moved by its node, of three joints, and a triangle that hangs on a bone."""
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)
    first = np.array([(0, 1, 0, 0)] * 3, np.uint8)
    second = np.array([(2, 2, 2, 2)] * 3, np.uint8)
    most = np.array([(0.6, 0.4, 0, 0), (0.2, 0.2, 0, 0), (0.3, 0.7, 0, 0)], np.float32)
    rest = np.array([(0, 0, 0, 0), (0.6, 0, 0, 0), (0, 0, 0, 0)], np.float32)
    faces = np.array([(0, 1, 2)], np.uint16)
    chunks = [positions.tobytes(), first.tobytes(), second.tobytes(), most.tobytes(), rest.tobytes(), faces.tobytes()]
    if weights is not None:
        chunks = [*chunks[:3], weights, weights, chunks[5]]
    starts = np.cumsum([0, *map(len, chunks)]).tolist()
    kinds = [(5126, "VEC3", 3), (5121, "VEC4", 3), (5121, "VEC4", 3), (5126, "VEC4", 3), (5126, "VEC4", 3)]
    if weights is not None:
        starts[3:5] = [starts[5], starts[5]]  # where the file has no room for so many numbers
    accessors = [
        {"bufferView": index, "componentType": component, "type": kind, "count": count}
        for index, (component, kind, count) in enumerate([*kinds, (5123, "SCALAR", 3)])
    ]
    accessors[0] |= {"min": [0, 0, 0], "max": [1, 1, 0]}
    skinned = {"POSITION": 0, "JOINTS_0": 1, "JOINTS_1": 2, "WEIGHTS_0": 3, "WEIGHTS_1": 4}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"name": "all", "children": [1], "translation": [5, 0, 0]},
            {"name": "body", "mesh": 0, "skin": 0},
            {"name": "sword", "mesh": 1, "translation": [0, 0, 3]},
            {"name": "upperarm.l"},
            {"name": "upperarm.r"},
            {"name": "head"},
        ],
        "skins": [{"joints": [3, 4, 5]}],
        "meshes": [
            {"primitives": [{"attributes": skinned, "indices": 5}]},
            {"primitives": [{"attributes": {"POSITION": 0}, "indices": 5}]},
        ],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(chunk)}
            for start, chunk in zip(starts, chunks, strict=False)
        ],
        "buffers": [{"byteLength": sum(map(len, chunks))}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(chunks)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<III", 0x46546C67, 2, 12 + len(body)) + body
