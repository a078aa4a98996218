"""The families of vision networks that transformers runs, and how the tokens of a block are read from each.

The tokens of a block are what the network would give if that block were its last: the network's own final layer norm
(SAM's neck) is applied to them, and the class token and registers are left out.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from dfd.encoders.known import CLIP, IMAGENET, ChannelStats
from dfd.encoders.vision_model import VisionModel, check_block
from dfd.encoders.weight_files import EncoderWeights, unreadable


def build_family(weights: EncoderWeights, block: int | None, channels: ChannelStats | None) -> VisionModel:
    """Put `weights` in a folder into a network and cut it off after `block`; None takes the family's own choice.

    `channels` are used where the weights come without their own.

    Raises ValueError if transformers is not installed, the family is unknown, the block out of range, or the tensors do
    not fit the configuration. Raises OSError if the file of weights cannot be read.
    """
    kind = weights.config["model_type"]
    try:
        from transformers.models.auto.configuration_auto import CONFIG_MAPPING
    except ImportError:
        raise ValueError(
            f'load_encoder: `encoder`: a {kind} model needs transformers: pip install "dfd[encoders]"'
        ) from None
    if kind not in CONFIG_MAPPING:
        raise ValueError(f"load_encoder: `encoder`: this version of transformers does not know the model type {kind!r}")
    family = _FAMILIES.get(kind, _UNKNOWN)
    with _quiet():
        try:
            config = CONFIG_MAPPING[kind].from_dict(dict(weights.config))
        except Exception as error:  # which configurations raise of any type
            raise ValueError(
                f"load_encoder: `encoder`: its config.json is not a valid {kind} model: {error}"
            ) from error
        config = family.config(config)
        network, missing = _load(family, weights, config)
    blocks = network.get_submodule(family.blocks) if family.blocks else _largest_list(network, kind)
    assert isinstance(blocks, nn.ModuleList)
    depth = len(blocks)
    chosen = check_block(family.block(config, depth) if block is None else block, depth)
    del blocks[chosen:]  # those after the one used are never run
    unset = sorted(missing & {name for name, _ in network.named_parameters()})
    if unset:
        raise ValueError(
            f"load_encoder: `encoder`: the weights lack {len(unset)} tensors of a {kind} model, such as {unset[0]}"
        )
    network.eval().requires_grad_(False)
    patch = family.patch(config, chosen)
    return VisionModel(
        network=network,
        tokens=lambda images, patches: family.tokens(network, images),
        dimension=family.dimension(config, chosen),
        patch=patch,
        step=family.step(config) or patch,
        block=chosen,
        depth=depth,
        channels=weights.channels or channels or family.channels,
        fixed_size=family.fixed_size(config),
    )


def _side(config: Any, name: str, wanted: str) -> int:
    """The side of a square whose size `config` has under this name, as a number or a pair."""
    size = getattr(config, name, None)
    if isinstance(size, list | tuple) and len(set(size)) == 1:
        size = size[0]
    if not isinstance(size, int):
        raise ValueError(f"load_encoder: `encoder` must be a {wanted}")
    return size


def _patch(config: Any, block: int) -> int:
    return _side(config, "patch_size", "vision transformer with square patches")


def _image_size(config: Any) -> int:
    return _side(config, "image_size", "network for square images of a known size")


@dataclass(frozen=True)
class _Family:
    """How a family of networks is loaded (class `model`), cut off (the list `blocks`) and run.

    `submodule` is the part of the loaded model that turns images into tokens; `config` picks the part of its
    configuration that describes it.
    """

    model: str
    tokens: Callable[[Any, Tensor], Tensor]
    blocks: str = ""
    submodule: str = ""
    config: Callable[[Any], Any] = lambda config: getattr(config, "vision_config", config)
    channels: ChannelStats = IMAGENET
    block: Callable[[Any, int], int] = lambda config, depth: depth
    dimension: Callable[[Any, int], int] = lambda config, block: int(config.hidden_size)
    patch: Callable[[Any, int], int] = _patch
    step: Callable[[Any], int | None] = lambda config: None
    fixed_size: Callable[[Any], int | None] = lambda config: None


def _load(family: _Family, weights: EncoderWeights, config: Any) -> tuple[Any, set[str]]:
    """The part of the model that makes tokens, and the names in it that no weights were found for."""
    import transformers

    try:
        model, report = getattr(transformers, family.model).from_pretrained(
            weights.folder,
            config=config,
            dtype=torch.float32,
            local_files_only=True,
            output_loading_info=True,
            ignore_mismatched_sizes=True,  # they are reported, and refused below by name
        )
    except Exception as error:  # safetensors, pickle, zip and transformers raise types of their own
        raise unreadable(weights, error) from error
    prefix = f"{family.submodule}." if family.submodule else ""
    wrong = sorted(entry for entry in report["mismatched_keys"] if entry[0].startswith(prefix))
    if wrong:
        name, found, wanted = wrong[0]
        raise ValueError(
            f"load_encoder: `encoder`: the tensor {name} has shape {tuple(found)}, "
            f"its config.json asks for {tuple(wanted)}"
        )
    network = model.get_submodule(family.submodule)
    return network, {name.removeprefix(prefix) for name in report["missing_keys"] if not _unused(name)}


def _unused(name: str) -> bool:
    """Whether the parameter plays no part in the tokens, so that files of weights may leave it out."""
    return any(part in ("pooler", "head", "mask_token") for part in name.split("."))


def _largest_list(network: nn.Module, kind: str) -> nn.ModuleList:
    """The blocks of a network of unknown architecture: its longest list of modules."""
    lists = [module for module in network.modules() if isinstance(module, nn.ModuleList)]
    if not lists:
        raise ValueError(f"load_encoder: `encoder`: a model of type {kind!r} has no blocks of tokens to take")
    return max(lists, key=len)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence transformers' load reports, warnings and progress bars: what matters is checked and raised here."""
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


