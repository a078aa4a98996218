"""A metric, learned once per encoder from labelled shapes, that separates parts better than the raw features.

An encoder's features also vary within a part: with position on the body, curvature and neighboring parts. And pictures
do not show some differences between parts, such as thickness (`dfd.distillation.thickness`). So features and thickness
go through a linear map to Fisher's discriminant directions, weighted by the ratio of variance between parts to variance
within parts (`python -m bench.training.learn_metric`). Probabilities of kinds of parts are appended. Rows have unit
length and about the same mean distance as before, so that a weight 1 − d keeps its meaning.

The map is applied before the fit, so that the field's features have these distances and are narrower.
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
    "kinds_hidden": ("D", "n"),  # this and the following are optional
    "kinds_hidden_bias": ("n",),
    "kinds_output": ("n", "K"),
    "kinds_output_bias": ("K",),
}
FOLDER = Path(__file__).with_name("metrics")
# The metric contracts details of many vertices and little area: at equal mean distance over the surface a handle would
# move more vertices than without the metric, with this factor fewer.
FARTHER = 1.06
# Weight of squared distances of kinds relative to those of mapped features. A higher one is worse on birds.
KINDS_SHARE = 0.2
_LEAST_STRETCH = 0.02  # below 1: mapped rows may have to be contracted


@dataclass(frozen=True, eq=False)
class Metric:
    """The learned map of an encoder's features of width D."""

    directions: Float32  # (D, d) the map of a row of features
    # thickness_directions: (BANDS, d) the map of a row of `dfd.distillation.thickness.thickness_bands`; the two are
    # added
    thickness_directions: Float32
    # encoder_weights, encoder_block: the encoder whose features it was learned from
    encoder_weights: str
    encoder_block: int
    kinds: Kinds | None = None  # the classifier of kinds of parts, or None

    def mapped(
        self,
        features: NDArray[np.floating],
        thickness: Float32,
        generator: np.random.Generator,
        *,
        mean: Float32 | None = None,
    ) -> Float32:
        """Map features (N, D) and thickness bands (N, BANDS) to unit rows (N, d), or (N, d + K) with K kinds.

        Their mean distance is `FARTHER` times that of `features`. `mean` (D,) is the mean feature of the shape; None
        takes that of `features`.
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
        """Apply `mapped` to the features of `targets`; `seed` draws the pairs that measure mean distances."""
        rows = self.mapped(targets.features, thickness, np.random.default_rng(seed))
        return PointTargets(targets.points, rows, None, targets.component, targets.boxes, targets.face)

    @property
    def content_hash(self) -> str:
        """SHA-256 of its arrays: features of different metrics are not comparable."""
        return hash_arrays(*self._arrays().values())

    def _arrays(self) -> dict[str, NDArray[Any]]:
        kinds = self.kinds
        learned = [] if kinds is None else [kinds.hidden, kinds.hidden_bias, kinds.output, kinds.output_bias]
        return dict(zip(SHAPES, (self.directions, self.thickness_directions, *learned), strict=False))

    def fits(self, encoder: Encoder) -> bool:
        """Whether it was learned from features of `encoder`."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file atomically; equal metrics give equal files."""
        write_learned(path, KIND, self._arrays(), (self.encoder_weights, self.encoder_block))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Metric:
        """Read what `save` has written.

        Raises ValueError if the file is truncated or of another kind, or its arrays do not fit or are not finite.
        Raises OSError if it cannot be read.
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
    """A classifier from features of width D to K kinds of parts, with one hidden layer of n rectified units."""

    # hidden, hidden_bias: (D, n) and (n,), of the hidden units
    hidden: Float32
    hidden_bias: Float32
    # output, output_bias: (n, K) and (K,), of the logits
    output: Float32
    output_bias: Float32

    def likely(self, features: Float32, mean: Float32) -> Float32:
        """Return square roots of probabilities, unit rows (N, K), of `features` (N, D); `mean` is that of the shape."""
        units = np.maximum((features - mean) @ self.hidden + self.hidden_bias, 0)
        logits = units @ self.output + self.output_bias
        probable = np.exp(logits - logits.max(axis=1, keepdims=True))
        return np.sqrt(probable / probable.sum(axis=1, keepdims=True))
