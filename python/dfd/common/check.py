"""Check arguments of public functions. Errors name the `function`, the argument `name` and the value found."""

import os
import sys
import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from dfd.common import tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Int64

__all__ = [
    "LARGEST",
    "MOST_OCTAVES",
    "array",
    "bounded",
    "choice",
    "ending",
    "field",
    "keywords",
    "number",
    "recorded_warnings",
    "vertex_indices",
    "warn",
    "whole",
]

LARGEST = 1e38  # largest absolute value of a number in an edit, because the kernels compute with 32-bit floats
MOST_OCTAVES = 16  # largest number of octaves of a field, because float32 rounds the angles of higher octaves too much


def array(
    function: str | None,
    name: str,
    value: Any,
    shape: Sequence[int | str],
    *,
    dtype: Any = np.float32,
    finite: bool = True,
) -> NDArray[Any]:
    """Return `value` as a C-contiguous array of `dtype`, copied only if necessary.

    `shape` lists the required size of each axis; a name such as ``"V"`` permits any size.

    Raises ValueError if `value` is not numeric, is a masked array, is a tensor that NumPy cannot read, or has a wrong
    shape. If `finite` is True, NaN, infinity and numbers too large for `dtype` also raise ValueError.
    """
    if type(value) is np.ndarray:
        result = value
    else:
        value = tensors.shared(function, name, value)
        try:
            result = np.asarray(value)
        except (TypeError, ValueError):
            raise ArgumentError(name, f"must be a numeric array, got {_kind(value)}", function) from None
    if result.dtype.kind not in "fiub":
        raise ArgumentError(name, f"must be a numeric array, got {_kind(value)}", function)
    wanted = tuple(want if isinstance(want, int) else have for have, want in zip(result.shape, shape, strict=False))
    if result.ndim != len(shape) or result.shape != wanted:
        names = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise ArgumentError(name, f"must have shape ({names}), got {result.shape}", function)
    if finite and result.dtype.kind == "f" and not np.isfinite(result).all():
        where = np.argwhere(~np.isfinite(result))[0].tolist()
        found = f"{result[tuple(where)]} at {where}" if where else f"{result}"
        raise ArgumentError(name, f"must be finite, got {found}", function)
    if result.dtype == dtype:
        return np.ascontiguousarray(result)
    with np.errstate(over="ignore"):
        coerced = np.ascontiguousarray(result, dtype=dtype)
    if finite and coerced.dtype.kind == "f" and not np.isfinite(coerced).all():
        raise ArgumentError(name, f"has values too large for {np.dtype(dtype).name}", function)
    return coerced


def number(
    function: str | None,
    name: str,
    value: Any,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    exclusive: bool = False,
) -> float:
    """Return `value` as a finite float in [`minimum`, `maximum`]; `exclusive` excludes `minimum` itself."""
    given = tensors.shared(function, name, value)
    try:
        result = float(given)
    except OverflowError:
        raise ArgumentError(name, "must be finite, got a whole number too large for a float", function) from None
    except (TypeError, ValueError):
        raise ArgumentError(name, f"must be a number, got {_kind(value)}", function) from None
    if not np.isfinite(result):
        raise ArgumentError(name, f"must be finite, got {result}", function)
    if minimum is not None and (result <= minimum if exclusive else result < minimum):
        bound = "above" if exclusive else "at least"
        raise ArgumentError(name, f"must be {bound} {minimum:g}, got {result:g}", function)
    if maximum is not None and result > maximum:
        raise ArgumentError(name, f"must be at most {maximum:g}, got {result:g}", function)
    return result


def bounded(function: str | None, name: str, numbers: Sequence[float]) -> None:
    """Raise ValueError if the absolute value of one of `numbers` exceeds `LARGEST`."""
    if max(map(abs, numbers)) > LARGEST:
        found = ",".join(f"{each:g}" for each in numbers)
        raise ArgumentError(name, f"must be numbers of at most {LARGEST:g}, got {found}", function)


