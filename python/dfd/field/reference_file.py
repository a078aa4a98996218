"""Fields of the method's public reference implementation: its `final_encoder.pth` and the `.json` beside it.

The network is a list `mlp` whose entries are linear maps, ReLUs and LayerNorms; only those with parameters show in
the file, so their places tell the architecture: each hidden layer is a linear map at k and a LayerNorm at k + 2, with
the ReLU between them. Where the first linear map has no ReLU after it, it folds into the second one.
"""

from __future__ import annotations

import json
import os
import pickle
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from dfd.common.linear_algebra import Float32
from dfd.field.architecture import Architecture
from dfd.field.field_file import Content
from dfd.mesh.normalization import normalization

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh


def read_reference(path: str | os.PathLike[str], mesh: Mesh) -> Content:
    """Return the field in `path`, a `final_encoder.pth` with its `.json` beside it.

    It was distilled from `mesh`: the file does not hold the normalization, which brings the middle of the mesh's box to
    the origin and its longest side to [−1, 1].

    Raises OSError if one of the two files does not exist or cannot be read. Raises ValueError if they hold no such
    network, or one with positional encoding or without unit length, or hold anything but tensors: nothing in the file
    is ever executed.
    """
    config = _read_config(Path(path).with_suffix(".json"))
    if config.get("positional_encoding"):
        raise ValueError(
            f"Field.load: `path` {os.fspath(path)} is a network with positional encoding, which a field does not have: "
            "distill without it"
        )
    if config.get("normalizemlp") is False:
        raise ValueError(f"Field.load: `path` {os.fspath(path)} is a network whose features are not of unit length")
    try:
        linear, norms = _layers(_read_tensors(path))
        for name, found in (("width", linear[0][0].shape[0]), ("out_dim", linear[-1][0].shape[0])):
            if config.get(name, found) != found:
                raise ValueError(f"its .json says {name} {config[name]!r}, its tensors say {found}")
    except ValueError as error:
        raise ValueError(f"Field.load: `path` {os.fspath(path)}: {error}") from None

    center, scale = normalization(mesh)
    settings = {
        "encoder": str(config.get("model", "unknown")),
        **{f"reference_{name}": value for name, value in config.items() if isinstance(value, str | int | float)},
    }
    architecture = Architecture(linear[-1][0].shape[0], linear[0][0].shape[0], len(norms))
    parameters: dict[str, Float32] = {}
    for layers, stride in ((linear, 0), (norms, 2)):
        for layer, (weight, bias) in enumerate(layers):
            name = f"network.{3 * layer + stride}"
            parameters |= {f"{name}.weight": weight.float().numpy(), f"{name}.bias": bias.float().numpy()}
    return Content(architecture, parameters, center, scale, settings)


Pair = tuple[Tensor, Tensor]  # weight and bias


def _layers(tensors: Mapping[str, Tensor]) -> tuple[list[Pair], list[Pair]]:
    """The linear maps and the LayerNorms in their order, the first linear maps folded into one.

    Raises ValueError if the tensors are not those of such a network.
    """
    entries: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        matched = re.fullmatch(r"mlp\.(\d{1,6})\.(weight|bias)", name)
        if matched is None:
            raise ValueError(f"it must hold mlp.N.weight and mlp.N.bias, found {name}")
        entries.setdefault(int(matched[1]), {})[matched[2]] = tensor
    linear: list[tuple[int, Pair]] = []
    norms: list[tuple[int, Pair]] = []
    for place, entry in sorted(entries.items()):
        if entry.keys() != {"weight", "bias"}:
            raise ValueError(f"mlp.{place} must have a weight and a bias, found only a {next(iter(entry))}")
        weight, bias = entry["weight"].double(), entry["bias"].double()
        if weight.ndim not in (1, 2) or bias.shape != weight.shape[:1]:
            raise ValueError(f"mlp.{place} has a weight {tuple(weight.shape)} and a bias {tuple(bias.shape)}")
        if not (torch.isfinite(weight).all() and torch.isfinite(bias).all()):
            raise ValueError(f"mlp.{place} holds numbers that are not finite")
        (linear if weight.ndim == 2 else norms).append((place, (weight, bias)))

    start = 1 if len(linear) > 1 and linear[1][0] == 1 else 0
    places = [place for place, _ in linear[start:]]
    if (
        not norms
        or linear[0][0] != 0
        or places != [start + 3 * layer for layer in range(len(norms) + 1)]
        or [place for place, _ in norms] != [place + 2 for place in places[:-1]]
    ):
        raise ValueError("its layers must be linear maps, each but the last with a ReLU and a LayerNorm after it")
    width = norms[0][1][0].shape[0]
    shapes = [tuple(weight.shape) for _, (weight, _) in linear]
    wanted = [(width, 3), *[(width, width)] * (len(linear) - 2), (shapes[-1][0], width)]
    if shapes != wanted or shapes[-1][0] == 0 or any(weight.shape != (width,) for _, (weight, _) in norms):
        raise ValueError(f"its linear maps must be {wanted} with LayerNorms of {width}, found {shapes}")
    pairs = [pair for _, pair in linear]
    if start:
        (first, offset), (second, bias) = pairs[:2]
        pairs[:2] = [(second @ first, second @ offset + bias)]
    return pairs, [pair for _, pair in norms]


def _read_config(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise FileNotFoundError(f"Field.load: `path`: {path}, which belongs to the .pth file, does not exist")
    try:
        config = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise ValueError(f"Field.load: `path`: {path} is not JSON: {error}") from None
    if not isinstance(config, dict):
        raise ValueError(f"Field.load: `path`: {path} must hold a JSON object, got {type(config).__name__}")
    return config


def _read_tensors(path: str | os.PathLike[str]) -> dict[str, Tensor]:
    """The tensors of the file, read by torch's own reader that builds tensors and plain containers only."""
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:
        raise ValueError("it holds more than tensors, or no tensors, and is not opened") from None
    except OSError:
        raise
    except Exception as error:  # a damaged archive or pickle fails in many ways
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise ValueError(f"it cannot be read: {reason}") from None
    if not isinstance(state, Mapping) or not state:
        raise ValueError(f"it must hold named tensors, got {type(state).__name__}")
    for name, tensor in state.items():
        if not isinstance(name, str) or not isinstance(tensor, Tensor) or not tensor.is_floating_point():
            raise ValueError(f"it must hold named tensors of floats, got {name!r}")
    return dict(state)
