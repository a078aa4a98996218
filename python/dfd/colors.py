"""Colours that stand for numbers: weights as heat, features by their main directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd import check

__all__ = ["CLAY", "feature_colors", "weight_colors"]

CLAY = (0.82, 0.82, 0.80)
# From clay, so that what does not move still shows its shape, over yellow and orange to a dark red: lightness falls
# all the way, which eyes that do not tell red from green can read as well.
_HEAT = np.array(
    [CLAY, (0.98, 0.86, 0.52), (0.97, 0.66, 0.26), (0.90, 0.40, 0.17), (0.70, 0.15, 0.18), (0.40, 0.02, 0.20)]
)


def weight_colors(weights: ArrayLike) -> NDArray[np.float32]:
    """Heat colours of weights (V,): (V, 3) in [0, 1], clay at 0, dark red at 1 and above."""
    values = check.array("weight_colors", "weights", weights, ("V",), dtype=np.float64)
    stops = np.linspace(0, 1, len(_HEAT))
    return np.stack([np.interp(values, stops, channel) for channel in _HEAT.T], axis=1).astype(np.float32)


def feature_colors(features: ArrayLike) -> NDArray[np.float32]:
    """Red, green and blue for the three main directions of features (V, D): (V, 3) in [0, 1].

    Vertices with like features get like colours. Each direction runs from its 1st to its 99th percentile.
    """
    values = check.array("feature_colors", "features", features, ("V", "D"), dtype=np.float32)
    if len(values) == 0:
        return np.zeros((0, 3), np.float32)
    # A few thousand rows tell the directions as well as millions.
    sample = values[:: max(1, len(values) // 20_000)].astype(np.float64)
    mean = sample.mean(axis=0)
    _, _, directions = np.linalg.svd(sample - mean, full_matrices=False)
    main = directions[:3] * np.sign(directions[:3].sum(axis=1, keepdims=True) + 1e-12)
    places = np.zeros((len(values), 3), np.float32)
    places[:, : len(main)] = (values - mean.astype(np.float32)) @ main.T.astype(np.float32)
    low, high = np.percentile(places, [1, 99], axis=0)
    return np.clip((places - low) / np.maximum(high - low, 1e-6), 0, 1).astype(np.float32) * 0.85 + 0.1
