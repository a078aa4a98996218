"""A vision network of any family, in the form in which the encoder runs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor, nn

from dfd.encoders.weight_files import ChannelStats


@dataclass(frozen=True)
class VisionModel:
    """A network that is cut off after `block` (counted from 1) of its `depth` blocks.

    `tokens` maps normalized images (n, 3, H, W) to tokens (n, H / patch, W / patch, D). H and W are multiples of `step`
    pixels, or exactly `fixed_size` if it is set. The second argument of `tokens` (n, H / patch, W / patch), bool,
    selects the patches that take part; None selects all. The tokens of other patches are 0. Only networks that
    `takes_patches` receive this argument.
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
