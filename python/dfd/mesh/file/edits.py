"""Text in files: its encoding, numbers, and replacement of bytes; and rounding to 32-bit floats."""

import re
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64, Int64

SAME = 1e-6  # largest change of a unit normal's components that counts as rounding
COARSE = 1e-5  # largest accepted rounding error of 32-bit floats, as a fraction of the bounding box's diagonal


class Edits:
    """Replacements of bytes in a file, collected and then applied together."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._spans: list[Int64] = []
        self._new: list[bytes] = []

    def replace(self, spans: Int64 | Sequence[tuple[int, int]], new: Iterable[bytes]) -> None:
        """Replace byte ranges by `new`. `spans` (L, 2) holds the first byte and the end (exclusive) of each range."""
        self._spans.append(np.asarray(spans, np.int64).reshape(-1, 2))
        self._new += new

    def result(self) -> bytes:
        """Return the bytes with all replacements."""
        spans = np.concatenate([np.zeros((0, 2), np.int64), *self._spans])
        order = np.lexsort(spans.T[::-1])
        pieces, done = [], 0
        for index, (start, end) in zip(order.tolist(), spans[order].tolist(), strict=True):
            pieces += [self._data[done:start], self._new[index]]
            done = end
        return b"".join([*pieces, self._data[done:]])


def readable_numbers(text: bytes) -> bytes:
    """Replace NaN and infinity as old C libraries print them, such as -1.#IND, by a NaN of equal length for NumPy."""

    def nan(found: re.Match[bytes]) -> bytes:
        length = len(found[0])
        return b"nan(%s)" % (b"0" * (length - 5)) if length > 4 else b"+nan"

    return re.sub(rb"(?<!\S)[-+]?1\.#\w+(?!\S)", nan, text) if b"1.#" in text else text


def numbers(text: bytes, dtype: Any, count: int) -> NDArray[Any] | None:
    """Return the `count` numbers of a text; None if the text does not consist of exactly `count` numbers."""
    if not count:
        return np.zeros(0, dtype)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # older versions of NumPy warn about text that is no number
        try:
            values = np.fromstring(text, dtype, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    return values if len(values) == count else None


def number(word: bytes) -> float:
    """Return the number that a word states; NaN if it states none."""
    found = numbers(readable_numbers(word), np.float64, 1)
    return float("nan") if found is None else float(found[0])


def encoding_of(data: bytes) -> str:
    """Return "utf-8" if this is the encoding of a text, else "latin-1", which gives each byte a letter."""
    try:
        data.decode()
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def decoded(data: bytes) -> str:
    """Decode text as UTF-8, or as Latin-1 if it is not valid UTF-8."""
    return data.decode(encoding_of(data))


def rows_as_text(values: NDArray[np.floating]) -> list[bytes]:
    """Return each row of `values` (L, K) as text. Each number has the shortest form that reads back exactly."""
    template = b" ".join([b"%a"] * values.shape[1])
    return [template % tuple(row) for row in values.tolist()]


def far_origin(vertices: Float64) -> Float64 | None:
    """Return the center (3,) of vertices (V, 3) if 32-bit floats are too coarse for them, else None.

    The center is rounded to 32-bit floats.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if rounding(vertices).max() <= COARSE * np.linalg.norm(high - low):
        return None
    return (low / 2 + high / 2).astype(np.float32).astype(np.float64)


def rounding(vertices: Float64) -> Float64:
    """Return the distances (V,) by which rounding to 32-bit floats moves vertices (V, 3)."""
    with np.errstate(over="ignore"):
        return np.linalg.norm(vertices - vertices.astype(np.float32), axis=1)
