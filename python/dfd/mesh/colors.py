"""Convert colors: to floats, and between linear and display-referred values."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64

_RANGES = (1.0, 255.0, 65535.0)  # the largest values of colors: floats, and integers of 8 and of 16 bits
# A color is in a range if its largest value is below this multiple of the range's end. An 8-bit picture without a value
# above 2 would be black.
_MARGIN = 2.0


def rgba(values: NDArray[Any]) -> Float32:
    """Return colors (N, 3 or 4) as RGBA (N, 4) in [0, 1]; integers are divided by the largest value of their type."""
    scale = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1
    result = np.ones((len(values), 4), np.float32)
    result[:, : values.shape[1]] = values[:, :4] / scale
    return np.where(np.isfinite(result), result, 1).clip(0, 1).astype(np.float32)


def srgb(linear: NDArray[np.floating]) -> Float32:
    """Return the display-referred values (IEC 61966-2-1) of `linear` values in [0, 1]."""
    values = np.clip(np.asarray(linear, np.float64), 0, 1)
    encoded = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
    return encoded.astype(np.float32)


def linear(encoded: NDArray[np.floating]) -> Float64:
    """Return the linear values of display-referred values in [0, 1]; the inverse of `srgb`."""
    values = np.clip(np.asarray(encoded, np.float64), 0, 1)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def ranged(values: NDArray[Any]) -> Float32:
    """Return colors (N, 3 or 4) as RGBA (N, 4) in [0, 1]. The largest value tells the range, except for 8-bit integers.

    A row that is not finite stays NaN: the color is missing. Values slightly above 1 are clipped.
    """
    if values.dtype.kind in "iu" and values.dtype.itemsize == 1:
        return rgba(values)
    result = np.ones((len(values), 4))
    with np.errstate(invalid="ignore", over="ignore"):
        for channels in (slice(0, 3), slice(3, values.shape[1])):
            given = values[:, channels].astype(np.float64)
            largest = float(np.max(given, where=np.isfinite(given), initial=0.0))
            result[:, channels] = given / next((each for each in _RANGES if largest <= _MARGIN * each), largest)
    known = np.isfinite(result).all(axis=1, keepdims=True)
    return np.where(known, result.clip(0, 1), np.nan).astype(np.float32)
