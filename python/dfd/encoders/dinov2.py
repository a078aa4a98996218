"""DINOv2 in plain torch, so that it runs without transformers, which takes seconds to import.

Only patches that show part of the shape take part. More than half of a picture that a shape fills is background. Every
block attends from every patch to every other, but the tokens of the background are never read. Without them
DINOv2-small takes a third of the time. On labelled shapes the precision of the weights changes by 0.004 at most, up as
often as down.
Sources: Oquab et al., "DINOv2" (TMLR 2024); Darcet et al., "Vision transformers need registers" (ICLR 2024).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn.functional import gelu, interpolate, linear, scaled_dot_product_attention

from dfd.common import check
from dfd.encoders.vision_model import VisionModel
from dfd.encoders.weight_files import IMAGENET, EncoderWeights, check_fit, unreadable, weight_files

# Wider networks store global information in patches of the background (Darcet et al.). Without background patches they
# would store it in patches of the shape.
_WIDEST_WITHOUT_BACKGROUND = 768
# Maps the tensor names of older files, which the hub serves, to current names.
_RENAMED = {
    "attention.attention.query": "attention.q_proj",
    "attention.attention.key": "attention.k_proj",
    "attention.attention.value": "attention.v_proj",
    "attention.output.dense": "attention.o_proj",
}


class _Attention(nn.Module):
    def __init__(self, width: int, heads: int, bias: bool) -> None:
        super().__init__()
        self.heads = heads
        self.q_proj, self.k_proj, self.v_proj = (nn.Linear(width, width, bias=bias) for _ in range(3))
        self.o_proj = nn.Linear(width, width)

    def forward(self, tokens: Tensor, lengths: Sequence[int]) -> Tensor:
        def of_pictures(project: nn.Linear) -> Sequence[Tensor]:  # (1, heads, length, D / heads) each
            projected: Tensor = project(tokens)
            return torch.split(projected.view(1, len(tokens), self.heads, -1).transpose(1, 2), list(lengths), dim=2)

        pictures = zip(*map(of_pictures, (self.q_proj, self.k_proj, self.v_proj)), strict=True)
        mixed = torch.cat([scaled_dot_product_attention(*picture)[0].transpose(0, 1) for picture in pictures])
        return self.o_proj(mixed.flatten(1))


class _Perceptron(nn.Module):
    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(width, hidden), nn.Linear(hidden, width)

    def forward(self, tokens: Tensor) -> Tensor:
        return self.fc2(gelu(self.fc1(tokens)))


class _LayerScale(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.lambda1 = nn.Parameter(torch.ones(width))

    def forward(self, tokens: Tensor) -> Tensor:
        return tokens * self.lambda1


class _Layer(nn.Module):
    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        width, epsilon = config["hidden_size"], config["layer_norm_eps"]
        self.norm1, self.norm2 = (nn.LayerNorm(width, eps=epsilon) for _ in range(2))
        self.attention = _Attention(width, config["num_attention_heads"], config["qkv_bias"])
        self.mlp = _Perceptron(width, int(width * config["mlp_ratio"]))
        self.layer_scale1, self.layer_scale2 = _LayerScale(width), _LayerScale(width)

    def forward(self, tokens: Tensor, lengths: Sequence[int]) -> Tensor:
        tokens = tokens + self.layer_scale1(self.attention(self.norm1(tokens), lengths))
        return tokens + self.layer_scale2(self.mlp(self.norm2(tokens)))


class _Embeddings(nn.Module):
    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        width, patch = config["hidden_size"], config["patch_size"]
        self.cls_token = nn.Parameter(torch.zeros(1, 1, width))
        self.position_embeddings = nn.Parameter(torch.zeros(1, 1 + (config["image_size"] // patch) ** 2, width))
        self.patch_embeddings = nn.ModuleDict({"projection": nn.Conv2d(3, width, patch, patch)})


class Dinov2(nn.Module):
    """Runs the first `blocks` blocks of a DINOv2 and the LayerNorm after them, with transformers' parameter names.

    Images are batched without padding: one matrix (T, D) holds the tokens of all images. Only attention is computed for
    each image separately.
    """

    def __init__(self, config: Mapping[str, Any], blocks: int) -> None:
        super().__init__()
        self.patch = config["patch_size"]
        self.embeddings: Any = _Embeddings(config)
        self.encoder: Any = nn.ModuleDict({"layer": nn.ModuleList(_Layer(config) for _ in range(blocks))})
        self.layernorm = nn.LayerNorm(config["hidden_size"], eps=config["layer_norm_eps"])
        self._positions: dict[tuple[int, int], Tensor] = {}

    def forward(self, images: Tensor, patches: Tensor | None = None) -> Tensor:
        """Return tokens (n, h, w, D) of normalized images (n, 3, h · patch, w · patch), if given of `patches` only.

        `patches` (n, h, w), bool, selects the patches; tokens of the others are 0.
        """
        count, rows, columns = len(images), images.shape[2] // self.patch, images.shape[3] // self.patch
        if patches is None:
            patches = torch.ones(count, rows, columns, dtype=torch.bool, device=images.device)
        embeddings, projection = self.embeddings, self.embeddings.patch_embeddings["projection"]
        squares = images.reshape(count, 3, rows, self.patch, columns, self.patch).permute(0, 2, 4, 1, 3, 5)
        entering = linear(squares[patches].flatten(1), projection.weight.flatten(1), projection.bias)
        entering = entering + self._interpolated_positions(rows, columns).expand(count, -1, -1, -1)[patches]
        prefix = embeddings.cls_token[0] + embeddings.position_embeddings[0, :1]
        counts = patches.sum(dim=(1, 2)).tolist()
        lengths = [len(prefix) + each for each in counts]
        tokens = torch.cat([part for picture in torch.split(entering, counts) for part in (prefix, picture)])
        for layer in self.encoder["layer"]:
            tokens = layer(tokens, lengths)
        tokens = self.layernorm(tokens)
        result: Tensor = tokens.new_zeros(*patches.shape, tokens.shape[1])
        result[patches] = torch.cat([picture[len(prefix) :] for picture in torch.split(tokens, lengths)])
        return result

    def _interpolated_positions(self, rows: int, columns: int) -> Tensor:
        """Return the learned positions of rows · columns patches, (1, rows, columns, D)."""
        if (rows, columns) not in self._positions:
            table = self.embeddings.position_embeddings[:, 1:]
            side = round(table.shape[1] ** 0.5)
            maps = table.reshape(1, side, side, -1).permute(0, 3, 1, 2)
            if (rows, columns) != (side, side):  # the same interpolation as in transformers
                maps = interpolate(maps, (rows, columns), mode="bicubic")
            self._positions[rows, columns] = maps.permute(0, 2, 3, 1)
        return self._positions[rows, columns]


def build_dinov2(weights: EncoderWeights, block: int | None) -> VisionModel:
    """Return a network with `weights` of which `takes(config)` is true, cut off after `block`; None takes the last.

    Raises ValueError if the configuration is invalid, the block is out of range, or the tensors do not fit the
    configuration. Raises OSError if the file of weights cannot be read.
    """
    config = _checked(weights.config)
    depth, width, patch = config["num_hidden_layers"], config["hidden_size"], config["patch_size"]
    chosen = depth if block is None else check.whole("load_encoder", "block", block, minimum=1, maximum=depth)
    with torch.device("meta"):  # no memory is allocated: the parameters come from the weights
        network = Dinov2(config, chosen)
    wanted = network.state_dict()
    found = {name: tensor.float() for name, tensor in _tensors(weights).items() if name in wanted}
    wrong = [(name, each.shape, wanted[name].shape) for name, each in found.items() if each.shape != wanted[name].shape]
    check_fit(weights, wrong, wanted.keys() - found.keys())
    network.load_state_dict(found, assign=True)
    network.eval().requires_grad_(False)
    return VisionModel(
        network,
        network,
        dimension=width,
        patch=patch,
        step=patch,
        block=chosen,
        depth=depth,
        channels=weights.channels or IMAGENET,
        takes_patches=width <= _WIDEST_WITHOUT_BACKGROUND,
    )


def takes(config: Mapping[str, Any]) -> bool:
    """Return whether this module has the network: a DINOv2 without registers or the giant's gated perceptrons."""
    return config["model_type"] == "dinov2" and not config.get("use_swiglu_ffn")


