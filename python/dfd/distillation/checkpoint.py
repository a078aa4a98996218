"""What a distillation has done so far, kept in a folder, so that one that was stopped resumes at the next picture.

The folder holds the recipe and the tokens of each picture; the fit takes seconds and begins anew. A piece is named by
what it was made from and carries a hash: one that does not belong here, or is damaged, is never taken up.
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
from dfd.field.cache_key import difference, hash_arrays, hash_recipe

__all__ = ["Checkpoint", "PieceFolder"]

_HASH = 32  # bytes of SHA-256 before the content


class PieceFolder:
    """Files of a folder, each with a hash of its name and its content before the content."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self._warned = False
        self._warning = threading.Lock()  # pieces are written by several threads

    def read(self, name: str) -> bytes | None:
        """Return the content of a piece; None where there is none, and, with a warning, where it is damaged."""
        try:
            piece = (self.folder / name).read_bytes()
        except OSError:
            return None
        content = piece[_HASH:]
        if piece[:_HASH] != _hash(name, content):
            self.reject(name)
            return None
        return content

    def reject(self, name: str) -> None:
        """Say that a piece is not what it should be, and begins anew."""
        warn(f"distill: {self.folder / name} is damaged or of something else: it is begun anew", UserWarning)

    def write(self, name: str, content: memoryview | bytes) -> None:
        """Keep a piece, whole or not at all; where that cannot be done, say so once and go on."""
        try:
            with atomic_write(self.folder / name, "checkpoint") as temporary, temporary.open("wb") as stream:
                stream.write(_hash(name, content))
                stream.write(content)
        except OSError as error:
            with self._warning:
                warned, self._warned = self._warned, True
            if not warned:
                warn(
                    f"distill: {error.strerror or error}; the run goes on, but could not be taken up again from here",
                    RuntimeWarning,
                )

    def remove(self, *patterns: str) -> None:
        """Take away the files whose names match."""
        for pattern in patterns:
            for path in self.folder.glob(pattern):
                with contextlib.suppress(OSError):
                    path.unlink()


def _hash(name: str, content: memoryview | bytes) -> bytes:
    sha256 = hashlib.sha256(f"{name}\n".encode())
    sha256.update(content)
    return sha256.digest()


_RECIPE = "recipe.json"
# With what an abrupt end left unfinished. The recipe goes last: it is what makes the folder ours.
_TOKENS = "tokens"  # the name of the array in a piece
# A folder of an older version may hold the state of a fit as well.
_PIECES = ("tokens-*", ".tokens-*", "fit-*", ".fit-*", ".recipe.*.json", _RECIPE)


class Checkpoint:
    """The folder of one run; it is also the store of its encoder's tokens.

    Parameters
    ----------
    folder
        Made if it is not there; of a run with another recipe it is emptied, with a warning.
    recipe
        All that the result depends on, see `dfd.field.cache_key`.

    Raises
    ------
    ValueError
        If the folder holds something else.
    OSError
        If it cannot be made or written.
    """

    def __init__(self, folder: str | os.PathLike[str], recipe: Mapping[str, Any]) -> None:
        self.folder = Path(folder)
        self._pieces = PieceFolder(folder)
        self._recipe = hash_recipe(recipe)
        if self.folder.exists() and not self.folder.is_dir():
            raise NotADirectoryError(f"distill: `checkpoint` must be a folder, but {self.folder} is a file")
        if not self.folder.parent.is_dir():
            raise FileNotFoundError(f"distill: `checkpoint`: the folder {self.folder.parent} does not exist")
        self._has_tokens = False
        before = _read_recipe(self.folder)
        if before is None and not self._is_ours():
            raise ValueError(f"distill: `checkpoint` must be a new folder or one of an earlier run, got {self.folder}")
        if before == dict(recipe):
            self._has_tokens = any(self.folder.glob(f"{_TOKENS}-*"))
            return
        if before is not None:
            warn(
                f"distill: {self.folder} was begun with other settings ({difference(before, recipe)}): "
                "it is begun anew",
                UserWarning,
            )
        elif (self.folder / _RECIPE).exists():
            warn(f"distill: {self.folder / _RECIPE} is damaged: the run is begun anew", UserWarning)
        self._pieces.remove(*_PIECES)
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise OSError(
                error.errno, f"distill: `checkpoint`: {self.folder} cannot be made: {error.strerror}"
            ) from error
        with atomic_write(self.folder / _RECIPE, "checkpoint") as temporary:
            temporary.write_text(json.dumps(dict(recipe), indent=2, sort_keys=True), "utf-8")

    @staticmethod
    def discard(folder: str | os.PathLike[str], recipe: Mapping[str, Any]) -> None:
        """Take away what an earlier run of `recipe` left in `folder`; anything else stays."""
        if _read_recipe(Path(folder)) == dict(recipe):
            Checkpoint(folder, recipe).remove()

    def read_tokens(self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> NDArray[np.float32] | None:
        """See `dfd.encoders.encode.TokenStore`."""
        if not self._has_tokens:  # found out without a look at all of the image
            return None
        name = self._tokens_name(image, covered)
        content = self._pieces.read(name)
        if content is None:
            return None
        with contextlib.suppress(SafetensorError):
            tokens = safetensors.numpy.load(content).get(_TOKENS)
            if tokens is not None and tokens.dtype == np.float32 and np.isfinite(tokens).all():
                return tokens
        self._pieces.reject(name)
        return None

    def write_tokens(
        self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None, tokens: NDArray[np.float32]
    ) -> None:
        """See `dfd.encoders.encode.TokenStore`."""
        content = safetensors.numpy.save({_TOKENS: np.ascontiguousarray(tokens)})
        self._pieces.write(self._tokens_name(image, covered), content)
        self._has_tokens = True

    def remove(self) -> None:
        """Take the folder away; what else somebody put into it stays."""
        self._pieces.remove(*_PIECES)
        with contextlib.suppress(OSError):
            self.folder.rmdir()

    def _is_ours(self) -> bool:
        """Whether a folder without a readable recipe holds nothing but what a run may have left."""
        names = {path.name for path in self.folder.iterdir()} if self.folder.is_dir() else set()
        pieces = {name for name in names for pattern in _PIECES if fnmatch(name, pattern)} - {_RECIPE}
        others = {name for name in names if not name.startswith(".")} - pieces
        return others <= ({_RECIPE} if pieces else set())

    def _tokens_name(self, image: NDArray[np.uint8], covered: NDArray[np.bool_] | None) -> str:
        return f"tokens-{self._hash(image, *([] if covered is None else [covered]))}"

    def _hash(self, *arrays: NDArray[Any]) -> str:
        return hash_recipe({"recipe": self._recipe, "made from": hash_arrays(*arrays)})[:32]


def _read_recipe(folder: Path) -> dict[str, Any] | None:
    try:
        content = json.loads((folder / _RECIPE).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(content, dict):
        return None
    older = content.keys() >= {"format", "code"}
    return content if older or "field_version" in content else None
