"""Networks of all families by torch and transformers, on any device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfd.common.devices import out_of_memory
from dfd.common.torch_threads import share
from dfd.encoders.attention import use_blocked_attention
from dfd.encoders.families import build
from dfd.encoders.patches import foreground_patches
from dfd.encoders.precision import Precision
from dfd.encoders.presets import ChannelStats
from dfd.encoders.weight_files import Weights

__all__ = ["TorchNetwork", "fill_on_device", "resized"]

_PIXELS_AT_ONCE = 24 * 518 * 518  # that go through the network together on a device: enough to keep it busy


class TorchNetwork:
    """A network cut off after `block`; see `dfd.encoders.encode.Network`, and for what is raised `families.build`."""

    def __init__(
        self,
        weights: Weights,
        block: int | None,
        channels: ChannelStats | None,
        *,
        background: bool,
        device: torch.device,
        precision: Precision,
    ) -> None:
        model = build(weights, block, channels)
        self._model = replace(model, takes_patches=False) if background else model
        self._device, self._precision = device, precision
        self.network = model.network
        self.patch, self.step, self.fixed_size = model.patch, model.step, model.fixed_size
        self.block, self.depth, self.dimension = model.block, model.depth, model.dimension
        self.channels, self.takes_patches = model.channels, self._model.takes_patches
        if precision == "bfloat16" and device.type == "cpu" and model.pluggable_attention:
            use_blocked_attention(model.network)
        model.network.to(device)

    def share(self, count: int, resolution: int, fill: Callable[[int, int], None]) -> None:
        """See `dfd.encoders.encode.Network`: one for each thread at a time, or as many as a device has room for."""
        if self._device.type == "cpu":
            share(count, 1, fill)
        else:
            fill_on_device(count, max(1, _PIXELS_AT_ONCE // resolution**2), fill)

    def tokens(self, images: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> NDArray[np.float32]:
        """See `dfd.encoders.encode.Network`."""
        with torch.inference_mode():
            pixels = torch.from_numpy(np.array(images, order="C")).to(self._device).permute(0, 3, 1, 2) / 255.0
            pixels = (pixels - self._of_channels(self.channels.mean)) / self._of_channels(self.channels.std)
            patches: list[Tensor] | None = None
            if covered is not None and self.takes_patches:
                side = images.shape[1] // self.patch
                patches = [torch.from_numpy(foreground_patches(shown, side)).to(self._device) for shown in covered]
            result: NDArray[np.float32] = self._run(pixels, patches).cpu().numpy()
            return result

    def _run(self, pixels: Tensor, patches: list[Tensor] | None) -> Tensor:
        with torch.autocast(self._device.type, torch.bfloat16, enabled=self._precision == "bfloat16"):
            if patches is None:
                return self._model.tokens(pixels.contiguous(), None).float()
            # Each picture has its own number of patches.
            return torch.cat(
                [
                    self._model.tokens(picture[None].contiguous(), shown).float()
                    for picture, shown in zip(pixels, patches, strict=True)
                ]
            )

    def _of_channels(self, values: tuple[float, float, float]) -> Tensor:
        return torch.tensor(values, device=self._device).view(1, 3, 1, 1)


def resized(images: NDArray[np.uint8], resolution: int) -> NDArray[np.uint8]:
    """Return square `images` (n, R, R, 3) with `resolution` pixels along a side."""
    pixels = torch.from_numpy(np.array(images, order="C")).permute(0, 3, 1, 2).float()
    size = (resolution, resolution)
    wanted = torch.nn.functional.interpolate(pixels, size, mode="bicubic", antialias=True, align_corners=False)
    found: NDArray[np.uint8] = wanted.round().clamp(0, 255).byte().permute(0, 2, 3, 1).contiguous().numpy()
    return found


def fill_on_device(count: int, at_once: int, fill: Callable[[int, int], None]) -> None:
    """Call `fill` for all pictures, fewer at once where memory runs out."""
    begin = 0
    while begin < count:
        end = min(begin + at_once, count)
        try:
            fill(begin, end)
        except RuntimeError as error:
            if at_once == 1 or not out_of_memory(error):
                raise
            at_once = max(1, at_once // 2)
            continue
        begin = end
