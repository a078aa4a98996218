"""Make a tiny network of each encoder family, and compute its tokens by transformers itself."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers

from dfd.encoders.encode import Encoder

VISION = {
    "hidden_size": 16,
    "intermediate_size": 32,
    "num_hidden_layers": 3,
    "num_attention_heads": 2,
    "image_size": 32,
    "patch_size": 8,
    "initializer_range": 0.2,
}


TEXT = {
    "hidden_size": 16,
    "intermediate_size": 32,
    "num_hidden_layers": 1,
    "num_attention_heads": 2,
    "vocab_size": 16,
    "max_position_embeddings": 8,
}


HIERA = {
    "hidden_size": 8,
    "image_size": [64, 64],
    "window_positional_embedding_background_size": [4, 4],
    "blocks_per_stage": [1, 1, 2, 1],
    "embed_dim_per_stage": [8, 16, 32, 64],
    "num_attention_heads_per_stage": [1, 2, 4, 8],
    "window_size_per_stage": [4, 2, 4, 2],
    "global_attention_blocks": [3],
}


SAM2_VISION = {
    "backbone_config": {"model_type": "sam2_hiera_det_model", **HIERA},
    "backbone_channel_list": [64, 32, 16, 8],
    "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]],
    "fpn_hidden_size": 8,
}


SAM_DECODER = {"hidden_size": 8, "mlp_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2}


def _dinov2() -> Any:
    config = {key: value for key, value in VISION.items() if key != "intermediate_size"}
    return transformers.Dinov2Model(transformers.Dinov2Config(**config, mlp_ratio=2))


def _registers() -> Any:
    config = {key: value for key, value in VISION.items() if key != "intermediate_size"}
    config = transformers.Dinov2WithRegistersConfig(**config, mlp_ratio=2, num_register_tokens=3)
    return transformers.Dinov2WithRegistersModel(config)


def _dinov3() -> Any:
    return transformers.DINOv3ViTModel(transformers.DINOv3ViTConfig(**VISION, num_register_tokens=3))


def _clip() -> Any:
    return transformers.CLIPModel(transformers.CLIPConfig(text_config=TEXT, vision_config=VISION, projection_dim=8))


def _sam() -> Any:
    vision = {
        "hidden_size": 16,
        "output_channels": 8,
        "num_hidden_layers": 3,
        "num_attention_heads": 2,
        "image_size": 64,
        "patch_size": 16,
        "window_size": 2,
        "global_attn_indexes": [1],
        "mlp_dim": 32,
        "num_pos_feats": 4,
        "initializer_range": 0.2,
    }
    prompt = {"hidden_size": 8, "image_size": 64, "patch_size": 16, "image_embedding_size": 4, "mask_input_channels": 4}
    config = transformers.SamConfig(
        vision_config=vision,
        prompt_encoder_config=prompt,
        mask_decoder_config={**SAM_DECODER, "iou_head_hidden_dim": 8},
    )
    return transformers.SamModel(config)


def _sam2(kind: str = "Sam2") -> Any:
    config = getattr(transformers, f"{kind}Config")(
        vision_config=transformers.Sam2VisionConfig(**SAM2_VISION),
        prompt_encoder_config={"hidden_size": 8, "image_size": 64},
        mask_decoder_config={**SAM_DECODER, "iou_head_hidden_dim": 8},
    )
    return getattr(transformers, f"{kind}Model")(config)


def _beit() -> Any:
    return transformers.BeitModel(transformers.BeitConfig(**VISION, use_absolute_position_embeddings=True))


def _hidden(model: Any, images: torch.Tensor, block: int, **options: Any) -> torch.Tensor:
    return model(pixel_values=images, output_hidden_states=True, **options).hidden_states[block]


def _twin_backbone(kind: str) -> Callable[[Any, torch.Tensor, int], torch.Tensor]:
    def twin(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
        settings = {key: value for key, value in model.config.to_dict().items() if not key.startswith("out_")}
        config = model.config.__class__(**settings, out_indices=[block])
        backbone = getattr(transformers, kind)(config).eval()
        names = backbone.load_state_dict(model.state_dict(), strict=False)
        assert not names.missing_keys
        return backbone(images).feature_maps[0].flatten(2).transpose(1, 2)

    return twin


def _twin_clip(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    vision = model.vision_model
    return vision.post_layernorm(_hidden(vision, images, block, interpolate_pos_encoding=True))[:, 1:]


def _twin_sam(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    encoder = model.vision_encoder
    states = encoder(images, output_hidden_states=True).hidden_states
    return encoder.neck(states[block]).flatten(2).transpose(1, 2)


def _twin_sam2(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    backbone = model.vision_encoder.backbone
    caught: list[torch.Tensor] = []
    hook = backbone.blocks[block - 1].register_forward_hook(lambda module, given, result: caught.append(result))
    backbone(images)
    hook.remove()
    return caught[0].flatten(1, 2)


def _twin_beit(model: Any, images: torch.Tensor, block: int) -> torch.Tensor:
    hidden = _hidden(model, images, block)
    return model.layernorm(hidden)[:, 1:] if model.layernorm is not None else hidden[:, 1:]


@dataclass(frozen=True)
class Case:
    make: Callable[[], Any]
    twin: Callable[[Any, torch.Tensor, int], torch.Tensor]
    size: int = 48
    patch: int = 8
    dimension: int = 16
    block: int = 3
    early: int = 2
    early_patch: int = 8


CASES = {
    "dinov2": Case(_dinov2, _twin_backbone("Dinov2Backbone")),
    "dinov2-registers": Case(_registers, _twin_backbone("Dinov2WithRegistersBackbone"), 32),
    "dinov3": Case(_dinov3, _twin_backbone("DINOv3ViTBackbone")),
    "clip": Case(_clip, _twin_clip),
    "sam": Case(_sam, _twin_sam, 64, 16, 8, early_patch=16),
    "sam2": Case(_sam2, _twin_sam2, 96, 32, 64, 5, 2),
    "sam2-video": Case(lambda: _sam2("Sam2Video"), _twin_sam2, 96, 32, 64, 5, 2),
    "unknown": Case(_beit, _twin_beit, 32),
}


@dataclass(frozen=True)
class Saved:
    case: Case
    model: Any
    folder: Path


def pictures(count: int, size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, size, size, 3), dtype=np.uint8)


def normalized(encoder: Encoder, images: np.ndarray) -> torch.Tensor:
    """Return the input of the network, computed in NumPy."""
    mean = np.array(encoder._model.channels.mean)
    std = np.array(encoder._model.channels.std)
    values = (images.astype(np.float64) / 255 - mean) / std
    return torch.from_numpy(values.transpose(0, 3, 1, 2).astype(np.float32))


def tokens(encoder: Encoder) -> np.ndarray:
    """Return the tokens of one small picture."""
    return encoder.encode(pictures(1, 32))
