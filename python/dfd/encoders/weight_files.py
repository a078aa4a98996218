"""Weights of encoders, and their files in a folder saved by transformers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.encoders.known import ChannelStats

# torch takes seconds to import, and is not needed to find the files.
if TYPE_CHECKING:
    import torch

_WEIGHT_FILES = (
    "model.safetensors",
    "model.safetensors.index.json",
    "pytorch_model.bin",
    "pytorch_model.bin.index.json",
)


@dataclass(frozen=True)
class EncoderWeights:
    """Weights that were found but not loaded into a network: in `folder`, or already read as `tensors`, arrays by name.

    `fingerprint` changes when the weights do; `channels` are those that the weights come with.
    """

    config: dict[str, Any]
    source: str
    fingerprint: str
    folder: Path | None = None
    tensors: dict[str, Any] | None = field(default=None, repr=False)
    channels: ChannelStats | None = None


def folder_weights(folder: Path, *, source: str = "folder", fingerprint: str | None = None) -> EncoderWeights:
    """Return the weights in `folder`, a model saved in the form that transformers uses."""
    config = _read_json(folder / "config.json")
    if config is None:
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no config.json")
    if not isinstance(config.get("model_type"), str):
        raise ValueError(f"load_encoder: `encoder`: {folder / 'config.json'} does not say its `model_type`")
    files = list(weight_files(folder))
    missing = [file for file in files if not file.is_file()]
    if missing or not files:
        wanted = missing[0].name if missing else _WEIGHT_FILES[0]
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no {wanted}")
    return EncoderWeights(
        config=config,
        source=source,
        fingerprint=fingerprint or f"sha256:{_sha256(files)}",
        folder=folder,
        channels=_channels(_read_json(folder / "preprocessor_config.json") or {}),
    )


def weight_files(folder: Path) -> Iterator[Path]:
    """The files that hold the tensors, in the order of preference that transformers has."""
    for name in _WEIGHT_FILES:
        if (folder / name).is_file():
            if name.endswith(".index.json"):
                shards = (_read_json(folder / name) or {}).get("weight_map", {})
                yield from (folder / shard for shard in sorted(set(shards.values())))
            else:
                yield folder / name
            return


def read_tensors(weights: EncoderWeights) -> dict[str, torch.Tensor]:
    """Read the tensors by the names that they were saved with; OSError if a file cannot be read."""
    import torch

    if weights.tensors is not None:
        return {name: torch.from_numpy(values) for name, values in weights.tensors.items()}
    assert weights.folder is not None
    tensors: dict[str, torch.Tensor] = {}
    try:
        for file in weight_files(weights.folder):
            if file.suffix == ".safetensors":
                from safetensors.torch import load_file

                tensors |= load_file(file)
            else:
                tensors |= torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # safetensors, pickle and zip raise types of their own
        raise unreadable(weights, error) from error
    return tensors


def unreadable(weights: EncoderWeights, error: Exception) -> OSError:
    """The error to raise when reading `weights` failed with `error`."""
    reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    return OSError(f"load_encoder: `encoder`: the weights in {weights.folder} cannot be read: {reason}")


def _read_json(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        return None
    except (ValueError, OSError, RecursionError) as error:
        raise OSError(f"load_encoder: {path} cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise OSError(f"load_encoder: {path} cannot be read: it holds no JSON object")
    return content


def _channels(preprocessor: dict[str, Any]) -> ChannelStats | None:
    values = [preprocessor.get("image_mean"), preprocessor.get("image_std")]
    if not all(isinstance(value, list) and len(value) == 3 for value in values):
        return None
    mean, std = (tuple(float(channel) for channel in value) for value in values if value)
    return ChannelStats(mean, std)  # type: ignore[arg-type]


def _sha256(files: list[Path]) -> str:
    sha256 = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while piece := stream.read(1 << 22):
                sha256.update(piece)
    return sha256.hexdigest()
