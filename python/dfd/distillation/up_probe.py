"""What was learned, once per encoder, about which way is up: a linear map of its tokens, kept in a small file.

Mean tokens of a shape as it would stand, all of it and its upper, middle and lower third, say how much it looks like
one that stands so. Together with what the surface says (`dfd.distillation.standing`) that gives every candidate its
odds.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.distillation.learned_file import encoder_identity, read_learned, write_learned
from dfd.distillation.standing import EVIDENCE
from dfd.distillation.views_around import LAYERS

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder

__all__ = ["LOOKS", "TERMS", "UpProbe", "find_probe"]

KIND = "dfd up probe"
LOOKS = ("looks upright", "looks right side up")  # upright: it may be upside down
TERMS = (*LOOKS, *EVIDENCE)
FOLDER = Path(__file__).with_name("up_probes")


@dataclass(frozen=True, eq=False)
class UpProbe:
    """The learned numbers, for tokens of width D.

    Attributes
    ----------
    looks
        (2, 4, D), from the mean tokens of `dfd.distillation.views_around.LAYERS` to `LOOKS`.
    odds
        (9,) log-odds that one unit of each of `TERMS` adds to a candidate.
    file_up, file_down, file_z
        Log-odds that +y, −y, and ±z have in a file before anything is looked at.
    encoder_weights, encoder_block
        The encoder that it was learned from.
    """

    looks: NDArray[np.float32]
    odds: NDArray[np.float64]
    file_up: float
    file_down: float
    file_z: float
    encoder_weights: str
    encoder_block: int

    def terms(self, seen: NDArray[np.float64], evidence: NDArray[np.float64]) -> NDArray[np.float64]:
        """What speaks for each of K frames, (K, 9), see `TERMS`: its mean tokens (K, 4, D), its `EVIDENCE` (K, 7)."""
        return np.concatenate([np.einsum("kld,tld->kt", seen, self.looks), evidence], axis=1)

    def fits(self, encoder: Encoder) -> bool:
        """Whether it was learned from the tokens that `encoder` gives."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file, whole or not at all; equal probes are equal files."""
        arrays: dict[str, NDArray[Any]] = {
            "looks": self.looks,
            "odds": self.odds,
            "file": np.array([self.file_up, self.file_down, self.file_z]),
        }
        write_learned(path, KIND, arrays, (self.encoder_weights, self.encoder_block))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> UpProbe:
        """Read what `save` has written.

        Raises
        ------
        ValueError
            If the file is something else, or cut short, or its numbers are not finite.
        OSError
            If it cannot be read.
        """
        told, arrays = read_learned("UpProbe.load", path)
        if told.get("kind") != KIND or not {"looks", "odds", "file"} <= arrays.keys():
            raise ValueError(f"UpProbe.load: {os.fspath(path)} holds no probe of which way is up")
        shapes = {"looks": (len(LOOKS), len(LAYERS), *arrays["looks"].shape[2:3]), "odds": (len(TERMS),), "file": (3,)}
        for name, shape in shapes.items():
            if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
                raise ValueError(f"UpProbe.load: `{name}` in {os.fspath(path)} must be finite, of shape {shape}")
        up, down, z = map(float, arrays["file"])
        weights, block = told["encoder_weights"], int(told["encoder_block"])
        return cls(arrays["looks"], arrays["odds"], up, down, z, weights, block)


def find_probe(encoder: Encoder) -> UpProbe | None:
    """The probe that comes with the package for `encoder`; None where there is none for its weights and block."""
    probes = (UpProbe.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((probe for probe in probes if probe.fits(encoder)), None)
