"""Run DINOv2 in plain torch, without the package transformers, which takes seconds to import.

A token is the feature vector of one square patch of an image. More than half of the patches of a picture show only
background, and can be left out. Without them, DINOv2-small takes a third of the time. The tokens of the remaining
patches change slightly, because attention relates each patch to all others.
Sources: Oquab et al., "DINOv2" (TMLR 2024); Darcet et al., "Vision transformers need registers" (ICLR 2024).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn
from torch.nn.functional import gelu, interpolate, linear, scaled_dot_product_attention

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.encoders.vision_model import VisionModel
from dfd.encoders.weight_files import IMAGENET, EncoderWeights, check_fit, unreadable, weight_files

# Largest token dimension D of a network that skips background. Wider networks store global information in the tokens
# of background patches (Darcet et al.). Without them, tokens of the shape would store this information.
_WIDEST_WITHOUT_BACKGROUND = 768
# Old parts of tensor names, and the current parts. Files from older versions of transformers have the old names.
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
        def by_image(project: nn.Linear) -> Sequence[Tensor]:  # (1, heads, tokens, D / heads) for each image
            projected: Tensor = project(tokens)
            return torch.split(projected.view(1, len(tokens), self.heads, -1).transpose(1, 2), list(lengths), dim=2)

        images = zip(*map(by_image, (self.q_proj, self.k_proj, self.v_proj)), strict=True)
        mixed = torch.cat([scaled_dot_product_attention(*image)[0].transpose(0, 1) for image in images])
        return self.o_proj(mixed.flatten(1))


class _Layer(nn.Module):
    def __init__(self, config: Mapping[str, Any]) -> None:
        super().__init__()
        width, epsilon = config["hidden_size"], config["layer_norm_eps"]
        hidden = int(width * config["mlp_ratio"])
        self.norm1, self.norm2 = (nn.LayerNorm(width, eps=epsilon) for _ in range(2))
        self.attention = _Attention(width, config["num_attention_heads"], config["qkv_bias"])
        self.mlp = nn.ModuleDict({"fc1": nn.Linear(width, hidden), "fc2": nn.Linear(hidden, width)})
        self.layer_scale1, self.layer_scale2 = (nn.ParameterDict({"lambda1": torch.ones(width)}) for _ in range(2))

    def forward(self, tokens: Tensor, lengths: Sequence[int]) -> Tensor:
        tokens = tokens + self.attention(self.norm1(tokens), lengths) * self.layer_scale1["lambda1"]
        hidden = gelu(self.mlp["fc1"](self.norm2(tokens)))
        return tokens + self.mlp["fc2"](hidden) * self.layer_scale2["lambda1"]


class Dinov2(nn.Module):
    """The first `blocks` blocks of a DINOv2 and its final LayerNorm. Parameters have the same names as in transformers.

    Images are batched without padding: one matrix (T, D) holds the T tokens of all images. Attention is computed for
    each image separately.
    """

    def __init__(self, config: Mapping[str, Any], blocks: int) -> None:
        super().__init__()
        self.patch, width = config["patch_size"], config["hidden_size"]
        self.embeddings: Any = nn.ParameterDict(
            {
                "cls_token": torch.zeros(1, 1, width),
                "position_embeddings": torch.zeros(1, 1 + (config["image_size"] // self.patch) ** 2, width),
            }
        )
        self.embeddings.patch_embeddings = nn.ModuleDict({"projection": nn.Conv2d(3, width, self.patch, self.patch)})
        self.encoder: Any = nn.ModuleDict({"layer": nn.ModuleList(_Layer(config) for _ in range(blocks))})
        self.layernorm = nn.LayerNorm(width, eps=config["layer_norm_eps"])
        self._positions: dict[tuple[int, int], Tensor] = {}

    def forward(self, images: Tensor, patches: Tensor | None = None) -> Tensor:
        """Return the tokens (n, h, w, D) of normalized images (n, 3, h · patch, w · patch).

        `patches` (n, h, w), bool, selects the patches to encode; all other tokens are 0. None encodes all patches.
        """
        count, rows, columns = len(images), images.shape[2] // self.patch, images.shape[3] // self.patch
        if patches is None:
            patches = torch.ones(count, rows, columns, dtype=torch.bool, device=images.device)
        embeddings, projection = self.embeddings, self.embeddings.patch_embeddings["projection"]
        squares = images.reshape(count, 3, rows, self.patch, columns, self.patch).permute(0, 2, 4, 1, 3, 5)
        embedded = linear(squares[patches].flatten(1), projection.weight.flatten(1), projection.bias)
        embedded = embedded + self._interpolated_positions(rows, columns).expand(count, -1, -1, -1)[patches]
        class_token = embeddings.cls_token[0] + embeddings.position_embeddings[0, :1]
        counts = patches.sum(dim=(1, 2)).tolist()
        lengths = [1 + each for each in counts]
        tokens = torch.cat([part for image in torch.split(embedded, counts) for part in (class_token, image)])
        for layer in self.encoder["layer"]:
            tokens = layer(tokens, lengths)
        tokens = self.layernorm(tokens)
        result: Tensor = tokens.new_zeros(*patches.shape, tokens.shape[1])
        result[patches] = torch.cat([image[1:] for image in torch.split(tokens, lengths)])
        return result

    def _interpolated_positions(self, rows: int, columns: int) -> Tensor:
        """Return the learned position embeddings (1, rows, columns, D), interpolated to this grid of patches."""
        if (rows, columns) not in self._positions:
            table = self.embeddings.position_embeddings[:, 1:]
            side = round(table.shape[1] ** 0.5)
            maps = table.reshape(1, side, side, -1).permute(0, 3, 1, 2)
            if (rows, columns) != (side, side):  # the same interpolation as in transformers
                maps = interpolate(maps, (rows, columns), mode="bicubic")
            self._positions[rows, columns] = maps.permute(0, 2, 3, 1)
        return self._positions[rows, columns]


def build_dinov2(weights: EncoderWeights, block: int | None) -> VisionModel:
    """Return a DINOv2 with `weights` that consists of the first `block` blocks; None keeps all blocks.

    Call this function only if `takes(weights.config)` is True. Raises ValueError if the configuration is invalid, the
    block is out of range, or tensors do not fit the configuration. Raises OSError if a weight file cannot be read.
    """
    config = _checked(weights.config)
    depth, width, patch = config["num_hidden_layers"], config["hidden_size"], config["patch_size"]
    chosen = depth if block is None else check.whole(None, "block", block, minimum=1, maximum=depth)
    with torch.device("meta"):  # allocates no memory: `load_state_dict` below replaces all parameters
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
    """Return whether `Dinov2` can run the network: it must be a DINOv2 without registers and without gated MLPs."""
    return config["model_type"] == "dinov2" and not config.get("use_swiglu_ffn")


def _checked(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration for `Dinov2`, completed by transformers' defaults; ValueError if a value is invalid."""
    sizes = {"hidden_size": 768, "num_hidden_layers": 12, "num_attention_heads": 12}
    sizes |= {"image_size": 224, "patch_size": 14}
    others = {"mlp_ratio": 4, "layer_norm_eps": 1e-6, "qkv_bias": True}
    config = {name: given.get(name, default) for name, default in (sizes | others).items()}
    wrong = [name for name in sizes if type(config[name]) is not int or config[name] < 1]
    wrong += [name for name in others if not isinstance(config[name], int | float)]
    if not wrong and config["hidden_size"] % config["num_attention_heads"]:
        wrong = ["num_attention_heads"]
    if given.get("hidden_act", "gelu") != "gelu":
        wrong.append("hidden_act")
    if wrong:
        found = f"`{wrong[0]}`: {given.get(wrong[0])!r}"
        raise ArgumentError("encoder", f"must have a valid config.json of a dinov2 model, got {found}")
    return config


def _tensors(weights: EncoderWeights) -> dict[str, Tensor]:
    """Return the tensors of `weights` by their current names in transformers."""
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
