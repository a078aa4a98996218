"""Define the interface that vision networks of all families, such as DINOv2 and CLIP, have in common."""

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor, nn

from dfd.encoders.weight_files import ChannelStats


@dataclass(frozen=True)
class VisionModel:
    """A network that consists of the first `block` of its `depth` blocks.

    `tokens` maps normalized images (n, 3, H, W) to tokens (n, H / patch, W / patch, D). H and W are multiples of `step`
    pixels, or exactly `fixed_size` if it is set. The second argument of `tokens`, bool (n, H / patch, W / patch),
    selects the patches to encode; all other tokens are 0. None encodes all patches. If `takes_patches` is False, this
    argument must be None.
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
