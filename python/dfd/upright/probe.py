"""What was learned, once per encoder, about which way is up: a linear map of its tokens, kept in a small file.

Every picture votes, whichever way its camera is turned: a thing that lies on its side in it says so as clearly as one
that stands. Its tokens give a quadratic form, along which axis the thing stands, and a vector, which end of the axis is
up; both lie in the camera's axes and are added up in the mesh's. A picture's mirror image votes for the mirror image:
what votes across the picture is linear in how its halves differ, and what votes within the plane of symmetry in the
mean of all. Together with what the surface says (`dfd.upright.stability`) that gives every candidate its odds.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.encoders.learned_file import encoder_identity, read_learned, write_learned
from dfd.upright.probe_views import ViewTokens
from dfd.upright.stability import EVIDENCE

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder

__all__ = ["FORMS", "LOOKS", "TERMS", "VECTORS", "UpProbe", "find_probe"]

KIND = "dfd up probe 2"  # the number is that of the format
LOOKS = ("looks upright", "looks right side up")  # upright: it may be upside down
TERMS = (*LOOKS, *EVIDENCE)
FOLDER = Path(__file__).with_name("probes")

_HALF = np.sqrt(3) / 2
# Symmetric matrices without a trace, all of one length, in a camera's right, up and back; by which of a picture's two
# tokens each is metadata. At a unit vector they are the real spherical harmonics of degree two.
FORMS = np.array(
    [
        [[-0.5, 0, 0], [0, 1, 0], [0, 0, -0.5]],
        [[-_HALF, 0, 0], [0, 0, 0], [0, 0, _HALF]],
        [[0, 0, 0], [0, 0, _HALF], [0, _HALF, 0]],
        [[0, _HALF, 0], [_HALF, 0, 0], [0, 0, 0]],
        [[0, 0, _HALF], [0, 0, 0], [_HALF, 0, 0]],
    ]
)
VECTORS = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
SHAPES: dict[str, tuple[int | str, ...]] = {
    "mean": ("D",),
    "form": (len(FORMS), "D"),
    "vector": (len(VECTORS), "D"),
    "odds": (3, len(TERMS)),
    "file": (3,),
}
FORM_TOKENS, VECTOR_TOKENS = np.array([0, 0, 0, 1, 1]), np.array([0, 0, 1])


@dataclass(frozen=True, eq=False)
class UpProbe:
    """The learned numbers, for tokens of width D.

    Attributes
    ----------
    mean
        (D,) what a picture's mean token is compared with.
    form, vector
        (5, D) and (3, D), from a picture's tokens to what `FORMS` and `VECTORS` are weighed by.
    odds
        (3, 9) log-odds that one unit of each of `TERMS` adds to a candidate: by a look around the file's up alone, by
        looks along all axes of the file, and for a shape that lies along none of them.
    file_up, file_down, file_z
        Log-odds that +y, −y, and ±z have in a file before anything is looked at.
    encoder_weights, encoder_block
        The encoder that it was learned from.
    """

    mean: NDArray[np.float32]
    form: NDArray[np.float32]
    vector: NDArray[np.float32]
    odds: NDArray[np.float64]
    file_up: float
    file_down: float
    file_z: float
    encoder_weights: str
    encoder_block: int

    def votes(self, seen: ViewTokens) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The mean votes of all pictures, in the mesh's coordinates: a quadratic form (3, 3) and a vector (3,)."""
        tokens = seen.tokens - np.stack([self.mean, np.zeros_like(self.mean)])
        weights = np.einsum("njd,jd->nj", tokens[:, FORM_TOKENS], self.form)
        form = np.einsum("nj,jab,nai,nbk->ik", weights, FORMS, seen.axes, seen.axes, optimize=True) / len(tokens)
        weights = np.einsum("njd,jd->nj", tokens[:, VECTOR_TOKENS], self.vector)
        vector = np.einsum("nj,ja,nai->i", weights, VECTORS, seen.axes, optimize=True) / len(tokens)
        return form, vector

    def terms(self, seen: ViewTokens, ups: NDArray[np.float64], evidence: NDArray[np.float64]) -> NDArray[np.float64]:
        """What speaks for each of `ups` (K, 3), unit, to be up: (K, 9), see `TERMS`; `evidence` (K, 7) of them."""
        form, vector = self.votes(seen)
        return np.column_stack([np.einsum("ka,ab,kb->k", ups, form, ups), ups @ vector, evidence])

    def fits(self, encoder: Encoder) -> bool:
        """Whether it was learned from the tokens that `encoder` gives."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file, whole or not at all; equal probes are equal files."""
        arrays: dict[str, NDArray[Any]] = {
            "mean": self.mean,
            "form": self.form,
            "vector": self.vector,
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
        arrays, identity = read_learned("UpProbe.load", path, KIND, SHAPES)
        mean, form, vector = (arrays[name].astype(np.float32) for name in ("mean", "form", "vector"))
        up, down, z = map(float, arrays["file"])
        return cls(mean, form, vector, arrays["odds"], up, down, z, *identity)


def find_probe(encoder: Encoder) -> UpProbe | None:
    """The probe that comes with the package for `encoder`; None where there is none for its weights and block."""
    probes = (UpProbe.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((probe for probe in probes if probe.fits(encoder)), None)
