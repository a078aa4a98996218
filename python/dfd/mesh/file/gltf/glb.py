"""The GLB container: one chunk of JSON and one of data behind a header of twelve bytes.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 4.
"""

from __future__ import annotations

import struct

_MAGIC = b"glTF"
_JSON, _DATA = 0x4E4F534A, 0x004E4942


def is_glb(data: bytes) -> bool:
    """Return whether a file begins with the magic bytes of GLB."""
    return data[:4] == _MAGIC


def split(data: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON text and the data (or None) of a GLB file; ValueError if it is malformed."""
    if len(data) < 20:
        raise ValueError(f"it is cut off after {len(data)} bytes")
    version, total = struct.unpack("<II", data[4:12])
    if version != 2:
        raise ValueError(f"it has version {version} of the format, and only 2 can be read")
    if total != len(data):
        raise ValueError(f"it should have {total} bytes, but {len(data)} are there")
    kind, text, end = _chunk(data, 12)
    if kind != _JSON:
        raise ValueError("its first chunk is not JSON")
    while end + 8 <= len(data):
        kind, content, end = _chunk(data, end)
        if kind == _DATA:
            return text, content
    return text, None


def join(text: bytes, data: bytes) -> bytes:
    """Return the GLB file of a JSON text and the data that belongs to it."""
    text += b" " * (-len(text) % 4)
    padding = bytes(-len(data) % 4)
    total = 12 + 8 + len(text) + 8 + len(data) + len(padding)
    head = struct.pack("<4sIIII", _MAGIC, 2, total, len(text), _JSON)
    return b"".join([head, text, struct.pack("<II", len(data) + len(padding), _DATA), data, padding])


def _chunk(data: bytes, start: int) -> tuple[int, bytes, int]:
    """Return kind, content and end of the chunk at `start`."""
    length, kind = struct.unpack("<II", data[start : start + 8])
    end = start + 8 + length
    if end > len(data):
        raise ValueError(f"a chunk of it should have {length} bytes, but {len(data) - start - 8} are there")
    return kind, data[start + 8 : end], end
