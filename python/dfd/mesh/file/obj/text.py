"""Parse an OBJ file into arrays, and locate the coordinates and face corners in its text.

The format: Wavefront, "Advanced Visualizer Manual", appendix B1, 1992. Many programs also write colors after a vertex's
coordinates. NumPy parses all numbers of one keyword together, so that a file of a million faces takes seconds.
"""

import codecs
import re
from dataclasses import dataclass

import numpy as np

from dfd.common.linear_algebra import Float64, Int64
from dfd.mesh.file.text import decoded, encoding_of, numbers, readable_numbers, shortened

_CORNER = re.compile(rb"[-+]?\d+(/[-+]?\d*){0,2}")
_STATEMENTS = ("o", "g", "s", "usemtl", "mtllib")


@dataclass(frozen=True)
class Tokens:
    """The words after the keyword, in all lines with the same keyword."""

    lines: Int64  # (L,) line numbers
    counts: Int64  # (L,) number of words of each line
    starts: Int64  # (W,) first byte of each word in `text`
    ends: Int64  # (W,) first byte after each word in `text`
    text: bytes  # these lines, with spaces in place of keywords and comments
    shifts: Int64  # (L,) position of each line in the file minus its position in `text`


@dataclass(frozen=True)
class ObjText:
    """The content of an OBJ file. Indices and line numbers count from 0."""

    data: bytes  # the text of the file, with continued lines joined and as many bytes as the file
    line_break: bytes  # a line feed, or the carriage return of files without one
    positions: Float64  # (N, 3) from the `v` lines; divided by the fourth number of lines with four numbers
    scales: Float64 | None  # (N,) the fourth numbers, or 1; None if no `v` line has four numbers
    position_spans: Int64  # (N, 2) bytes of `data` at which the coordinates of each position begin and end
    colors: Float64 | None  # (N, 3) from the `v` lines; NaN in lines without a color, None if no line has one
    uv: Float64  # (T, 2) from the `vt` lines
    normals: Float64  # (M, 3) from the `vn` lines
    normal_spans: Int64  # (M, 2) bytes of `data` at which the coordinates of each normal begin and end
    corners: Int64  # (C, 3) indices of the position, UV and normal of each face corner; −1 for none
    corner_spans: Int64  # (C, 2) bytes of `data` at which each face corner begins and ends
    sizes: Int64  # (P,) number of corners of each face
    face_lines: Int64  # (P,) line number of each face
    statements: tuple[tuple[int, str, bytes], ...]  # (line number, keyword, rest) of `_STATEMENTS` lines
    encoding: str  # the encoding of all these lines together


def parse(data: bytes) -> ObjText:
    """Return the content of an OBJ file; raise ValueError if the line of a vertex or a face is malformed."""
    # Each replacement keeps the length, so that positions in the text are positions in the file.
    text = b"   " + data[3:] if data.startswith(codecs.BOM_UTF8) else data
    text = text.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ")
    line_break = b"\n" if b"\n" in text else b"\r"
    if line_break == b"\r":
        text = text.replace(b"\r", b"\n")
    lines = _Lines(readable_numbers(text))
    statements = lines.statements()
    vertices, uv_tokens, normal_tokens, faces = (lines.tokens(keyword) for keyword in (b"v", b"vt", b"vn", b"f"))
    values, first = _values(vertices, "v", at_least=3)
    normals, first_normal = _values(normal_tokens, "vn", at_least=3)
    uv, first_uv = _values(uv_tokens, "vt", at_least=1)
    counts = (vertices.lines, uv_tokens.lines, normal_tokens.lines)
    second_uv = first_uv + np.minimum(uv_tokens.counts, 2) - 1  # a single number is both u and v
    scales = _scales(values, first, vertices.counts)
    positions = values[first[:, None] + np.arange(3)]
    if scales is not None:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            positions /= scales[:, None]
    return ObjText(
        data=text,
        line_break=line_break,
        positions=positions,
        scales=scales,
        position_spans=_spans(vertices, first),
        colors=_colors(values, first, vertices.counts),
        uv=uv[np.stack([first_uv, second_uv], axis=1)],
        normals=normals[first_normal[:, None] + np.arange(3)],
        normal_spans=_spans(normal_tokens, first_normal),
        corners=_corners(faces, counts),
        corner_spans=np.stack([faces.starts, faces.ends], axis=1) + np.repeat(faces.shifts, faces.counts)[:, None],
        sizes=faces.counts,
        face_lines=faces.lines,
        statements=statements,
        encoding=encoding_of(b"\n".join(rest for _, _, rest in statements)),
    )


