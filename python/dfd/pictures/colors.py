"""Convert weights, features and indices of parts to colors."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.common.linear_algebra import Float32, Float64
from dfd.mesh.colors import linear, srgb
from dfd.weights.compact import CompactFeatures

CLAY = (0.85, 0.84, 0.82)  # sRGB color of weight 0, and of surfaces without colors
# sRGB colors of the heat map from weight 0 to 1. Lightness decreases, so color-blind people can read the map.
HEAT_STOPS = (CLAY, (0.96, 0.78, 0.42), (0.93, 0.50, 0.18), (0.74, 0.20, 0.24), (0.38, 0.05, 0.31))
LARGEST_SAMPLE = 20_000  # largest number of features from which the principal directions are computed
PERCENTILES = (1.0, 99.0)  # percentiles of a principal component that get the lowest and the highest color value

# Color space Oklab (Ottosson 2020): _TO_CONE maps linear sRGB to cone responses, _TO_LAB their cube roots to Oklab.
_TO_CONE = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def weight_colors(weights: ArrayLike) -> Float32:
    """Return the sRGB colors (V, 3), in [0, 1], of `weights` (V,): clay at 0, then amber, red, and dark violet at 1.

    Equal differences of weight look equally large. Weights outside [0, 1] have the color of the nearest bound.

    Raises ValueError if `weights` is not a one-dimensional array of finite numbers.
    """
    values = check.array("weight_colors", "weights", weights, ("V",), dtype=np.float64)
    position = values.clip(0, 1) * (len(_HEAT) - 1)
    before = np.minimum(position.astype(np.int64), len(_HEAT) - 2)
    part = (position - before)[:, None]
    return (_HEAT[before] * (1 - part) + _HEAT[before + 1] * part).astype(np.float32)


def feature_colors(features: ArrayLike | CompactFeatures) -> Float32:
    """Return sRGB colors (V, 3), in [0, 1], that show the first three principal components of `features` (V, D).

    The components give red, green and blue. The 1st percentile of a component gets the lowest color value, and the 99th
    percentile gets the highest. In each principal direction, the entry of largest magnitude is positive.

    Raises ValueError if `features` is not a (V, D) array of finite numbers with at least one row and one column.
    """
    if isinstance(features, CompactFeatures):
        features = features.principal(3)
    rows = check.array("feature_colors", "features", features, ("V", "D"), dtype=np.float32)
    if rows.size == 0:
        raise ValueError(f"feature_colors: `features` must not be empty, got shape {rows.shape}")
    sample = rows[:: -(-len(rows) // LARGEST_SAMPLE)].astype(np.float64)
    mean = sample.mean(axis=0)
    _, axes = np.linalg.eigh((sample - mean).T @ (sample - mean))
    axes = axes[:, ::-1][:, :3]
    axes *= np.where(np.take_along_axis(axes, np.abs(axes).argmax(axis=0)[None], axis=0) < 0, -1, 1)
    low, high = np.percentile((sample - mean) @ axes, PERCENTILES, axis=0)
    spread = high - low
    varies = spread > 1e-6 * max(float(spread.max()), float(np.abs(sample).max()), 1e-30)
    scaled = ((rows - mean.astype(np.float32)) @ axes.astype(np.float32) - low) / np.where(varies, spread, 1)
    colors = np.full((len(rows), 3), 0.5, np.float32)
    colors[:, : axes.shape[1]] = np.where(varies, scaled.clip(0, 1), 0.5)
    # Values near 0 and 1 are avoided, because saturated colors hide the shading of the surface.
    return np.float32(0.06) + np.float32(0.88) * colors


def part_colors(labels: ArrayLike) -> Float32:
    """Return sRGB colors (V, 3), in [0, 1], of parts, each with its own hue. `labels` (V,) are indices of parts.

    Raises ValueError if `labels` is not a one-dimensional array of numbers of at least 0.
    """
    numbers = check.array("part_colors", "labels", labels, ("V",), dtype=np.int64)
    if (numbers < 0).any():
        raise ValueError(f"part_colors: `labels` must be at least 0, got {numbers.min()}")
    number = np.arange(numbers.max(initial=0) + 1)
    hue = 2 * np.pi * (number * 0.618034 % 1)
    lightness = np.array([0.72, 0.6, 0.82])[number % 3]
    table = _from_oklab(np.stack([lightness, 0.13 * np.cos(hue), 0.13 * np.sin(hue)], axis=1))
    return table[numbers].astype(np.float32)


def oklab(colors: NDArray[np.floating[Any]]) -> Float64:
    """Convert sRGB `colors` (N, 3) to Oklab: lightness and two hue axes. Equal distances look equally different."""
    return np.cbrt(linear(colors) @ _TO_CONE.T) @ _TO_LAB.T


def _from_oklab(lab: Float64) -> Float64:
    cone = lab @ np.linalg.inv(_TO_LAB).T
    return srgb((cone**3 @ np.linalg.inv(_TO_CONE).T).clip(0, 1)).astype(np.float64)


def _heat_table() -> Float64:
    """Return 256 sRGB colors (256, 3) along `HEAT_STOPS`, with steps that look equally large."""
    stops = oklab(np.array(HEAT_STOPS))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(stops, axis=0), axis=1))])
    position = np.linspace(0, length[-1], 256)
    return _from_oklab(np.stack([np.interp(position, length, axis) for axis in stops.T], axis=1))


_HEAT = _heat_table()