# How each family turns normalized images (n, 3, H, W) into tokens (n, h, w, D).


def _grid(sequence: Tensor, images: Tensor, patch: int) -> Tensor:
    """Patch tokens of a sequence (n, prefix + h·w, D) in their places (n, h, w, D); the prefix is left out."""
    rows, columns = images.shape[2] // patch, images.shape[3] // patch
    if sequence.ndim != 3 or sequence.shape[1] < rows * columns:
        raise ValueError(
            f"encode: `encoder` gives an output of shape {tuple(sequence.shape)}, "
            f"not {rows} × {columns} tokens an image"
        )
    return sequence[:, sequence.shape[1] - rows * columns :].reshape(len(sequence), rows, columns, -1)


def _plain(network: Any, images: Tensor) -> Tensor:
    return _grid(network(pixel_values=images).last_hidden_state, images, _patch(network.config, 0))


def _clip(network: Any, images: Tensor) -> Tensor:
    tokens = network(pixel_values=images, interpolate_pos_encoding=True).last_hidden_state
    # CLIP itself applies its last norm to the class token only.
    return network.post_layernorm(_grid(tokens, images, network.config.patch_size))


def _hiera(network: Any, images: Tensor) -> Tensor:
    return network(pixel_values=images).last_hidden_state


def _sam(network: Any, images: Tensor) -> Tensor:
    return _hiera(network, images).permute(0, 2, 3, 1)


def _hiera_backbone(config: Any) -> Any:
    return getattr(config, "vision_config", config).backbone_config


def _hiera_stage(config: Any, block: int) -> int:
    """The stage (from 0) that a block (from 1) belongs to."""
    ends = torch.cumsum(torch.tensor(_hiera_backbone(config).blocks_per_stage), 0)
    return int((ends < block).sum())


def _hiera_patch(config: Any, block: int) -> int:
    backbone = _hiera_backbone(config)
    pools = min(_hiera_stage(config, block), backbone.num_query_pool_stages)
    return int(backbone.patch_stride[0] * backbone.query_stride[0] ** pools)


def _hiera_block(config: Any, depth: int) -> int:
    """The last block of the third stage (16 pixels a token), the longest one; the fourth has only a few blocks."""
    return int(sum(_hiera_backbone(config).blocks_per_stage[:3]))


def _hiera_step(config: Any) -> int:
    """Every stage halves the map, and the window of position embeddings is tiled over it."""
    backbone = _hiera_backbone(config)
    stride = backbone.patch_stride[0]
    pooled = stride * backbone.query_stride[0] ** backbone.num_query_pool_stages
    return math.lcm(pooled, stride * backbone.window_size_per_stage[0])


_DINOV3 = _Family("DINOv3ViTModel", _plain, "model.layer")
_CLIP = _Family("CLIPVisionModel", _clip, "encoder.layers", channels=CLIP)
_SAM = _Family(
    "SamVisionModel",
    _sam,
    "layers",
    "vision_encoder",
    dimension=lambda config, block: int(config.output_channels),
    fixed_size=_image_size,
)
_SAM2 = _Family(
    "Sam2Model",
    _hiera,
    "blocks",
    "vision_encoder.backbone",
    config=lambda config: config,
    block=_hiera_block,
    dimension=lambda config, block: int(_hiera_backbone(config).embed_dim_per_stage[_hiera_stage(config, block)]),
    patch=_hiera_patch,
    step=_hiera_step,
)
# Of other families only the size of images is known, from their configuration.
_UNKNOWN = _Family("AutoModel", _plain, fixed_size=_image_size)

# By model type; those of CLIP and SAM may stand alone as vision models.
_FAMILIES = {"dinov3_vit": _DINOV3, "clip": _CLIP, "clip_vision_model": _CLIP, "sam": _SAM, "sam_vision_model": _SAM}
_FAMILIES |= {"sam2": _SAM2, "sam2_video": _SAM2}
