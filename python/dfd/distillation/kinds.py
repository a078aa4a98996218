"""Which kind of part a point looks like, such as a leg or a tail: a small network that labelled shapes have taught.

Differences of features between two points of one shape cannot know what was seen on many: that a hoofed leg and the
belly above it are two parts although they look alike, and an ear and its other side one although they do not. What a
kind of part looks like can be learned across shapes, from what a feature has beside the mean of its own shape.

Points are as far apart as the square roots of the probabilities of their kinds (Hellinger's distance): where the
network cannot tell, as on a thing of no such parts, all are near each other and the other features decide.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Kinds"]

ARRAYS = ("kinds_hidden", "kinds_hidden_bias", "kinds_output", "kinds_output_bias")


@dataclass(frozen=True, eq=False)
class Kinds:
    """A network of one hidden layer of n rectified units, from a feature of width D to K kinds of parts.

    Attributes
    ----------
    hidden, hidden_bias
        (D, n) and (n,), of the hidden units.
    output, output_bias
        (n, K) and (K,), of the logarithms of the odds.
    """

    hidden: NDArray[np.float32]
    hidden_bias: NDArray[np.float32]
    output: NDArray[np.float32]
    output_bias: NDArray[np.float32]

    def likely(self, features: NDArray[np.float32], mean: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return unit rows (N, K), the square roots of probabilities, for `features` (N, D) of a shape of that mean."""
        units = np.maximum((features - mean) @ self.hidden + self.hidden_bias, 0)
        odds = units @ self.output + self.output_bias
        probable = np.exp(odds - odds.max(axis=1, keepdims=True))
        result: NDArray[np.float32] = np.sqrt(probable / probable.sum(axis=1, keepdims=True))
        return result

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a file keeps, by name."""
        return dict(zip(ARRAYS, (self.hidden, self.hidden_bias, self.output, self.output_bias), strict=True))

    @classmethod
    def of(cls, arrays: Mapping[str, NDArray[Any]], width: int) -> Kinds:
        """Return what `arrays` has made, for features of a width.

        Raises
        ------
        ValueError
            If an array is not finite, or not of the shape that goes with the others.
        """
        units = len(arrays[ARRAYS[1]].ravel())
        kinds = len(arrays[ARRAYS[3]].ravel())
        for name, shape in zip(ARRAYS, ((width, units), (units,), (units, kinds), (kinds,)), strict=True):
            if arrays[name].shape != shape or 0 in shape or not np.isfinite(arrays[name]).all():
                raise ValueError(f"`{name}` must be finite, {shape}, got {arrays[name].shape}")
        return cls(*(arrays[name].astype(np.float32) for name in ARRAYS))
