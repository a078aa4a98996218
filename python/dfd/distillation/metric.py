"""A metric learned once per encoder: which differences tell parts apart, and which lie within a part.

An encoder's features differ by more than parts: by where on the body a point is, how the surface bends, what stands
near. And some of what parts differ by is in no picture, such as how thick they are, see `dfd.distillation.thickness`.
Labelled shapes say which differences count. Features and thickness go through one linear map that weighs each direction
by how much it changes between parts for what it changes within them (Fisher's discriminant directions; `python -m
bench.training.learn_metric` learns it). Beside what comes out stands which kind of part a point looks like, see
`dfd.distillation.metric`. Rows are of unit length and about as far from each other, on average, as they were before: a
weight 1 − d keeps its meaning.

The map comes before the fit, so that a field's features have these distances by themselves, and are narrower.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.distillation.targets import PAIRS, PointTargets, mean_distance, restore_contrast, unit
from dfd.distillation.thickness import BANDS
from dfd.encoders.learned_file import encoder_identity, read_learned, write_learned
from dfd.field.cache_key import hash_arrays

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder

__all__ = ["FOLDER", "Kinds", "Metric", "find_metric"]

KIND = "dfd metric 3"  # the number is that of the format
SHAPES: dict[str, tuple[int | str, ...]] = {
    "directions": ("D", "d"),
    "thickness_directions": (BANDS, "d"),
    "kinds_hidden": ("D", "n"),  # from here on only in files that know kinds of parts
    "kinds_hidden_bias": ("n",),
    "kinds_output": ("n", "K"),
    "kinds_output_bias": ("K",),
}
FOLDER = Path(__file__).with_name("metrics")
# Details, of many vertices and little area, draw together: at equal mean distance over the surface a handle would move
# more vertices than without the metric. So much farther apart it moves fewer.
FARTHER = 1.06
# What a squared distance of kinds counts for, beside one of mapped features. With more, birds lose.
KINDS_SHARE = 0.2
_LEAST_STRETCH = 0.02  # towards their mean, where mapped rows lie farther apart than before


@dataclass(frozen=True, eq=False)
class Metric:
    """What was learned about an encoder's features of width D.

    Attributes
    ----------
    directions
        (D, d) the map of a row of features.
    thickness_directions
        (BANDS, d) that of a row of `dfd.distillation.thickness.thickness_bands`; both are added.
    kinds
        What tells kinds of parts; None where only the map was learned.
    encoder_weights, encoder_block
        The encoder that it was learned from.
    """

    directions: NDArray[np.float32]
    thickness_directions: NDArray[np.float32]
    encoder_weights: str
    encoder_block: int
    kinds: Kinds | None = None

    def mapped(
        self,
        features: NDArray[np.floating],
        thickness: NDArray[np.float32],
        generator: np.random.Generator,
        *,
        mean: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """Return features (N, D) with bands of thickness (N, BANDS) as unit rows, whose distances tell parts apart.

        They are (N, d), or (N, d + K) with K kinds; their mean distance is `FARTHER` times that of `features`. `mean`
        (D,) is that of the features of the shape; None takes that of `features`.
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

    def of_targets(self, targets: PointTargets, thickness: NDArray[np.float32], seed: int) -> PointTargets:
        """Return targets at the same points whose features went through `mapped`; `seed` draws pairs to measure."""
        rows = self.mapped(targets.features, thickness, np.random.default_rng(seed))
        return PointTargets(targets.points, rows, None, targets.piece, targets.boxes, targets.face)

    @property
    def content_hash(self) -> str:
        """SHA-256 of all its numbers: features that went through another metric are not to be compared."""
        return hash_arrays(*self._arrays().values())

    def _arrays(self) -> dict[str, NDArray[Any]]:
        """What a file keeps, by name."""
        kinds = self.kinds
        learned = [] if kinds is None else [kinds.hidden, kinds.hidden_bias, kinds.output, kinds.output_bias]
        return dict(zip(SHAPES, (self.directions, self.thickness_directions, *learned), strict=False))

    def fits(self, encoder: Encoder) -> bool:
        """Whether it was learned from the features that `encoder` gives."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file, whole or not at all; equal metrics are equal files."""
        write_learned(path, KIND, self._arrays(), (self.encoder_weights, self.encoder_block))

    @classmethod
    def load(cls, path: str | os.PathLike[str], encoder: Encoder | None = None) -> Metric:
        """Read what `save` has written, for `encoder` where one is given.

        Raises
        ------
        ValueError
            If the file is something else, or cut short, its numbers are no map or not finite, or it was learned from
            another encoder.
        OSError
            If it cannot be read.
        """
        arrays, identity = read_learned("Metric.load", path, KIND, SHAPES, optional=list(SHAPES)[2:])
        directions, thickness, *learned = (values.astype(np.float32) for values in arrays.values())
        metric = cls(directions, thickness, *identity, Kinds(*learned) if learned else None)
        if encoder is not None and not metric.fits(encoder):
            raise ValueError(f"Metric.load: {os.fspath(path)} was learned from another encoder than {encoder!r}")
        return metric


def find_metric(encoder: Encoder) -> Metric | None:
    """Return the metric that comes with the package for `encoder`; None where there is none for its weights and block.

    Raises
    ------
    ValueError
        If one of the package's files is damaged.
    """
    metrics = (Metric.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((metric for metric in metrics if metric.fits(encoder)), None)


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
