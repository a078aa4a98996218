"""Fields that were distilled before, under the digest of their recipe, so that a second call need not work.

An entry is one file, `<digest of the recipe>-<checksum>.safetensors`. It appears whole or not at all, so that several
processes may look, write and tidy up at once; a file whose content is not what its name says is none.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dfd.cache import cache_directory
from dfd.distillation.recipe import digest
from dfd.field import Field

__all__ = ["find", "store"]

LIMIT = 2 << 30  # bytes of all entries together; the ones longest unused go first
_ABANDONED = 3600.0  # seconds after which a file that nobody finished is litter


def find(recipe: Mapping[str, Any]) -> Field | None:
    """Return the field that `recipe` made, or None where no sound entry has it."""
    for path in _entries(f"{digest(recipe)}-"):
        with contextlib.suppress(OSError, ValueError):  # tidied up by another process, or of no use
            if not _sound(path):
                continue
            field = Field.load(path)
            with contextlib.suppress(OSError):  # a cache that can only be read
                os.utime(path)
            return field
    return None


def store(recipe: Mapping[str, Any], field: Field) -> None:
    """Keep `field` under `recipe`; where the cache cannot be written, say so once and go on.

    Two processes that make the same field at once may each leave an entry: one of them is never used, and goes in time.
    """
    folder = _folder()
    temporary = folder / f".{secrets.token_hex(8)}.safetensors"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        field.save(temporary)
        entry = folder / f"{digest(recipe)}-{_checksum(temporary)}.safetensors"
        temporary.replace(entry)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        warnings.warn(
            f"distill: the cache folder {folder} cannot be written ({error.strerror or error}): the field is not kept "
            "for another call; DFD_CACHE names another folder",
            RuntimeWarning,
            stacklevel=4,
        )
        return
    _tidy(entry)


def _tidy(newest: Path) -> None:
    """Let go of damaged twins of the `newest` entry, of litter, and of the oldest entries beyond the limit."""
    for path in _entries(f"{newest.name.partition('-')[0]}-"):
        with contextlib.suppress(OSError):
            if not _sound(path):
                _remove(path)
    now, total = time.time(), 0
    for path in _folder().glob(".*"):
        with contextlib.suppress(OSError):
            if now - path.stat().st_mtime > _ABANDONED:
                _remove(path)
    sizes = []
    for path in _entries():
        with contextlib.suppress(OSError):
            state = path.stat()
            sizes.append((path != newest, -state.st_mtime, state.st_size, path))
    for _, _, size, path in sorted(sizes):
        total += size
        if total > LIMIT and path != newest:
            _remove(path)


def _folder() -> Path:
    return cache_directory() / "fields"


def _entries(start: str = "") -> list[Path]:
    try:
        names = [path for path in _folder().iterdir() if path.suffix == ".safetensors" and path.name[0] != "."]
    except OSError:
        return []
    return [path for path in names if path.name.startswith(start)]


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


def _sound(path: Path) -> bool:
    return _checksum(path) == path.stem.rpartition("-")[2]


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]
