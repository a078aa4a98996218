"""Read an encoder's configuration, and find its weights, in a folder that transformers saved."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from dfd.common.errors import ArgumentError
from dfd.common.files import sha256_of_files

SETTINGS = ("config.json", "preprocessor_config.json")
_SINGLE, _INDEX = "model.safetensors", "model.safetensors.index.json"  # one file; or an index of several files


class ChannelStats(NamedTuple):
    """Mean and standard deviation of red, green and blue, by which images with values in [0, 1] are normalized."""

    mean: tuple[float, ...]
    std: tuple[float, ...]


IMAGENET = ChannelStats((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))


@dataclass(frozen=True)
class EncoderWeights:
    """Weights of a network: either `folder` contains their files, or `tensors` maps their names to arrays.

    `fingerprint` identifies the weights and their settings. `channels` is None if no file defines mean and deviation.
    """

    config: dict[str, Any]
    source: str
    fingerprint: str
    folder: Path | None = None
    tensors: dict[str, Any] | None = field(default=None, repr=False)
    channels: ChannelStats | None = None


def folder_weights(folder: Path, *, source: str = "folder", fingerprint: str | None = None) -> EncoderWeights:
    """Return the weights in `folder`, which transformers saved.

    Raises ValueError if config.json has no model type. Raises OSError if a file is missing or cannot be read.
    """
    config = _read_json(folder / "config.json")
    if config is None:
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no config.json")
    if not isinstance(config.get("model_type"), str):
        raise ArgumentError("encoder", f"must have a config.json with a `model_type`, got none in {folder}")
    files = weight_files(folder)
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no {missing[0]}")
    files += [folder / name for name in SETTINGS if (folder / name).is_file()]
    preprocessor = _read_json(folder / "preprocessor_config.json") or {}
    values = [preprocessor.get("image_mean"), preprocessor.get("image_std")]
    known = all(isinstance(value, list) and len(value) == 3 for value in values)
    channels = ChannelStats(*(tuple(map(float, value)) for value in values if value)) if known else None
    fingerprint = fingerprint or f"sha256:{sha256_of_files(*files)}"
    return EncoderWeights(config, source, fingerprint, folder, channels=channels)


def weight_files(folder: Path) -> list[Path]:
    """Return the paths of the tensor files in `folder`: one file, or all files in an index. Files may be missing."""
    index = {} if (folder / _SINGLE).is_file() else _read_json(folder / _INDEX) or {}
    return [folder / name for name in sorted(set(index.get("weight_map", {}).values())) or [_SINGLE]]


def unreadable(weights: EncoderWeights, error: Exception) -> OSError:
    """Return the error to raise if reading `weights` failed with `error`."""
    reason = (str(error).strip() or type(error).__name__).splitlines()[0]
    return OSError(f"load_encoder: `encoder`: the weights in {weights.folder} cannot be read: {reason}")


def check_fit(
    weights: EncoderWeights, wrong: Iterable[tuple[str, Sequence[int], Sequence[int]]], missing: Iterable[str]
) -> None:
    """Raise ValueError if tensors have `wrong` array shapes (each: name, found, required), or if any are `missing`."""
    for name, found, wanted in sorted(wrong):
        raise ArgumentError("encoder", f"must have {name} of shape {tuple(wanted)}, got {tuple(found)}")
    lacking = sorted(missing)
    if lacking:
        kind = weights.config["model_type"]
        raise ArgumentError("encoder", f"lacks {len(lacking)} tensors of a {kind} model, such as {lacking[0]}")


def _read_json(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        return None
    except (ValueError, OSError, RecursionError) as error:
        raise OSError(f"load_encoder: {path} cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise OSError(f"load_encoder: {path} cannot be read: it contains no JSON object")
    return content
