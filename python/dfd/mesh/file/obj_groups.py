"""The face groups of an OBJ file: what its `g`, `o` and `usemtl` lines name, whether parts were made of them or not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.file.obj_read import state_at_faces
from dfd.mesh.file.obj_text import parse

__all__ = ["face_groups"]

_KEYWORDS = ("g", "o", "usemtl")  # where two kinds have one name, the first is meant


def face_groups(data: bytes) -> dict[str, NDArray[np.int64]]:
    """Return the vertices (N,) of each group in the text of an OBJ file, ascending, by the group's name.

    Every word of a `g` line names a group, and so does the line as a whole; `o` and `usemtl` lines have one name each.
    A group has all faces of its name, wherever they are, and goes on where a line of another kind comes between. Faces
    before the first line of a kind are in no group of that kind, and groups without faces are left out.
    """
    text = parse(data)
    kept = np.repeat(text.sizes >= 3, text.sizes)  # faces of fewer corners are none of the mesh
    vertices = text.corners[kept, 0]
    found: dict[str, NDArray[np.int64]] = {}
    for keyword in _KEYWORDS:
        names, state = state_at_faces(text, keyword, "")
        state = np.repeat(state, text.sizes)[kept]
        order = np.argsort(state, kind="stable")
        bounds = np.searchsorted(state[order], np.arange(len(names) + 1))
        lines: dict[str, list[int]] = {}
        for number, name in enumerate(names):
            for word in dict.fromkeys([name, *(name.split() if keyword == "g" else [])]):
                lines.setdefault(word, []).append(number)
        for name, numbers in lines.items():
            corners = np.concatenate([order[bounds[number] : bounds[number + 1]] for number in numbers])
            if name and len(corners):
                found.setdefault(name, np.unique(vertices[corners]))
    return found
