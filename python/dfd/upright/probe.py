"""Vote for up directions by an up probe: a linear map of an encoder's tokens, learned once for each encoder.

The tokens of a picture, feature vectors of its patches, give two votes in the axes of the camera: a quadratic form for
the upright axis, and a vector for its upper end. Votes are rotated to the mesh's axes and averaged over all pictures. A
mirrored picture must give the mirrored vote. So coefficients of a vote that change sign under a mirroring are linear in
the difference between the mean tokens of the picture's halves. The other coefficients are linear in the mean token. The
log-odds of a candidate are a weighted sum of its votes and of cues of the surface (`dfd.upright.stability`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float32, Float64
from dfd.encoders.learned_file import encoder_identity, read_learned, write_learned
from dfd.upright.probe_views import ViewTokens
from dfd.upright.stability import EVIDENCE

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder

KIND = "dfd up probe 2"  # format version 2
LOOKS = ("looks upright", "looks right side up")  # names of the votes: for the axis (up or down), and for its upper end
TERMS = (*LOOKS, *EVIDENCE)  # names of the values whose weighted sum gives the log-odds of a candidate
FOLDER = Path(__file__).with_name("probes")

_HALF = np.sqrt(3) / 2
# An orthogonal basis of the traceless symmetric matrices. The coordinates are right, up and back of a camera. On unit
# vectors, these quadratic forms are multiples of the real spherical harmonics of degree two.
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
# For each of `FORMS` and `VECTORS`, the index in `ViewTokens.tokens` of the token that gives the coefficient.
FORM_TOKENS, VECTOR_TOKENS = np.array([0, 0, 0, 1, 1]), np.array([0, 0, 1])


@dataclass(frozen=True, eq=False)
class UpProbe:
    """The learned probe for tokens of width D."""

    mean: Float32  # (D,) vector that is subtracted from a picture's mean token
    form: Float32  # (5, D) the map of tokens to coefficients of `FORMS`
    vector: Float32  # (3, D) the map of tokens to coefficients of `VECTORS`
    # (3, 9) factors of `TERMS` in the log-odds. The rows are for pictures around +y alone, for pictures around all
    # axes of the file, and for a shape that is not aligned with the axes of the file.
    odds: Float64
    file_up: float  # prior log-odds of +y
    file_down: float  # prior log-odds of −y
    file_z: float  # prior log-odds of +z and of −z
    encoder_weights: str  # fingerprint of the weights that gave the training tokens
    encoder_block: int  # block that gave the training tokens

    def votes(self, seen: ViewTokens) -> tuple[Float64, Float64]:
        """Return the mean votes of pictures in the mesh's axes: a quadratic form (3, 3) and a vector (3,)."""
        tokens = seen.tokens - np.stack([self.mean, np.zeros_like(self.mean)])
        weights = np.einsum("njd,jd->nj", tokens[:, FORM_TOKENS], self.form)
        form = np.einsum("nj,jab,nai,nbk->ik", weights, FORMS, seen.axes, seen.axes, optimize=True) / len(tokens)
        weights = np.einsum("njd,jd->nj", tokens[:, VECTOR_TOKENS], self.vector)
        vector = np.einsum("nj,ja,nai->i", weights, VECTORS, seen.axes, optimize=True) / len(tokens)
        return form, vector

    def terms(self, seen: ViewTokens, ups: Float64, evidence: Float64) -> Float64:
        """Return the values (K, 9) of `TERMS` for the unit directions `ups` (K, 3) with the cues `evidence` (K, 7)."""
        form, vector = self.votes(seen)
        return np.column_stack([np.einsum("ka,ab,kb->k", ups, form, ups), ups @ vector, evidence])

    def fits(self, encoder: Encoder) -> bool:
        """Return whether the probe was learned from tokens of `encoder`."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file atomically. Equal probes give files with equal bytes."""
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
        """Return the probe in a file that `save` wrote.

        Raises ValueError if the file is truncated or has another format, or if an array has a wrong shape or a number
        that is not finite. Raises OSError if the file cannot be read.
        """
        arrays, identity = read_learned("UpProbe.load", path, KIND, SHAPES)
        mean, form, vector = (arrays[name].astype(np.float32) for name in ("mean", "form", "vector"))
        up, down, z = map(float, arrays["file"])
        return cls(mean, form, vector, arrays["odds"], up, down, z, *identity)


def find_probe(encoder: Encoder) -> UpProbe | None:
    """Return the package's probe for the weights and block of `encoder`, or None if there is none."""
    probes = (UpProbe.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((probe for probe in probes if probe.fits(encoder)), None)
