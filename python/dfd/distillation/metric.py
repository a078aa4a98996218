"""A metric that separates parts better than the raw features, learned once per encoder from labelled shapes.

An encoder's features also vary within a part: with position on the body, curvature and neighboring parts. Pictures do
not show some differences between parts, such as thickness (`dfd.distillation.thickness`). So a linear map takes
features and thickness to Fisher's discriminant directions. It weights each direction by the ratio of variance between
parts to variance within parts (`python -m bench.training.learn_metric`). Probabilities of kinds of parts are appended.
Rows have unit length and about the same mean distance as before, so a weight 1 − d keeps its meaning.

The map is applied before the fit. So the field's features have the distances of the metric, and they are narrower.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32
from dfd.distillation.targets import PAIRS, PointTargets, mean_distance, restore_contrast, unit
from dfd.distillation.thickness import BANDS
from dfd.encoders.learned_file import encoder_identity, read_learned, write_learned
from dfd.field.cache_key import hash_arrays

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder

KIND = "dfd metric 3"  # format version 3
SHAPES: dict[str, tuple[int | str, ...]] = {
    "directions": ("D", "d"),
    "thickness_directions": (BANDS, "d"),
    "kinds_hidden": ("D", "n"),  # optional, like all entries below
    "kinds_hidden_bias": ("n",),
    "kinds_output": ("n", "K"),
    "kinds_output_bias": ("K",),
}
FOLDER = Path(__file__).with_name("metrics")
# The metric contracts details with many vertices and little area. At equal mean distance over the surface, a handle
# would therefore move more vertices than without the metric. With this factor it moves fewer.
FARTHER = 1.06
# Weight of squared distances of kinds relative to those of mapped features. A higher one gives worse results on birds.
KINDS_SHARE = 0.2
_LEAST_STRETCH = 0.02  # below 1, because some mapped rows must be contracted


@dataclass(frozen=True, eq=False)
class Metric:
    """The learned map of an encoder's features of width D."""

    directions: Float32  # (D, d) the map of a row of features
    # thickness_directions: (BANDS, d) the map of a row of `dfd.distillation.thickness.thickness_bands`; the mapped
    # feature row and the mapped thickness row are added
    thickness_directions: Float32
    # encoder_weights, encoder_block: the encoder that gave the training features
    encoder_weights: str
    encoder_block: int
    kinds: Kinds | None = None  # classifier of kinds of parts, or None

    def mapped(
        self,
        features: NDArray[np.floating],
        thickness: Float32,
        generator: np.random.Generator,
        *,
        mean: Float32 | None = None,
    ) -> Float32:
        """Map features (N, D) and thickness bands (N, BANDS) to unit rows (N, d), or (N, d + K) with K kinds.

        The mean distance of the rows is `FARTHER` times that of `features`. `mean` (D,) is the mean feature of the
        shape; None takes the mean of `features`.
        """
        one, other = generator.integers(0, len(features), (2, PAIRS))
        rows = np.asarray(features, np.float32)
        distance = FARTHER * mean_distance(rows[one], rows[other])
        mapped = unit(rows @ self.directions + thickness @ self.thickness_directions)
        mapped = restore_contrast(mapped, distance, generator, least=_LEAST_STRETCH)
        if self.kinds is None:
            return mapped
        likely = self.kinds.likely(rows, rows.mean(axis=0) if mean is None else mean)
        both = unit(np.concatenate([mapped, np.float32(np.sqrt(KINDS_SHARE)) * likely], axis=1))
        return restore_contrast(both, distance, generator, least=_LEAST_STRETCH)

    def of_targets(self, targets: PointTargets, thickness: Float32, seed: int) -> PointTargets:
        """Return `targets` with `mapped` features; `seed` draws the pairs that estimate mean distances."""
        rows = self.mapped(targets.features, thickness, np.random.default_rng(seed))
        return PointTargets(targets.points, rows, None, targets.component, targets.boxes, targets.face)

    @property
    def content_hash(self) -> str:
        """Return the SHA-256 of the arrays: features of different metrics are not comparable."""
        return hash_arrays(*self._arrays().values())

    def _arrays(self) -> dict[str, NDArray[Any]]:
        kinds = self.kinds
        learned = [] if kinds is None else [kinds.hidden, kinds.hidden_bias, kinds.output, kinds.output_bias]
        return dict(zip(SHAPES, (self.directions, self.thickness_directions, *learned), strict=False))

    def fits(self, encoder: Encoder) -> bool:
        """Return whether the metric was learned from features of `encoder`."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file, whole or not at all; equal metrics give equal files."""
        write_learned(path, KIND, self._arrays(), (self.encoder_weights, self.encoder_block))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Metric:
        """Return the metric in a file that `save` wrote.

        Raises ValueError if the file is truncated or of another kind. Raises ValueError if its arrays have wrong shapes
        or are not finite. Raises OSError if the file cannot be read.
        """
        arrays, identity = read_learned("Metric.load", path, KIND, SHAPES, optional=list(SHAPES)[2:])
        directions, thickness, *learned = (values.astype(np.float32) for values in arrays.values())
        return cls(directions, thickness, *identity, Kinds(*learned) if learned else None)


def find_metric(encoder: Encoder) -> Metric | None:
    """Return the package's metric for the weights and block of `encoder`, else None.

    Raises ValueError if one of the package's files is damaged.
    """
    metrics = (Metric.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((metric for metric in metrics if metric.fits(encoder)), None)


@dataclass(frozen=True, eq=False)
class Kinds:
    """Classifies features of width D as K kinds of parts, with one hidden layer of n rectified units."""

    # hidden, hidden_bias: (D, n) weights and (n,) biases of the hidden units
    hidden: Float32
    hidden_bias: Float32
    # output, output_bias: (n, K) weights and (K,) biases of the logits
    output: Float32
    output_bias: Float32

    def likely(self, features: Float32, mean: Float32) -> Float32:
        """Return unit rows (N, K), square roots of probabilities, of `features` (N, D) with the shape's `mean` (D,)."""
        units = np.maximum((features - mean) @ self.hidden + self.hidden_bias, 0)
        logits = units @ self.output + self.output_bias
        probable = np.exp(logits - logits.max(axis=1, keepdims=True))
        return np.sqrt(probable / probable.sum(axis=1, keepdims=True))