class _Lines:
    """The lines of a text, and the first three bytes of each line after its indentation."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        padded = np.frombuffer(data + b"\n\n\n\n", np.uint8)
        self._bytes = padded[: len(data) + 1]
        self._ends = np.flatnonzero(self._bytes == ord("\n"))
        starts = np.append(0, self._ends[:-1] + 1)
        self._lengths = self._ends + 1 - starts
        blank = (self._bytes == ord(" ")) | (self._bytes == ord("\t"))
        stops = np.flatnonzero(blank[:-1] & ~blank[1:]) + 1  # the bytes after runs of blanks
        # position of the first byte in each line that is neither a space nor a tab
        self._begins = np.where(blank[starts], np.append(stops, 0)[np.searchsorted(stops, starts, "right")], starts)
        self._keywords = tuple(padded[self._begins + i] for i in range(3))

    def tokens(self, keyword: bytes) -> Tokens:
        """Return the words of all lines that begin with `keyword`."""
        chosen = (self._keywords[len(keyword)] == ord(" ")) | (self._keywords[len(keyword)] == ord("\t"))
        for i, letter in enumerate(keyword):
            chosen &= self._keywords[i] == letter
        lines = np.flatnonzero(chosen)
        kept = self._bytes[np.repeat(chosen, self._lengths)]
        stops = np.cumsum(self._lengths[lines])
        shifts = self._ends[lines] + 1 - stops
        for i in range(len(keyword)):
            kept[self._begins[lines] - shifts + i] = ord(" ")
        text = re.sub(rb"#[^\n]*", lambda found: b" " * len(found[0]), kept.tobytes())
        words = np.frombuffer(text, np.uint8) > ord(" ")  # control characters also separate words
        edges = np.flatnonzero(words[1:] != words[:-1]) + 1  # both ends are separators, so starts and ends alternate
        first, end = edges[::2], edges[1::2]
        counts = np.diff(np.searchsorted(first, stops), prepend=0)
        return Tokens(lines, counts, first, end, text, shifts)

    def statements(self) -> tuple[tuple[int, str, bytes], ...]:
        """Return line number, keyword and further words of each line that names a part, a material or an MTL file."""
        found = []
        for line in np.flatnonzero(np.isin(self._keywords[0], list(b"ogsum"))):
            words = self._data[self._begins[line] : self._ends[line]].split(None, 1)
            keyword = words[0].decode("latin-1")
            if keyword in _STATEMENTS:
                found.append((int(line), keyword, b" ".join(words[1].split()) if len(words) > 1 else b""))
        return tuple(found)


def _values(tokens: Tokens, keyword: str, at_least: int) -> tuple[Float64, Int64]:
    """Return the numbers of all lines with the same keyword, and the index (L,) of the first number of each line."""
    short = np.flatnonzero(tokens.counts < at_least)
    first = np.cumsum(tokens.counts) - tokens.counts
    if len(short):
        line, count = tokens.lines[short[0]] + 1, tokens.counts[short[0]]
        raise ValueError(f"line {line}: {keyword!r} has {count} numbers, and {at_least} are needed")
    values = numbers(tokens.text, np.float64, len(tokens.starts))
    if values is None:
        words = (tokens.text[start:end] for start, end in zip(tokens.starts, tokens.ends, strict=True))
        wrong = next((word for word in words if numbers(word, np.float64, 1) is None), b"")
        raise ValueError(f"{shortened(decoded(wrong))} in a {keyword!r} line is not a number")
    return values, first


def _spans(tokens: Tokens, first: Int64) -> Int64:
    """Return the bytes (L, 2) of the file at which the first three words of each line begin and end."""
    return np.stack([tokens.starts[first], tokens.ends[first + 2]], axis=1) + tokens.shifts[:, None]


def _scales(values: Float64, first: Int64, counts: Int64) -> Float64 | None:
    """Return the fourth number w (N,) of the lines of four numbers, and 1 for all other lines; None if all are 1."""
    scales = np.ones(len(first))
    scales[counts == 4] = values[first[counts == 4] + 3]
    return None if (scales == 1).all() else scales


def _colors(values: Float64, first: Int64, counts: Int64) -> Float64 | None:
    """Return the colors (N, 3) that follow the coordinates, NaN in lines without a color; None if no line has one."""
    colored = counts >= 6
    if not colored.any():
        return None
    colors = np.full((len(first), 3), np.nan)
    colors[colored] = values[first[colored, None] + np.arange(3, 6)]
    return colors


def _corners(faces: Tokens, counted: tuple[Int64, Int64, Int64]) -> Int64:
    """Return the indices (C, 3) of the position, UV and normal of each face corner, from 0; −1 for none.

    A negative index counts back from the face's line. So `counted` holds the lines of positions, UVs and normals.
    """
    places = np.flatnonzero(np.frombuffer(faces.text, np.uint8) == ord("/"))
    slashes = np.searchsorted(places, faces.ends) - np.searchsorted(places, faces.starts)
    if (slashes > 2).any():
        raise _bad_face(faces, int(np.argmax(slashes > 2)), "has more than two slashes")
    plain = faces.text.replace(b"//", b"/0/")
    if (np.frombuffer(faces.text, np.uint8)[faces.ends - 1] == ord("/")).any():  # corners such as `1/` and `1/2/`
        plain = re.sub(rb"/(?!\S)", b"/0", plain)
    indices = numbers(plain.replace(b"/", b" "), np.int64, int((slashes + 1).sum()))
    if indices is None:
        spans = zip(faces.starts.tolist(), faces.ends.tolist(), strict=True)
        wrong = (i for i, (start, end) in enumerate(spans) if not _CORNER.fullmatch(faces.text, start, end))
        raise _bad_face(faces, next(wrong, 0), "must consist of whole numbers")
    first = np.cumsum(slashes + 1) - (slashes + 1)
    corners = np.full((len(first), 3), -1, np.int64)
    line = np.repeat(faces.lines, faces.counts)
    for column, lines in enumerate(counted):
        given = np.flatnonzero(slashes >= column)
        found = indices[first[given] + column]
        relative = found < 0
        found[relative] += np.searchsorted(lines, line[given[relative]]) + 1
        outside = (found < 1) | (found > len(lines))
        if column:
            found[outside] = 0  # this becomes −1 below: the corner has no UV or normal
        elif outside.any():
            where = int(np.argmax(outside))
            zero = indices[first[given[where]]] == 0
            what = "names vertex 0, but the first is 1" if zero else f"names none of the {len(lines)} vertices"
            raise _bad_face(faces, int(given[where]), what)
        corners[given, column] = found - 1
    return corners


def _bad_face(faces: Tokens, word: int, what: str) -> ValueError:
    line = int(np.searchsorted(np.cumsum(faces.counts), word, side="right"))
    found = decoded(faces.text[faces.starts[word] : faces.ends[word]])
    return ValueError(f"line {faces.lines[line] + 1}: the corner {shortened(found)} of a face {what}")
