"""Moving the vertices of an OBJ file and leaving everything else in it alone.

Only the coordinates of `v` and `vn` lines change, and of faces the number of a normal that they no longer share:
order, polygons, groups, smoothing, curves, comments and materials stay as they were written.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.obj.read import ObjSource, libraries, picture_name
from dfd.mesh.file.obj.text import ObjText, decoded, parse
from dfd.mesh.weld import weld

__all__ = ["encode"]


def encode(
    target: Path,
    source: ObjSource,
    vertices: NDArray[np.float64],
    normals: Sequence[NDArray[np.float64] | None],
) -> dict[str, bytes]:
    """Return the files of the moved mesh: the OBJ file `target`, and beside it what materials it needs there.

    Parameters
    ----------
    target
        Where the file goes. In the folder of the original the materials are there already.
    source
        The original.
    vertices
        (N, 3) where its vertices are now; those that are where they were keep their text.
    normals
        For each primitive its normals (rows, 3), None where it has none.
    """
    text = parse(source.data)
    changed = (vertices != text.positions).any(axis=1)
    edits = _Edits(text.data)
    edits.replace(text.position_spans[changed], _triples(vertices[changed]))
    _edit_normals(edits, text, source, normals)
    files: dict[str, bytes] = {}
    if target.parent.resolve() != source.folder.resolve():
        names = _copied_libraries(target, text, source.folder, files)
        for line, keyword, rest in text.statements:
            if keyword == "mtllib" and rest in names and names[rest] != rest:
                edits.replace_line(line, f"mtllib {names[rest]}")
    return {target.name: edits.result(), **files}


class _Edits:
    """Replacements in a text, made all at once."""

    def __init__(self, data: bytes) -> None:
        self._text = data.decode("latin-1")  # a letter for each byte, whatever they mean
        self._spans: list[NDArray[np.int64]] = []
        self._new: list[str] = []

    def replace(self, spans: NDArray[np.int64], texts: Sequence[str]) -> None:
        """Put `texts` where `spans` (L, 2) begin and end."""
        self._spans.append(spans)
        self._new += texts

    def replace_line(self, line: int, text: str) -> None:
        """Put `text` in place of a line."""
        start = 0
        for _ in range(line):
            start = self._text.index("\n", start) + 1
        end = start + len(self._text[start:].partition("\n")[0].rstrip("\r"))
        self.replace(np.array([[start, end]]), [text.encode().decode("latin-1")])

    def result(self) -> bytes:
        """Return the text with everything replaced."""
        if not self._new:
            return self._text.encode("latin-1")
        spans = np.concatenate(self._spans)
        order = np.lexsort(spans.T[::-1])
        pieces: list[str] = []
        done = 0
        for index, (start, end) in zip(order.tolist(), spans[order].tolist(), strict=True):
            pieces.append(self._text[done:start])
            pieces.append(self._new[index])
            done = end
        pieces.append(self._text[done:])
        return "".join(pieces).encode("latin-1")


def _triples(values: NDArray[np.float64]) -> list[str]:
    """Return three numbers (L, 3) as text, as short as they can be read back exactly."""
    return [f"{x!r} {y!r} {z!r}" for x, y, z in values.tolist()]


def _edit_normals(
    edits: _Edits, text: ObjText, source: ObjSource, normals: Sequence[NDArray[np.float64] | None]
) -> None:
    """Move the normals that faces name; corners that shared one and no longer do get one of their own."""
    known = [each is not None for each in normals]
    if not any(known):
        return
    by_row = np.concatenate(
        [
            np.full((count, 3), np.nan) if each is None else each
            for each, count in zip(normals, source.row_counts, strict=True)
        ]
    )
    corners = np.flatnonzero((text.corners[:, 2] >= 0) & (source.corner_rows >= 0))
    corners = corners[np.repeat(known, source.row_counts)[source.corner_rows[corners]]]
    number = text.corners[corners, 2]
    distinct, value = weld(by_row[source.corner_rows[corners]])
    pairs, first, pair = np.unique(number * (len(distinct) + 1) + value, return_index=True, return_inverse=True)
    # of all directions that a normal's corners have now it takes the first, and the others become new normals
    keeps = np.diff(number[first], prepend=-1) > 0
    directions = by_row[source.corner_rows[corners]][first]
    moved = keeps & (directions != text.normals[number[first]]).any(axis=1)
    edits.replace(text.normal_spans[number[first][moved]], _triples(directions[moved]))
    if keeps.all():
        return
    new = np.cumsum(~keeps) - 1
    begin = text.data.rfind(b"\n", 0, int(text.corner_spans[0, 0])) + 1
    edits.replace(np.array([[begin, begin]]), ["".join(f"vn {each}\n" for each in _triples(directions[~keeps]))])
    # normals that come later in the file are counted on; a reader need not look ahead for any
    before = int(np.searchsorted(text.normal_spans[:, 0], begin))
    numbers = text.corners[:, 2].copy()
    numbers[numbers >= before] += len(pairs) - int(keeps.sum())
    numbers[corners[~keeps[pair]]] = before + new[pair[~keeps[pair]]]
    relative = b"-" in text.data[begin:]
    rewritten = np.flatnonzero((text.corners[:, 2] >= 0) & (relative | (numbers != text.corners[:, 2])))
    spans = text.corner_spans[rewritten]
    spans[:, 0] = [text.data.rfind(b"/", start, end) + 1 for start, end in spans.tolist()]
    edits.replace(spans, list(map(str, (numbers[rewritten] + 1).tolist())))


def _copied_libraries(target: Path, text: ObjText, folder: Path, files: dict[str, bytes]) -> dict[str, str]:
    """Add the materials that the file names, with their pictures, to `files`; return the new name of each library.

    They keep their names where nothing else stands there, and are named after `target` where something does.
    """
    assets = AssetFolder(folder / "materials")
    pictures = ImageCache()

    def added(name: str, data: bytes) -> str:
        place = target.with_name(Path(name.replace("\\", "/")).name)
        if place.name == target.name or (place.exists() and not (place.is_file() and place.read_bytes() == data)):
            place = target.with_name(f"{target.stem}_{place.name}")
        files[place.name] = data
        return place.name

    names = {}
    for library in libraries(text, assets):
        try:
            content = decoded(assets.read(library))
        except (ValueError, OSError):  # it goes on being named
            continue
        lines = []
        for line in content.splitlines(keepends=True):
            name = picture_name(line)
            try:
                if name:
                    data = assets.read(name)
                    pictures.open(data)
                    line = line.replace(name, added(name, data))
            except (ValueError, OSError):
                pass
            lines.append(line)
        names[library] = added(library, "".join(lines).encode())
    return names
