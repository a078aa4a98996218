"""The tokens that a distillation has made so far, kept in a folder: a run that was stopped resumes at the next picture.

The folder holds the run's cache key and the tokens of each picture; the fit takes seconds and is restarted. A file of
tokens is named by what they were made from and begins with a hash: one of another run, or damaged, is never used.
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
from numpy.typing import NDArray
from safetensors import SafetensorError

from dfd.common.check import warn
from dfd.common.files import atomic_write
from dfd.field.cache_key import difference, hash_arrays, hash_key

__all__ = ["Checkpoint", "with_hash"]

_HASH = 32  # bytes of SHA-256 before the content
_TOKENS = "tokens"  # the array's name in a file
_KEY = "recipe.json"
# With what an abrupt end left unfinished; a folder of an older version may hold the state of a fit as well. The key
# goes last: it is what makes the folder ours.
_FILES = ("tokens-*", ".tokens-*", "fit-*", ".fit-*", ".recipe.*.json", _KEY)


class Checkpoint:
    """The folder of one run; it is also the store of its encoder's tokens (`dfd.encoders.encode.TokenStore`).

    Parameters
    ----------
    folder
        Made if it is not there; of a run with another key it is emptied, with a warning.
    key
        All that the result depends on, see `dfd.field.cache_key`.

    Raises
    ------
    ValueError
        If the folder holds something else.
    OSError
        If it cannot be made or written.
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
        """Remove what an earlier run of `key` left in `folder`; other files stay."""
        if _read_key(Path(folder)) == dict(key):
            Checkpoint(folder, key).remove()

    def read_tokens(self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> NDArray[np.float32] | None:
        """See `dfd.encoders.encode.TokenStore`."""
        if not self._has_tokens:  # found out without hashing the image
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
        warn(f"distill: {path} is damaged or of something else: its picture is restarted", UserWarning)
        return None

    def write_tokens(
        self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None, tokens: NDArray[np.float32]
    ) -> None:
        """See `dfd.encoders.encode.TokenStore`; where a file cannot be written, this is said once."""
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
                warn(
                    f"distill: {error.strerror or error}; the run goes on, but cannot be resumed from here",
                    RuntimeWarning,
                )

    def remove(self) -> None:
        """Remove the run's files, and the folder if nothing else is in it."""
        self._remove_files()
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _remove_files(self) -> None:
        for pattern in _FILES:
            for path in self.folder.glob(pattern):
                with contextlib.suppress(OSError):
                    path.unlink()

    def _is_ours(self) -> bool:
        """Whether a folder without a readable key holds nothing but what a run may have left."""
        names = {path.name for path in self.folder.iterdir()} if self.folder.is_dir() else set()
        ours = {name for name in names for pattern in _FILES if fnmatch(name, pattern)} - {_KEY}
        others = {name for name in names if not name.startswith(".")} - ours
        return others <= ({_KEY} if ours else set())

    def _path(self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> Path:
        made_from = hash_arrays(image) if covered is None else hash_arrays(image, covered)
        return self.folder / f"tokens-{hash_key({'recipe': self._key, 'made from': made_from})[:32]}"


def with_hash(name: str, content: bytes) -> bytes:
    """Return `content` as the file of this name holds it: a hash of both before it."""
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
