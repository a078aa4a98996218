"""Text in files of other programs: its encoding, numbers, unique names, and excerpts for error messages."""

import re
import warnings
from collections import defaultdict
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray


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


def shortened(value: object) -> str:
    """Return the `repr` of a value from a file for an error message, cut to about 60 characters."""
    text = repr(value)
    if isinstance(value, str) and value.startswith("data:"):
        return f"a data URI of {len(value)} characters"
    return text if len(text) <= 60 else f"{text[:50]}… ({len(text)} characters)"


class UniqueNames:
    """Makes names unique: a repeated name gets a number as its suffix, starting from `first`."""

    def __init__(self, first: int = 1) -> None:
        self._taken: set[str] = set()
        self._numbers: dict[str, count[int]] = defaultdict(lambda: count(first))

    def unique(self, name: str) -> str:
        """Return `name`, with a number appended if an earlier call has returned `name`."""
        found = name
        while found in self._taken:
            found = f"{name}_{next(self._numbers[name])}"
        self._taken.add(found)
        return found
