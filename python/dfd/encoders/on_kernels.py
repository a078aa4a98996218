"""DINOv2 by our own kernels: on a processor it takes half of torch's time, and torch need not be loaded.

What the kernels do not know (other families, widths, forms of files) torch does; `dfd.encoders.on_torch`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from dfd import _core
from dfd.common.sharing import share
from dfd.common.threads import one_blas_thread
from dfd.encoders.patches import foreground_patches
from dfd.encoders.presets import IMAGENET, ChannelStats
from dfd.encoders.weight_files import Weights

__all__ = ["KernelNetwork", "kernel_network"]

Array = NDArray[np.float32]

# What the kernels take together; DINOv2's networks have heads of 64 and widths that are multiples of it.
_HEAD = 64
# Settings of a network without the parts that they name, and with the one nonlinearity that the kernels have.
_PLAIN = {
    "hidden_act": "gelu",
    "qkv_bias": True,
    "use_swiglu_ffn": False,
    "num_channels": 3,
    "drop_path_rate": 0.0,
}
_LARGEST_ALONE = 768  # see `dfd.encoders.families`: larger networks need the background
_CUBIC = -0.75  # of the cubic convolution that torch interpolates with (Keys 1981)


class KernelNetwork:
    """A DINOv2 cut off after `block`; see `dfd.encoders.encode.Network`."""

    fixed_size: int | None = None

    def __init__(
        self,
        tensors: dict[str, Array],
        config: dict[str, Any],
        block: int,
        channels: ChannelStats,
        *,
        background: bool,
    ) -> None:
        self.patch = self.step = int(config["patch_size"])
        self.depth = int(config["num_hidden_layers"])
        self.block, self.channels = block, channels
        self.dimension = int(config["hidden_size"])
        self.takes_patches = self.dimension <= _LARGEST_ALONE and not background
        heads = int(config["num_attention_heads"])
        layers = [_layer(tensors, f"encoder.layer.{number}.", heads) for number in range(block)]
        self._transformer = _core.Transformer(
            [matrix for matrices, _ in layers for matrix in matrices],
            [*(vector for _, vectors in layers for vector in vectors), *_norm(tensors, "layernorm")],
            heads,
            float(config.get("layer_norm_eps", 1e-6)),
        )
        # Bytes of a picture's channels, c / 255 less the mean over the deviation, as part of the first linear map.
        mean, std = (np.array(values, np.float64) for values in (channels.mean, channels.std))
        kernel = tensors["embeddings.patch_embeddings.projection.weight"].astype(np.float64).transpose(2, 3, 1, 0)
        bias = tensors["embeddings.patch_embeddings.projection.bias"] - np.einsum("yxcd,c->d", kernel, mean / std)
        kernel = (kernel / (255 * std)[:, None]).reshape(-1, self.dimension)
        self._kernel, self._bias = kernel.astype(np.float32), bias.astype(np.float32)
        self._first: Array = tensors["embeddings.cls_token"][0]
        self._table: Array = tensors["embeddings.position_embeddings"][0]
        self._positions = cache(self._interpolated)

    def share(self, count: int, resolution: int, fill: Callable[[int, int], None]) -> None:
        """See `dfd.encoders.encode.Network`: one for each thread at a time."""
        with one_blas_thread():
            share(count, 1, fill)

    def tokens(self, images: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> Array:
        """See `dfd.encoders.encode.Network`."""
        side = images.shape[1] // self.patch
        result = np.zeros((len(images), side * side, self.dimension), np.float32)
        for number, image in enumerate(images):
            looked_at = np.ones((side, side), bool)
            if covered is not None and self.takes_patches:
                looked_at = foreground_patches(covered[number], side)
            result[number, looked_at.ravel()] = self._of_patches(image, looked_at)
        return result.reshape(len(images), side, side, self.dimension)

    def _of_patches(self, image: NDArray[np.uint8], looked_at: NDArray[np.bool_]) -> Array:
        """Tokens of the patches that are looked at, (number of them, D)."""
        side, patch = len(looked_at), self.patch
        pixels = image[: side * patch, : side * patch].reshape(side, patch, side, patch, 3).swapaxes(1, 2)[looked_at]
        positions = self._positions(side)
        entering: Array = np.concatenate(
            [self._first, pixels.reshape(len(pixels), 3 * patch * patch).astype(np.float32) @ self._kernel]
        )
        entering[1:] += self._bias
        entering[:1] += positions[:1]
        entering[1:] += positions[1:][looked_at.ravel()]
        leaving = np.empty_like(entering)
        self._transformer.run(entering, leaving)
        tokens: Array = leaving[1:]
        return tokens

    def _interpolated(self, side: int) -> Array:
        """The table of positions for side · side patches after the class token, (1 + side · side, D)."""
        known = round((len(self._table) - 1) ** 0.5)
        if side == known:
            return self._table
        places = self._table[1:].reshape(known, known, -1).astype(np.float64)
        between = _cubic(known, side)
        places = np.einsum("yi,xj,ijd->yxd", between, between, places, optimize=True)
        return np.concatenate([self._table[:1], places.reshape(side * side, -1).astype(np.float32)])


def kernel_network(
    weights: Weights, block: int | None, channels: ChannelStats | None, *, background: bool
) -> KernelNetwork | None:
    """Return the network that `weights` are, or None where the kernels do not know it or anything is odd about it.

    `block` and `channels` as for `dfd.encoders.families.build`, which says what is wrong where something is.
    """
    if _core.instruction_set() == "baseline":  # torch knows other processors better
        return None
    config = weights.config
    plain = all(config.get(name, value) == value for name, value in _PLAIN.items())
    if config.get("model_type") != "dinov2" or not plain:
        return None
    block = config.get("num_hidden_layers") if block is None else block
    if type(block) is not int:
        return None
    try:
        tensors = _tensors(weights)
        if not _fit(tensors, config, block):
            return None
    except (OSError, KeyError, TypeError, ValueError, SafetensorError):
        return None
    channels = weights.channels or channels or IMAGENET
    return KernelNetwork(tensors, config, block, channels, background=background)


def _tensors(weights: Weights) -> dict[str, Array]:
    """The tensors, by the names that DINOv2 has on the hub."""
    found = weights.tensors
    if found is None:
        assert weights.folder is not None
        found = safetensors.numpy.load_file(Path(weights.folder) / "model.safetensors")
    return {_hub_name(name): values for name, values in found.items()}


def _hub_name(name: str) -> str:
    """The name on the hub of a tensor that transformers 5 has saved."""
    name = name.removeprefix("dinov2.").replace(".attention.o_proj.", ".attention.output.dense.")
    for short, long in (("q", "query"), ("k", "key"), ("v", "value")):
        name = name.replace(f".attention.{short}_proj.", f".attention.attention.{long}.")
    return name


def _fit(tensors: dict[str, Array], config: dict[str, Any], block: int) -> bool:
    """Whether the tensors are those of the configuration, and of widths that the kernels take."""
    width, depth = int(config["hidden_size"]), int(config["num_hidden_layers"])
    hidden, patch = int(width * config.get("mlp_ratio", 4)), int(config["patch_size"])
    places = (int(config["image_size"]) // patch) ** 2
    if width != _HEAD * int(config["num_attention_heads"]) or hidden % _HEAD or not 1 <= block <= depth:
        return False
    wanted: dict[str, tuple[int, ...]] = {
        "embeddings.cls_token": (1, 1, width),
        "embeddings.position_embeddings": (1, 1 + places, width),
        "embeddings.patch_embeddings.projection.weight": (width, 3, patch, patch),
        "embeddings.patch_embeddings.projection.bias": (width,),
        "layernorm.weight": (width,),
        "layernorm.bias": (width,),
    }
    linear = {f"attention.attention.{name}": (width, width) for name in ("query", "key", "value")}
    linear |= {"attention.output.dense": (width, width), "mlp.fc1": (hidden, width), "mlp.fc2": (width, hidden)}
    for number in range(block):
        layer = f"encoder.layer.{number}."
        for name, shape in linear.items():
            wanted |= {f"{layer}{name}.weight": shape, f"{layer}{name}.bias": shape[:1]}
        for name in ("norm1.weight", "norm1.bias", "norm2.weight", "norm2.bias"):
            wanted[layer + name] = (width,)
        wanted |= {f"{layer}layer_scale{half}.lambda1": (width,) for half in (1, 2)}
    return all(name in tensors and tensors[name].shape == shape for name, shape in wanted.items()) and all(
        tensors[name].dtype == np.float32 for name in wanted
    )


def _layer(tensors: dict[str, Array], name: str, heads: int) -> tuple[list[Array], list[Array]]:
    """The matrices and vectors of one block, as the kernels take them: what scales is multiplied into them."""

    def linear(inside: str) -> tuple[Array, Array]:
        return tensors[f"{name}{inside}.weight"], tensors[f"{name}{inside}.bias"]

    def scaled(pair: tuple[Array, Array], factor: Any) -> tuple[Array, Array]:
        return pair[0] * np.reshape(factor, (-1, 1)).astype(np.float32), pair[1] * np.float32(factor)

    query, key, value = (linear(f"attention.attention.{which}") for which in ("query", "key", "value"))
    query = scaled(query, (query[0].shape[0] // heads) ** -0.5)
    mix = scaled(linear("attention.output.dense"), tensors[f"{name}layer_scale1.lambda1"])
    narrow = scaled(linear("mlp.fc2"), tensors[f"{name}layer_scale2.lambda1"])
    widen = linear("mlp.fc1")
    project = [np.concatenate(parts) for parts in zip(query, key, value, strict=True)]
    matrices = [project[0], mix[0], widen[0], narrow[0]]
    vectors = [project[1], mix[1], widen[1], narrow[1]]
    return matrices, [*vectors, *_norm(tensors, f"{name}norm1"), *_norm(tensors, f"{name}norm2")]


def _norm(tensors: dict[str, Array], name: str) -> Iterator[Array]:
    yield tensors[f"{name}.weight"]
    yield tensors[f"{name}.bias"]


def _cubic(known: int, wanted: int) -> NDArray[np.float64]:
    """The matrix (wanted, known) that interpolates values along a line, cell by cell, by cubic convolution."""
    at = (np.arange(wanted) + 0.5) * known / wanted - 0.5
    matrix = np.zeros((wanted, known))
    for step in range(-1, 3):
        place = np.floor(at) + step
        away = np.abs(at - place)
        near = ((_CUBIC + 2) * away - (_CUBIC + 3)) * away**2 + 1
        far = _CUBIC * (((away - 5) * away + 8) * away - 4)
        share = np.where(away <= 1, near, far)
        np.add.at(matrix, (np.arange(wanted), place.clip(0, known - 1).astype(int)), share)
    return matrix
