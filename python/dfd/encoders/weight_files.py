"""Weights of encoders, and their files in a folder that transformers saved."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from dfd.common.files import sha256_of_files

SETTINGS = ("config.json", "preprocessor_config.json")
_WHOLE, _INDEX = "model.safetensors", "model.safetensors.index.json"  # one file, or the index of several files


class ChannelStats(NamedTuple):
    """Mean and standard deviation of each channel (red, green, blue) of a network's training images.

    The encoder uses them to bring images in [0, 1] to mean 0 and deviation 1.
    """

    mean: tuple[float, ...]
    std: tuple[float, ...]


IMAGENET = ChannelStats((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))


@dataclass(frozen=True)
class EncoderWeights:
    """Weights that are not loaded into a network yet: in `folder`, or already read as `tensors`, arrays by name.

    `fingerprint` changes when the weights or their settings change. `channels` are those that come with the weights.
    """

    config: dict[str, Any]
    source: str
    fingerprint: str
    folder: Path | None = None
    tensors: dict[str, Any] | None = field(default=None, repr=False)
    channels: ChannelStats | None = None


def folder_weights(folder: Path, *, source: str = "folder", fingerprint: str | None = None) -> EncoderWeights:
    """Return the weights in `folder`, a model in the form that transformers uses.

    Raises ValueError if the folder names no type of model. Raises OSError if a file is missing or cannot be read.
    """
    config = _read_json(folder / "config.json")
    if config is None:
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no config.json")
    if not isinstance(config.get("model_type"), str):
        raise ValueError(f"load_encoder: `encoder`: {folder / 'config.json'} does not say its `model_type`")
    files = weight_files(folder)
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no {missing[0]}")
    files += [folder / name for name in SETTINGS if (folder / name).is_file()]
    return EncoderWeights(
        config=config,
        source=source,
        fingerprint=fingerprint or f"sha256:{sha256_of_files(*files)}",
        folder=folder,
        channels=_channels(_read_json(folder / "preprocessor_config.json") or {}),
    )


def weight_files(folder: Path) -> list[Path]:
    """Return the files that hold the tensors: one, or those in an index. The files need not exist."""
    index = {} if (folder / _WHOLE).is_file() else _read_json(folder / _INDEX) or {}
    return [folder / name for name in sorted(set(index.get("weight_map", {}).values())) or [_WHOLE]]


def unreadable(weights: EncoderWeights, error: Exception) -> OSError:
    """Return the error to raise when reading `weights` failed with `error`."""
    reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
    return OSError(f"load_encoder: `encoder`: the weights in {weights.folder} cannot be read: {reason}")


def check_fit(
    weights: EncoderWeights, wrong: Iterable[tuple[str, Sequence[int], Sequence[int]]], missing: Iterable[str]
) -> None:
    """Raise ValueError if tensors have `wrong` shapes (name, found, wanted), or some are `missing`."""
    for name, found, wanted in sorted(wrong):
        raise ValueError(
            f"load_encoder: `encoder`: the tensor {name} has shape {tuple(found)}, "
            f"its config.json asks for {tuple(wanted)}"
        )
    lacking = sorted(missing)
    if lacking:
        raise ValueError(
            f"load_encoder: `encoder`: the weights lack {len(lacking)} tensors of a {weights.config['model_type']} "
            f"model, such as {lacking[0]}"
        )


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
    return ChannelStats(*(tuple(map(float, value)) for value in values if value))