def _checked(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of `Dinov2` with transformers' defaults; ValueError if they describe no such network."""
    sizes = {"hidden_size": 768, "num_hidden_layers": 12, "num_attention_heads": 12, "image_size": 224}
    sizes["patch_size"] = 14
    others = {"mlp_ratio": 4, "layer_norm_eps": 1e-6, "qkv_bias": True}
    config = {name: given.get(name, default) for name, default in (sizes | others).items()}
    wrong = [name for name in sizes if type(config[name]) is not int or config[name] < 1]
    wrong += [name for name in others if not isinstance(config[name], int | float)]
    if not wrong and config["hidden_size"] % config["num_attention_heads"]:
        wrong = ["num_attention_heads"]
    if given.get("hidden_act", "gelu") != "gelu":
        wrong.append("hidden_act")
    if wrong:
        raise ValueError(
            "load_encoder: `encoder`: its config.json is not a valid dinov2 model: "
            f"`{wrong[0]}` is {given.get(wrong[0])!r}"
        )
    return config


def _tensors(weights: EncoderWeights) -> dict[str, Tensor]:
    """Return the tensors under the current names of transformers, whichever version saved them."""
    if weights.tensors is not None:
        tensors = {name: torch.from_numpy(values) for name, values in weights.tensors.items()}
    else:
        assert weights.folder is not None
        try:
            tensors = {name: each for file in weight_files(weights.folder) for name, each in load_file(file).items()}
        except (OSError, SafetensorError) as error:
            raise unreadable(weights, error) from error
    return {_current_name(name): tensor for name, tensor in tensors.items()}


def _current_name(name: str) -> str:
    name = name.removeprefix("dinov2.")
    for old, new in _RENAMED.items():
        name = name.replace(f".{old}.", f".{new}.")
    return name
