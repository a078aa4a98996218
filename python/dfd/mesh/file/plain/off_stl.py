"""OFF and STL files: positions and faces alone.

The formats: Geomview, "OFF Files", 1996; 3D Systems, "StereoLithography Interface Specification", 1989.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.file.assets import shortened
from dfd.mesh.file.obj.text import decoded
from dfd.mesh.file.polygons import check_corners, triangulate
from dfd.mesh.file.primitives import Geometry

_STL_HEADER = 84  # bytes
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_STL_VERTEX = re.compile(rf"\bvertex\s+({_NUMBER})\s+({_NUMBER})\s+({_NUMBER})", re.IGNORECASE)


def read_off(data: bytes) -> Geometry:
    """Return the vertices and faces of an OFF file.

    Raises ValueError if it holds fewer vertices, faces or corners than stated, or a face of fewer than three corners.
    """
    lines = [line.split("#", 1)[0] for line in decoded(data).splitlines()]
    lines = [line for line in lines if line and not line.isspace()]
    if not lines:
        raise ValueError("it holds nothing")
    kind, *first = lines[0].split()
    if kind.isdigit():  # the keyword may be left out
        kind, first = "OFF", [kind, *first]
    if not kind.upper().endswith("OFF"):
        raise ValueError(f"it begins with {shortened(kind)}, not with OFF")
    counts, rest = (first, lines[1:]) if first else (lines[1].split() if len(lines) > 1 else [], lines[2:])
    if len(counts) < 2 or not all(each.isdecimal() for each in counts[:2]):
        raise ValueError("it does not say how many vertices and faces it has")
    vertex_count, face_count = int(counts[0]), int(counts[1])
    if len(rest) < vertex_count + face_count:
        raise ValueError(
            f"it should have {vertex_count} vertices and {face_count} faces, but is cut off after {len(rest)} of them"
        )
    vertices = np.empty((vertex_count, 3))
    for number, line in enumerate(rest[:vertex_count]):
        words = line.split(None, 3)[:3]
        try:
            vertices[number] = words
        except ValueError:
            raise ValueError(f"vertex {number} has the coordinates {shortened(' '.join(words))}") from None
    sizes, corners = np.empty(face_count, np.int64), []
    for number, line in enumerate(rest[vertex_count : vertex_count + face_count]):
        words = line.split()
        size = int(words[0]) if words[0].isdecimal() else -1
        if size < 3:
            raise ValueError(f"face {number} has {shortened(words[0])} corners, and 3 are needed")
        if len(words) <= size:
            raise ValueError(f"face {number} should have {size} corners, but {len(words) - 1} are there")
        sizes[number] = size
        corners += words[1 : size + 1]
    try:
        numbers = np.array(list(map(int, corners)), np.int64)
    except (ValueError, OverflowError):
        wrong = next(word for word in corners if not re.fullmatch(r"[-+]?\d{1,18}", word))
        raise ValueError(f"a face names the vertex {shortened(wrong)}") from None
    check_corners(numbers, vertex_count)
    return Geometry(vertices, numbers[triangulate(vertices, numbers, sizes)])


def read_stl(data: bytes) -> list[tuple[str, Geometry]]:
    """Return the solids of an STL file by name, "" for one without.

    Raises ValueError if its length is not what it says, or it is cut off.
    """
    if len(data) >= _STL_HEADER:
        count = int.from_bytes(data[80:84], "little")
        length = _STL_HEADER + _STL_FACE.itemsize * count
        if len(data) == length:
            return [("", _soup(np.frombuffer(data, _STL_FACE, count, _STL_HEADER)["corners"].reshape(-1, 3)))]
        if b"facet" not in data.lower():
            raise ValueError(f"it should have {count} faces in {length} bytes, but {len(data)} are there")
    text = decoded(data)
    if text.lstrip()[:5].lower() != "solid":
        raise ValueError(f"it is cut off after {len(data)} bytes")
    lowered = text.lower()
    facets, ends = len(re.findall(r"\bfacet\b", lowered)), len(re.findall(r"\bendfacet\b", lowered))
    if facets != ends or "endsolid" not in lowered:
        raise ValueError(f"it is cut off: it begins {facets} faces, ends {ends} and may lack others")
    solids = []
    for solid in re.split(r"^[ \t]*endsolid[^\n]*", text, flags=re.IGNORECASE | re.MULTILINE):
        found = _STL_VERTEX.findall(solid)
        if len(found) != 3 * len(re.findall(r"\bendfacet\b", solid, re.IGNORECASE)):
            raise ValueError("it has faces that have not three vertices")
        if found:
            name = re.match(r"\s*solid[ \t]*([^\r\n]*)", solid, re.IGNORECASE)
            solids.append((name[1].strip() if name else "", _soup(np.array(found, np.float64))))
    return solids


def _soup(corners: NDArray[np.floating]) -> Geometry:
    """Return triangles (F · 3, 3) that share no vertex."""
    return Geometry(corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3))
