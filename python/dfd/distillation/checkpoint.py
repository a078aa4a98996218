"""The encoder's tokens so far in a folder, so that an interrupted distillation resumes at the next picture.

The folder holds the run's cache key and the tokens of each picture; the fit takes seconds and is restarted. A token
file is named by a hash of its input and begins with a hash of its content, so damaged or foreign files are never used.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import threading
from collections.abc import Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy
from safetensors import SafetensorError

from dfd.common.check import warn
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Bool, Float32, UInt8
from dfd.field.cache_key import difference, hash_arrays, hash_key

_HASH = 32  # bytes of SHA-256 before the content
_TOKENS = "tokens"  # the array's name in a file
_KEY = "recipe.json"
# Includes unfinished files of a killed run, and the fit's state of older versions. The key is removed last, because it
# marks the folder as ours.
_FILES = ("tokens-*", ".tokens-*", "fit-*", ".fit-*", ".recipe.*.json", _KEY)


class Checkpoint:
    """The folder of one run; it is also the store of its encoder's tokens (`dfd.encoders.encode.TokenStore`).

    Parameters
    ----------
    folder
        Created if missing; emptied with a warning if it belongs to a run with another key.
    key
        Everything that the result depends on, see `dfd.field.cache_key`.

    Raises ValueError if the folder holds other files. Raises OSError if it cannot be created or written.
    """

    def __init__(self, folder: str | os.PathLike[str], key: Mapping[str, Any]) -> None:
        self.folder = Path(folder)
        self._key = hash_key(key)
        self._has_tokens = self._warned = False
        self._warning = threading.Lock()  # tokens are written on another thread
        if self.folder.exists() and not self.folder.is_dir():
            raise NotADirectoryError(f"distill: `checkpoint` must be a folder, but {self.folder} is a file")
        if not self.folder.parent.is_dir():
            raise FileNotFoundError(f"distill: `checkpoint`: the folder {self.folder.parent} does not exist")
        before = _read_key(self.folder)
        if before is None and not self._is_ours():
            raise ValueError(f"distill: `checkpoint` must be a new folder or one of an earlier run, got {self.folder}")
        if before == dict(key):
            self._has_tokens = any(self.folder.glob("tokens-*"))
            return
        if before is not None:
            found = f"was made with other settings ({difference(before, key)})"
            warn(f"distill: {self.folder} {found}: the run is restarted", UserWarning)
        elif (self.folder / _KEY).exists():
            warn(f"distill: {self.folder / _KEY} is damaged: the run is restarted", UserWarning)
        self._remove_files()
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OSError(
                error.errno, f"distill: `checkpoint`: {self.folder} cannot be made: {error.strerror}"
            ) from error
        with atomic_write(self.folder / _KEY, "checkpoint") as temporary:
            temporary.write_text(json.dumps(dict(key), indent=2, sort_keys=True), "utf-8")

    @staticmethod
    def discard(folder: str | os.PathLike[str], key: Mapping[str, Any]) -> None:
        """Remove the files of an earlier run of `key` from `folder`; other files stay."""
        if _read_key(Path(folder)) == dict(key):
            Checkpoint(folder, key).remove()

    def read_tokens(self, image: UInt8, covered: Bool | None) -> Float32 | None:
        """See `dfd.encoders.encode.TokenStore`."""
        if not self._has_tokens:  # saves hashing the image
            return None
        path = self._path(image, covered)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        if content == with_hash(path.name, content[_HASH:]):
            with contextlib.suppress(SafetensorError):
                tokens = safetensors.numpy.load(content[_HASH:]).get(_TOKENS)
                if tokens is not None and tokens.dtype == np.float32 and np.isfinite(tokens).all():
                    return tokens
        warn(f"distill: {path} is damaged: encoding its picture is restarted", UserWarning)
        return None

    def write_tokens(self, image: UInt8, covered: Bool | None, tokens: Float32) -> None:
        """See `dfd.encoders.encode.TokenStore`; warns once if a file cannot be written."""
        path = self._path(image, covered)
        self._has_tokens = True
        try:
            with atomic_write(path, "checkpoint") as temporary:
                content = safetensors.numpy.save({_TOKENS: np.ascontiguousarray(tokens)})
                temporary.write_bytes(with_hash(path.name, content))
        except OSError as error:
            with self._warning:
                warned, self._warned = self._warned, True
            if not warned:
                warn(f"distill: {error.strerror or error}; the run continues, but cannot be resumed", RuntimeWarning)

    def remove(self) -> None:
        """Remove the run's files, and the folder if it is then empty."""
        self._remove_files()
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _remove_files(self) -> None:
        for pattern in _FILES:
            for path in self.folder.glob(pattern):
                with contextlib.suppress(OSError):
                    path.unlink()

    def _is_ours(self) -> bool:
        """Whether a folder without a readable key holds only files that a run may have left."""
        names = {path.name for path in self.folder.iterdir()} if self.folder.is_dir() else set()
        ours = {name for name in names for pattern in _FILES if fnmatch(name, pattern)} - {_KEY}
        others = {name for name in names if not name.startswith(".")} - ours
        return others <= ({_KEY} if ours else set())

    def _path(self, image: UInt8, covered: Bool | None) -> Path:
        made_from = hash_arrays(image) if covered is None else hash_arrays(image, covered)
        return self.folder / f"tokens-{hash_key({'recipe': self._key, 'made from': made_from})[:32]}"


def with_hash(name: str, content: bytes) -> bytes:
    """Return the file's bytes: a hash of `name` and `content`, then `content`."""
    return hashlib.sha256(f"{name}\n".encode() + content).digest() + content


def _read_key(folder: Path) -> dict[str, Any] | None:
    try:
        content = json.loads((folder / _KEY).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict):
        return None
    older = content.keys() >= {"format", "code"}
    return content if older or "field_version" in content else None
