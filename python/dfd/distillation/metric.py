"""Change an encoder's features by a learned map, the metric, so that feature distances separate parts better.

An encoder's features also vary within a part: with position on the body, curvature and neighboring parts. Pictures do
not show thickness, which also distinguishes parts (`dfd.distillation.thickness`). So a linear map projects features and
thickness to Fisher's discriminant directions, learned from labelled shapes (`python -m bench.training.learn_metric`).
The weight of a direction is a power of the ratio (variance between parts) / (variance within parts). A classifier
appends square roots of the probabilities of kinds of parts, such as leg or head. Mapped features have unit length and
about the same mean distance as the encoder's features, so 1 − distance is still a useful weight.

The map is applied before the fit, so the field's features are mapped features.
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
# Mean distance of mapped features, divided by the mean distance of the encoder's features. The metric reduces distances
# within small details with many vertices, so more vertices would follow a handle. The factor compensates for this.
FARTHER = 1.06
KINDS_SHARE = 0.2  # weight of the classifier in squared feature distances; the weight of the linear map is 1
_LEAST_STRETCH = 0.02  # smallest factor by which mapped rows are scaled about their mean


@dataclass(frozen=True, eq=False)
class Metric:
    """A learned map to d numbers: the sum of a linear map of the feature and a linear map of the thickness bands."""

    directions: Float32  # (D, d) the map of features
    thickness_directions: Float32  # (BANDS, d) the map of `dfd.distillation.thickness.thickness_bands`
    encoder_weights: str  # fingerprint of the encoder's weights in the training
    encoder_block: int  # index, from 1, of the encoder's block in the training
    kinds: Kinds | None = None  # classifier of kinds of parts

    def mapped(
        self,
        features: NDArray[np.floating],
        thickness: Float32,
        generator: np.random.Generator,
        *,
        mean: Float32 | None = None,
    ) -> Float32:
        """Map `features` (N, D) to rows of unit length: (N, d), or (N, d + K) with a classifier of K kinds of parts.

        `thickness` (N, BANDS) holds the thickness bands at the points of `features`. The mean distance of returned rows
        is `FARTHER` times that of `features`. `mean` (D,) is the mean feature of the shape; None averages `features`.
        """
        one, other = generator.integers(0, len(features), (2, PAIRS))
        rows = np.asarray(features, np.float32)
        distance = FARTHER * mean_distance(rows[one], rows[other])
        mapped = unit(rows @ self.directions + thickness @ self.thickness_directions)
        mapped = restore_contrast(mapped, distance, generator, least=_LEAST_STRETCH)
        if self.kinds is None:
            return mapped
        probable = self.kinds.root_probabilities(rows, rows.mean(axis=0) if mean is None else mean)
        both = unit(np.concatenate([mapped, np.float32(np.sqrt(KINDS_SHARE)) * probable], axis=1))
        return restore_contrast(both, distance, generator, least=_LEAST_STRETCH)

    def of_targets(self, targets: PointTargets, thickness: Float32, seed: int) -> PointTargets:
        """Return `targets` with mapped features. `seed` draws the pairs of features that estimate mean distances."""
        rows = self.mapped(targets.features, thickness, np.random.default_rng(seed))
        return PointTargets(targets.points, rows, None, targets.component, targets.boxes, targets.face)

    @property
    def content_hash(self) -> str:
        """Return the SHA-256 of the arrays; features of metrics with different hashes are not comparable."""
        return hash_arrays(*self._arrays().values())

    def _arrays(self) -> dict[str, NDArray[Any]]:
        kinds = self.kinds
        learned = [] if kinds is None else [kinds.hidden, kinds.hidden_bias, kinds.output, kinds.output_bias]
        return dict(zip(SHAPES, (self.directions, self.thickness_directions, *learned), strict=False))

    def fits(self, encoder: Encoder) -> bool:
        """Return whether the metric was learned from features of `encoder`."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file atomically; equal metrics give equal bytes."""
        write_learned(path, KIND, self._arrays(), (self.encoder_weights, self.encoder_block))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Metric:
        """Return the metric in a file that `save` wrote.

        Raises ValueError if the file is truncated or has another format, or if an array has a wrong shape or a number
        that is not finite. Raises OSError if the file cannot be read.
        """
        arrays, identity = read_learned("Metric.load", path, KIND, SHAPES, optional=list(SHAPES)[2:])
        directions, thickness, *learned = (values.astype(np.float32) for values in arrays.values())
        return cls(directions, thickness, *identity, Kinds(*learned) if learned else None)


def find_metric(encoder: Encoder) -> Metric | None:
    """Return the package's metric for the weights and block of `encoder`, or None; ValueError if a file is damaged."""
    metrics = (Metric.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((metric for metric in metrics if metric.fits(encoder)), None)


@dataclass(frozen=True, eq=False)
class Kinds:
    """A classifier of features (dimension D) into K kinds of parts, with one hidden layer of n ReLU units."""

    hidden: Float32  # (D, n) weights of the hidden units
    hidden_bias: Float32  # (n,)
    output: Float32  # (n, K) weights of the logits
    output_bias: Float32  # (K,)

    def root_probabilities(self, features: Float32, mean: Float32) -> Float32:
        """Return the square roots of the probabilities of the kinds, (N, K) rows of unit length.

        `features` (N, D) are classified by their difference from the shape's mean feature `mean` (D,).
        """
        units = np.maximum((features - mean) @ self.hidden + self.hidden_bias, 0)
        logits = units @ self.output + self.output_bias
        probable = np.exp(logits - logits.max(axis=1, keepdims=True))
        return np.sqrt(probable / probable.sum(axis=1, keepdims=True))
