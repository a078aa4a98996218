"""Run vision networks of the package transformers up to a chosen block, whose output gives the tokens.

Later blocks are removed. In most families, the output of the chosen block passes through the network's final LayerNorm.
In SAM, it passes through the neck (convolutions). In SAM 2, it is not changed. Class and register tokens are left out.
"""

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from dfd.common import check
from dfd.common.distribution import pip_install
from dfd.common.errors import ArgumentError
from dfd.encoders.vision_model import VisionModel
from dfd.encoders.weight_files import IMAGENET, ChannelStats, EncoderWeights, check_fit, unreadable

CLIP = ChannelStats((0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711))


def build_family(weights: EncoderWeights, block: int | None) -> VisionModel:
    """Return the network in `weights.folder` with only its first `block` blocks; None keeps all blocks.

    Raises ValueError if transformers is not installed, the family is unknown, or the block is out of range. Raises
    ValueError if the tensors do not fit the configuration. Raises OSError if a file of weights cannot be read.
    """
    kind = weights.config["model_type"]
    try:
        from transformers.models.auto.configuration_auto import CONFIG_MAPPING
    except ImportError:
        reason = f"is a {kind} model, which needs transformers: {pip_install('encoders')}"
        raise ArgumentError("encoder", reason) from None
    if kind not in CONFIG_MAPPING:
        raise ArgumentError("encoder", f"must be a model that the installed transformers has, got the type {kind!r}")
    with _quiet():
        from transformers import AutoModel

        try:
            config = CONFIG_MAPPING[kind].from_dict(dict(weights.config))
        except Exception as error:  # configurations raise errors of any type
            reason = f"must have a valid config.json of a {kind} model, got the error {error}"
            raise ArgumentError("encoder", reason) from error
        config = getattr(config, "vision_config", config)
        try:
            network, report = AutoModel.from_pretrained(
                weights.folder,
                config=config,
                dtype=torch.float32,
                local_files_only=True,
                output_loading_info=True,
                ignore_mismatched_sizes=True,  # `check_fit` raises the error, with the tensor's name
                key_mapping={r"^vision_encoder\.": ""},  # removes the prefix of tensor names in files of SAM 2
            )
        except Exception as error:  # safetensors and transformers raise their own error types
            raise unreadable(weights, error) from error
    lists = [module for module in network.modules() if isinstance(module, nn.ModuleList)]
    if not lists:
        raise ArgumentError("encoder", f"must be a model with a list of blocks, got the type {kind!r}")
    blocks = max(lists, key=len)
    depth = len(blocks)
    chosen = depth if block is None else check.whole(None, "block", block, minimum=1, maximum=depth)
    del blocks[chosen:]
    # Files of weights may lack the parameters of these modules, because the tokens do not depend on them.
    unused = {"pooler", "head", "mask_token"}
    needed = {name for name, _ in network.named_parameters() if unused.isdisjoint(name.split("."))}
    check_fit(weights, report["mismatched_keys"], report["missing_keys"] & needed)
    network.eval().requires_grad_(False)
    channels = weights.channels or (CLIP if config.model_type == "clip_vision_model" else IMAGENET)
    return _FAMILIES.get(config.model_type, _of_one_size)(network, config, block=chosen, depth=depth, channels=channels)


@contextmanager
def _quiet() -> Iterator[None]:
    """Disable the log messages, warnings and progress bars of transformers; this module checks the tensors itself."""
    from transformers.utils import logging

    verbosity, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity(logging.CRITICAL)
    logging.disable_progress_bar()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.set_verbosity(verbosity)
        if bars:
            logging.enable_progress_bar()


# Each of the next five functions returns the `VisionModel` of a family. `others` are more arguments of `VisionModel`.


def _of_any_size(network: Any, config: Any, **others: Any) -> VisionModel:
    """Return the model of a family that accepts images whose sides are multiples of the patch side."""
    patch = _side(config, "patch_size", "a vision transformer with square patches")

    def tokens(images: Tensor, patches: Tensor | None) -> Tensor:
        return _grid(network(pixel_values=images).last_hidden_state, images, patch)

    return VisionModel(network, tokens, dimension=config.hidden_size, patch=patch, step=patch, **others)


def _of_one_size(network: Any, config: Any, **others: Any) -> VisionModel:
    """Return the model of a family that accepts only images of the size in its configuration."""
    size = _side(config, "image_size", "a network with a fixed size of square images")
    return _of_any_size(network, config, fixed_size=size, **others)


def _clip(network: Any, config: Any, **others: Any) -> VisionModel:
    def tokens(images: Tensor, patches: Tensor | None) -> Tensor:
        sequence = network(pixel_values=images, interpolate_pos_encoding=True).last_hidden_state
        # CLIP itself applies its final LayerNorm to the class token only.
        return network.post_layernorm(_grid(sequence, images, config.patch_size))

    return replace(_of_any_size(network, config, **others), tokens=tokens)


def _sam(network: Any, config: Any, **others: Any) -> VisionModel:
    def tokens(images: Tensor, patches: Tensor | None) -> Tensor:
        return network(pixel_values=images).last_hidden_state.permute(0, 2, 3, 1)

    return replace(_of_one_size(network, config, **others), tokens=tokens, dimension=config.output_channels)


def _sam2(network: Any, config: Any, **others: Any) -> VisionModel:
    """Return the model of SAM 2, whose backbone halves the resolution of the token grid between stages."""
    backbone, sizes = network.backbone, config.backbone_config

    def tokens(images: Tensor, patches: Tensor | None) -> Tensor:
        return backbone(pixel_values=images).last_hidden_state

    stride = sizes.patch_stride[0]
    halved = sum(block.query_stride is not None for block in backbone.blocks)
    coarsest = stride * sizes.query_stride[0] ** sizes.num_query_pool_stages
    window = stride * sizes.window_size_per_stage[0]  # period of the position embeddings, in pixels
    return VisionModel(
        network,
        tokens,
        dimension=backbone.blocks[-1].dim_out,
        patch=stride * sizes.query_stride[0] ** halved,
        step=math.lcm(coarsest, window),
        **others,
    )


_FAMILIES = {  # the function for each model type; for all other types, `_of_one_size`
    "dinov3_vit": _of_any_size,
    "clip_vision_model": _clip,
    "sam_vision_model": _sam,
    "sam2_vision_model": _sam2,
}


def _grid(sequence: Tensor, images: Tensor, patch: int) -> Tensor:
    """Return the last h·w tokens of `sequence` (n, prefix + h·w, D) as a grid (n, h, w, D); h and w count patches."""
    rows, columns = images.shape[2] // patch, images.shape[3] // patch
    if sequence.ndim != 3 or sequence.shape[1] < rows * columns:
        found = f"an output of shape {tuple(sequence.shape)}"
        raise ArgumentError("encoder", f"must give {rows} × {columns} tokens per image, got {found}", "encode")
    return sequence[:, sequence.shape[1] - rows * columns :].reshape(len(sequence), rows, columns, -1)


def _side(config: Any, name: str, wanted: str) -> int:
    """Return the side of a square in pixels: the entry `name` of `config`, a number or a pair of equal numbers."""
    size = getattr(config, name, None)
    if isinstance(size, list | tuple) and len(set(size)) == 1:
        size = size[0]
    if not isinstance(size, int):
        raise ArgumentError("encoder", f"must be {wanted}, got {name} {size!r}")
    return size
