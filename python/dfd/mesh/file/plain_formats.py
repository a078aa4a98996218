"""PLY, STL and OFF: trimesh reads them; what it would read over is looked for here first."""

from __future__ import annotations

import struct

from dfd.mesh.file.assets import shortened
from dfd.mesh.file.obj.text import decoded

__all__ = ["checked"]

_STL_HEADER, _STL_FACE = 84, 50  # bytes


def checked(data: bytes, ending: str) -> bytes:
    """Return the bytes of a file as trimesh can read them, once its own counts hold: text in UTF-8.

    Raises
    ------
    ValueError
        If it holds fewer vertices, faces or corners than it says, or a face of fewer than three corners.
    """
    if ending == ".off":
        text = decoded(data)
        _check_off(text)
        return text.encode()
    if ending == ".stl":
        return _stl(data)
    head, mark, body = data.partition(b"end_header")
    if not mark:
        return data
    if b"format ascii" in head:
        _check_ply(decoded(head), body)
        return data if data.isascii() else decoded(data).encode()
    return decoded(head).encode() + mark + body


def _check_off(text: str) -> None:
    lines = [line.split("#", 1)[0] for line in text.splitlines()]
    words = [line for line in lines if line and not line.isspace()]
    if not words:
        raise ValueError("it holds nothing")
    first = words[0].split()
    counts, rest = (first[1:], words[1:]) if len(first) > 1 else (words[1].split() if len(words) > 1 else [], words[2:])
    if len(counts) < 2 or not all(each.isdigit() for each in counts[:2]):
        raise ValueError("it does not say how many vertices and faces it has")
    vertex_count, face_count = int(counts[0]), int(counts[1])
    if len(rest) < vertex_count + face_count:
        raise ValueError(
            f"it should have {vertex_count} vertices and {face_count} faces, but is cut off after {len(rest)} of them"
        )
    _check_faces(rest[vertex_count : vertex_count + face_count])


def _check_ply(head: str, body: bytes) -> None:
    """Check that every element of an ASCII file is there, and every corner of its faces."""
    elements = [line.split() for line in head.splitlines() if line.startswith("element")]
    lists = _first_properties(head)
    lines = [line for line in decoded(body).splitlines() if line and not line.isspace()]
    start = 0
    for element in elements:
        if len(element) < 3 or not element[2].isdigit():
            raise ValueError(f"it has the malformed line {shortened(' '.join(element))}")
        name, count = element[1], int(element[2])
        if start + count > len(lines):
            raise ValueError(
                f"it should have {count} of {shortened(name)}, but is cut off after {len(lines) - start} of them"
            )
        if name == "face" and lists.get(name):
            _check_faces(lines[start : start + count])
        start += count


def _first_properties(head: str) -> dict[str, bool]:
    """Return of each element whether its first property is a list."""
    found: dict[str, bool] = {}
    name = ""
    for line in head.splitlines():
        words = line.split()
        if words[:1] == ["element"] and len(words) > 1:
            name = words[1]
        elif words[:1] == ["property"]:
            found.setdefault(name, words[1:2] == ["list"])
    return found


def _check_faces(lines: list[str]) -> None:
    """Check lines that begin with the number of a face's corners."""
    for number, line in enumerate(lines):
        words = line.split()
        corners = int(words[0]) if words[0].isdigit() else -1
        if corners < 3:
            raise ValueError(f"face {number} has {shortened(words[0])} corners, and 3 are needed")
        if len(words) <= corners:
            raise ValueError(f"face {number} should have {corners} corners, but {len(words) - 1} are there")


def _stl(data: bytes) -> bytes:
    """Return an STL file whose length is right for what it says of itself."""
    if len(data) >= _STL_HEADER:
        count = struct.unpack("<I", data[80:84])[0]
        if len(data) == _STL_HEADER + _STL_FACE * count:
            return data
        if b"facet" not in data:
            raise ValueError(
                f"it should have {count} faces in {_STL_HEADER + _STL_FACE * count} bytes, but {len(data)} are there"
            )
    text = decoded(data)
    if text.lstrip()[:5].lower() != "solid":
        raise ValueError(f"it is cut off after {len(data)} bytes")
    lowered = text.lower()
    facets, ends = lowered.count("facet normal"), lowered.count("endfacet")
    if facets != ends or "endsolid" not in lowered:
        raise ValueError(f"it is cut off: it begins {facets} faces, ends {ends} and may lack others")
    return text.encode()
