"""The up probe of an encoder: a learned linear map from its tokens to votes for up directions, in a small file.

The tokens of a picture give a quadratic form for the upright axis and a vector for its upper end, both in the axes of
the camera. They are rotated to the mesh's axes and averaged over all pictures. A mirrored picture must give the
mirrored vote. Components across the picture are therefore linear in the difference of its halves, and the others in the
mean token. Votes and the cues of the surface (`dfd.upright.stability`) give the log-odds of each candidate.
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
LOOKS = ("looks upright", "looks right side up")  # upright: it may be upside down
TERMS = (*LOOKS, *EVIDENCE)
FOLDER = Path(__file__).with_name("probes")

_HALF = np.sqrt(3) / 2
# A basis of the traceless symmetric matrices in the right, up and back of a camera, with equal norms. At a unit vector,
# they are the real spherical harmonics of degree two. `FORM_TOKENS` is the index of the picture's token for each.
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
    """The learned probe for tokens of width D."""

    mean: Float32  # (D,) subtracted from a picture's mean token
    # form, vector: (5, D) and (3, D), map the tokens of a picture to coefficients of `FORMS` and `VECTORS`
    form: Float32
    vector: Float32
    # odds: (3, 9) log-odds per unit of each of `TERMS`: a row for pictures around the file's up alone, one for pictures
    # along all axes of the file, and one for a shape that is aligned with none of them
    odds: Float64
    # file_up, file_down, file_z: prior log-odds of +y, −y and ±z
    file_up: float
    file_down: float
    file_z: float
    # encoder_weights, encoder_block: the encoder whose tokens it was learned from
    encoder_weights: str
    encoder_block: int

    def votes(self, seen: ViewTokens) -> tuple[Float64, Float64]:
        """Return the mean votes of all pictures in the mesh's axes: a quadratic form (3, 3) and a vector (3,)."""
        tokens = seen.tokens - np.stack([self.mean, np.zeros_like(self.mean)])
        weights = np.einsum("njd,jd->nj", tokens[:, FORM_TOKENS], self.form)
        form = np.einsum("nj,jab,nai,nbk->ik", weights, FORMS, seen.axes, seen.axes, optimize=True) / len(tokens)
        weights = np.einsum("njd,jd->nj", tokens[:, VECTOR_TOKENS], self.vector)
        vector = np.einsum("nj,ja,nai->i", weights, VECTORS, seen.axes, optimize=True) / len(tokens)
        return form, vector

    def terms(self, seen: ViewTokens, ups: Float64, evidence: Float64) -> Float64:
        """Return the `TERMS` (K, 9) of unit `ups` (K, 3); `evidence` (K, 7) are the `EVIDENCE` of `ups`."""
        form, vector = self.votes(seen)
        return np.column_stack([np.einsum("ka,ab,kb->k", ups, form, ups), ups @ vector, evidence])

    def fits(self, encoder: Encoder) -> bool:
        """Return whether the probe was learned from tokens of `encoder`."""
        return (self.encoder_weights, self.encoder_block) == encoder_identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file atomically; equal probes give equal files."""
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
        """Read a file that `save` wrote.

        Raises ValueError if the file is truncated or of another kind, or its arrays are not finite. Raises OSError if
        it cannot be read.
        """
        arrays, identity = read_learned("UpProbe.load", path, KIND, SHAPES)
        mean, form, vector = (arrays[name].astype(np.float32) for name in ("mean", "form", "vector"))
        up, down, z = map(float, arrays["file"])
        return cls(mean, form, vector, arrays["odds"], up, down, z, *identity)


def find_probe(encoder: Encoder) -> UpProbe | None:
    """Return the package's probe for the weights and block of `encoder`, or None."""
    probes = (UpProbe.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((probe for probe in probes if probe.fits(encoder)), None)