def whole(
    function: str | None, name: str, value: Any, *, minimum: int | None = None, maximum: int | None = None
) -> int:
    """Return `value` as an int in [`minimum`, `maximum`]; booleans and floats, even 2.0, are errors."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise ArgumentError(name, f"must be a whole number, got {value!r}", function)
    if (minimum is not None and value < minimum) or (maximum is not None and value > maximum):
        bounds = f"of at least {minimum}" if maximum is None else f"from {minimum} to {maximum}"
        raise ArgumentError(name, f"must be a whole number {bounds}, got {value}", function)
    return int(value)


def choice(function: str | None, name: str, value: Any, options: Any) -> Any:
    """Return `value`, which must be one of the strings in `options`, a tuple or a Literal type."""
    words = options if isinstance(options, tuple) else get_args(options)
    if not isinstance(value, str) or value not in words:
        raise ArgumentError(name, f"must be one of {', '.join(words)}, got {value!r}", function)
    return value


def keywords(given: Iterable[str], known: Collection[str], kind: str) -> None:
    """Raise TypeError if a keyword in `given` is not in `known`; the message calls it "not a `kind`"."""
    for name in given:
        if name not in known:
            close = get_close_matches(name, known, 1)
            meant = f"; did you mean {close[0]}?" if close else ""
            raise TypeError(f"{name!r} is not a {kind}; choose from {', '.join(known)}{meant}")


def ending(function: str | None, name: str, path: str | os.PathLike[str], endings: Sequence[str]) -> str:
    """Return the first of `endings` with which the file name in `path` ends; raise ValueError if there is none."""
    if not isinstance(path, str | os.PathLike):
        what = "save to a file, and read its bytes" if hasattr(path, "write") else "pass a text or a pathlib.Path"
        raise ArgumentError(name, f"must be a path, got {type(path).__name__}: {what}", function)
    for each in endings:
        if Path(path).name.lower().endswith(each):
            return each
    raise ArgumentError(name, f"must end in {', '.join(endings)}, got {Path(path)}", function)


def field(function: str, value: Any) -> Any:
    """Return `value`, which must be a `Field` or another callable that maps points to features."""
    if not callable(value):
        raise ArgumentError("field", f"must be a Field, got {type(value).__name__}", function)
    return value


def vertex_indices(
    function: str | None, name: str, value: Any, vertex_count: int, *, unique: bool = False, wrap: bool = True
) -> Int64:
    """Return `value` as int64 vertex indices, each in [0, `vertex_count`).

    With `wrap`, `value` may have negative indices, which count from the end, or be a mask (`vertex_count`,) of bool.

    Raises ValueError for a wrong array shape or type, an index out of range or, with `unique`, a repeated index.
    """
    indices = np.asarray(tensors.shared(function, name, value))
    if indices.size == 0 and indices.ndim == 1:
        return np.zeros(0, np.int64)
    if wrap and indices.shape == (vertex_count,) and indices.dtype.kind == "b":
        return np.flatnonzero(indices)
    if indices.ndim != 1 or indices.dtype.kind not in "iu":
        found = f"{_kind(value)} of shape {indices.shape}"
        raise ArgumentError(name, f"must be a list of vertex indices, got {found}", function)
    if wrap and indices.dtype.kind == "i":
        indices = np.where((indices < 0) & (indices >= -vertex_count), indices + vertex_count, indices)
    outside = (indices < 0) | (indices >= vertex_count)
    if outside.any():
        raise ArgumentError(name, f"must lie in 0 … {vertex_count - 1}, got {int(indices[outside][0])}", function)
    if unique and len(indices) > 1:
        ordered = np.sort(indices)
        again = ordered[1:][ordered[1:] == ordered[:-1]]
        if len(again):
            raise ArgumentError(name, f"names vertex {int(again[0])} more than once", function)
    return np.ascontiguousarray(indices, dtype=np.int64)


def _kind(value: Any) -> str:
    """Return a description of `value` for messages: a string is quoted; other values have their class and dtype."""
    if isinstance(value, str):
        return repr(value)
    dtype = getattr(value, "dtype", None)
    return f"{type(value).__name__} of {dtype}" if dtype is not None else type(value).__name__


_INTERNAL = ("dfd", "contextlib", "concurrent", "threading")  # packages whose stack frames `warn` skips


def warn(message: str, category: type[Warning]) -> None:
    """Issue a warning that points at the line of the user's code that called `dfd`."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _INTERNAL:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


@contextmanager
def recorded_warnings() -> Iterator[list[UserWarning]]:
    """Yield an empty list. When the `with` block ends, add all UserWarnings of the block to the list."""
    messages: list[UserWarning] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield messages
    messages += [each.message for each in caught if isinstance(each.message, UserWarning)]
