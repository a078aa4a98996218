"""The slow twins of networks: the field, and the kinds of parts of the metric."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from dfd.field.field import Field

__all__ = ["field", "kinds_of_parts"]

Array = NDArray[np.float64]


def field(network: Field, points: ArrayLike) -> Array:
    """(N, D) unit features of points (N, 3) in mesh units: the multilayer perceptron of the paper's supplement L."""
    # Rounded as the network's own input is: the shortest waves turn what is lost there into something to be seen.
    x = ((np.asarray(points, np.float64) - network.center) * network.scale).astype(np.float32).astype(np.float64)
    angles = [np.pi / 2 * 2**octave * x for octave in range(network.architecture.octaves)]
    x = np.concatenate([x, *[wave for angle in angles for wave in (np.sin(angle), np.cos(angle))]], axis=1)
    names = network.architecture.layer_names()
    of = {name: np.asarray(values, np.float64) for name, values in network.parameters.items()}
    for linear, norm in zip(names.linear, names.norms, strict=False):
        x = np.maximum(x @ of[f"{linear}.weight"].T + of[f"{linear}.bias"], 0.0)
        x = (x - x.mean(axis=1, keepdims=True)) / np.sqrt(x.var(axis=1, keepdims=True) + 1e-5)
        x = x * of[f"{norm}.weight"] + of[f"{norm}.bias"]
    x = x @ of[f"{names.linear[-1]}.weight"].T + of[f"{names.linear[-1]}.bias"]
    features: Array = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    return features


def kinds_of_parts(
    features: ArrayLike, mean: Array, hidden: Array, hidden_bias: Array, output: Array, output_bias: Array
) -> Array:
    """(N, K) square roots of the probabilities of kinds, of features (N, D): one rectified layer and a softmax."""
    result = np.empty((len(np.asarray(features)), len(output_bias)))
    for row, feature in enumerate(np.asarray(features, np.float64)):
        units = np.maximum(hidden.T @ (feature - mean) + hidden_bias, 0.0)
        odds = np.exp(output.T @ units + output_bias)
        result[row] = np.sqrt(odds / odds.sum())
    return result
