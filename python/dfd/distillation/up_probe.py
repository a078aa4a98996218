"""What was learned, once per encoder, about which way is up: a few linear maps of its tokens, kept in a small file.

Each token says, by itself, where up is in the picture and how high it lies; the mean of the first over all pictures,
and the gradient of the second over the surface, are two directions in space. Together with what the surface says
(`dfd.distillation.standing`) they give every candidate its odds.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from dfd.common.files import atomic_write
from dfd.distillation.side_views import SideViews
from dfd.distillation.standing import EVIDENCE, Standing

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder

__all__ = ["TERMS", "UpProbe", "directions", "find_probe"]

KIND = "dfd up probe"
TERMS = ("towards up", "height", *EVIDENCE)
FOLDER = Path(__file__).with_name("up_probes")
_FLAT = 0.02  # of the mean extent: keeps the gradient along an axis without extent small


@dataclass(frozen=True, eq=False)
class UpProbe:
    """The learned numbers, for tokens of width D.

    Attributes
    ----------
    towards_up
        (D + 1, 3) from a token to up, along the picture's right, up and towards the eye; the last row is an offset.
    height
        (D + 1,) from a token to how high it lies.
    odds
        (8,) log-odds that one unit of each of `TERMS` adds to a candidate.
    file_up, file_z
        Log-odds that up, and that ±z, has in a file before anything is looked at.
    encoder_weights, encoder_block
        The encoder that it was learned from.
    """

    towards_up: NDArray[np.float32]
    height: NDArray[np.float32]
    odds: NDArray[np.float64]
    file_up: float
    file_z: float
    encoder_weights: str
    encoder_block: int

    def terms(self, seen: SideViews, standing: Standing, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """What speaks for each of `frames` (K, 3, 3), (K, 8), see `TERMS`."""
        pointing, rising = directions(seen, self.towards_up, self.height)
        ups = frames[:, 1]
        evidence = np.stack([standing.evidence(frame) for frame in frames])
        return np.concatenate([(ups @ pointing)[:, None], (ups @ rising)[:, None], evidence], axis=1)

    def fits(self, encoder: Encoder) -> bool:
        """Whether it was learned from the tokens that `encoder` gives."""
        return (self.encoder_weights, self.encoder_block) == _identity(encoder)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .safetensors file, whole or not at all."""
        arrays: dict[str, NDArray[Any]] = {
            "towards_up": self.towards_up,
            "height": self.height,
            "odds": self.odds,
            "file": np.array([self.file_up, self.file_z]),
        }
        told = {"kind": KIND, "encoder_weights": self.encoder_weights, "encoder_block": str(self.encoder_block)}
        with atomic_write(Path(path)) as temporary:
            save_file(arrays, temporary, metadata=told)

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
        try:
            with safe_open(path, framework="numpy") as file:
                told: dict[str, Any] = file.metadata() or {}
                arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except SafetensorError as error:
            raise ValueError(f"UpProbe.load: {os.fspath(path)} is no whole .safetensors file: {error}") from None
        if told.get("kind") != KIND or not {"towards_up", "height", "odds", "file"} <= arrays.keys():
            raise ValueError(f"UpProbe.load: {os.fspath(path)} holds no probe of which way is up")
        width = len(arrays["height"])
        shapes = {"towards_up": (width, 3), "height": (width,), "odds": (len(TERMS),), "file": (2,)}
        for name, shape in shapes.items():
            if arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
                raise ValueError(f"UpProbe.load: `{name}` in {os.fspath(path)} must be finite, of shape {shape}")
        up, z = map(float, arrays["file"])
        weights, block = told["encoder_weights"], int(told["encoder_block"])
        return cls(arrays["towards_up"], arrays["height"], arrays["odds"], up, z, weights, block)


def directions(
    seen: SideViews, towards_up: NDArray[np.floating], height: NDArray[np.floating]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where up is by the pictures' own account, and where the tokens' heights rise: (3,) each, in mesh coordinates."""
    said = (seen.tokens @ towards_up) * seen.weight[:, None]
    by_picture = np.stack([np.bincount(seen.picture, column, minlength=len(seen.axes)) for column in said.T], axis=1)
    pointing = np.einsum("pk,pkc->c", by_picture, seen.axes)
    weighted = seen.place * seen.weight[:, None]
    moments = weighted.T @ seen.place
    moments += _FLAT * max(float(np.trace(moments)), np.finfo(np.float64).tiny) * np.eye(3)
    rising = np.linalg.solve(moments, weighted.T @ (seen.tokens @ height).astype(np.float64))
    return np.asarray(pointing, np.float64), np.asarray(rising, np.float64)


def find_probe(encoder: Encoder) -> UpProbe | None:
    """The probe that comes with the package for `encoder`; None where there is none for its weights and block."""
    probes = (UpProbe.load(path) for path in sorted(FOLDER.glob("*.safetensors")))
    return next((probe for probe in probes if probe.fits(encoder)), None)


def _identity(encoder: Encoder) -> tuple[str, int]:
    settings = encoder.settings()
    return str(settings["encoder_weights"]), int(settings["encoder_block"])
