"""A vision network as the encoder runs it, whatever family it is of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor, nn

from dfd.encoders.weight_files import ChannelStats


@dataclass(frozen=True)
class VisionModel:
    """A network cut off after `block` (counted from 1) of its `depth` blocks.

    `tokens` maps normalized images (n, 3, H, W), H and W multiples of `step` pixels (exactly `fixed_size` where that
    is set), to tokens (n, H / patch, W / patch, D). Its second argument (n, H / patch, W / patch), bool, tells the
    patches that take part, None all of them; the tokens of others are 0. It is given only where the network
    `takes_patches`.
    """

    network: nn.Module
    tokens: Callable[[Tensor, Tensor | None], Tensor]
    dimension: int
    patch: int
    step: int
    block: int
    depth: int
    channels: ChannelStats
    fixed_size: int | None = None
    takes_patches: bool = False
