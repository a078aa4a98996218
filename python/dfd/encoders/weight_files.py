"""Weights that lie in a folder, in the form that transformers saves."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dfd.encoders.presets import ChannelStats

__all__ = ["MANIFEST", "WEIGHT_FILES", "Weights", "folder_weights", "weight_files"]

# Beside the weights, where dfd put them there: where they come from, their hash, and the block to use.
MANIFEST = "dfd.json"

WEIGHT_FILES = (
    "model.safetensors",
    "model.safetensors.index.json",
    "pytorch_model.bin",
    "pytorch_model.bin.index.json",
)


@dataclass(frozen=True)
class Weights:
    """Weights that were found, not yet put into a model: in `folder`, or at hand as `tensors`,
    arrays by name.

    `fingerprint` changes when the weights do; `block` is the block to use, counted from 1, where the source knows.
    """

    config: dict[str, Any]
    source: str
    fingerprint: str
    folder: Path | None = None
    tensors: dict[str, Any] | None = field(default=None, repr=False)
    block: int | None = None
    channels: ChannelStats | None = None


def folder_weights(folder: Path, *, source: str | None = None, fingerprint: str | None = None) -> Weights:
    """Return the weights in `folder`, a model saved in the form that transformers uses."""
    config = _read_json(folder / "config.json")
    if config is None:
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no config.json")
    if not isinstance(config.get("model_type"), str):
        raise ValueError(f"load_encoder: `encoder`: {folder / 'config.json'} does not say its `model_type`")
    files = list(weight_files(folder))
    missing = [file for file in files if not file.is_file()]
    if missing or not files:
        wanted = missing[0].name if missing else WEIGHT_FILES[0]
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no {wanted}")
    manifest = _read_json(folder / MANIFEST) or {}
    block = manifest.get("block")
    return Weights(
        config=config,
        source=source or str(manifest.get("source") or "folder"),
        fingerprint=fingerprint or f"sha256:{_sha256(files)}",
        folder=folder,
        block=block if isinstance(block, int) else None,
        channels=_channels(_read_json(folder / "preprocessor_config.json") or {}),
    )


def weight_files(folder: Path) -> Iterator[Path]:
    """The files that hold the tensors, in the order of preference that transformers has."""
    for name in WEIGHT_FILES:
        if (folder / name).is_file():
            if name.endswith(".index.json"):
                shards = (_read_json(folder / name) or {}).get("weight_map", {})
                yield from (folder / shard for shard in sorted(set(shards.values())))
            else:
                yield folder / name
            return


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
