"""Convert colors: to floats, and between linear and display-referred values."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64


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
