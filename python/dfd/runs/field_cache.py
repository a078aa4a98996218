"""Fields that were distilled before, under the hash of their recipe, so that a second call need not work.

An entry is one file, `<hash of the recipe>-<hash of the file>.safetensors`. It appears whole or not at all, so that
several processes may look, write and tidy up at once; a file whose content is not what its name says is none.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from dfd.common.cache import cache_directory
from dfd.common.files import atomic_write
from dfd.common.warn import warn
from dfd.runs.recipe import hash_recipe

if TYPE_CHECKING:
    from dfd.field.field import Field

__all__ = ["CachedField", "find", "find_file", "store"]

Found = TypeVar("Found")

LIMIT = 2 << 30  # bytes of all entries together; the ones longest unused go first
_ABANDONED = 3600.0  # seconds after which a file that nobody finished is litter


@dataclass(frozen=True)
class CachedField:
    """A field as its file has it, for those who want a copy of that: looking at it takes no torch."""

    content: bytes = dataclasses.field(repr=False)
    dimension: int
    settings: dict[str, Any]

    @classmethod
    def of(cls, content: bytes) -> CachedField:
        """Read the header of what `Field.save` wrote.

        Raises
        ------
        ValueError
            If it was another's.
        """
        length = int.from_bytes(content[:8], "little")
        try:
            header = json.loads(content[8 : 8 + length])["__metadata__"]
            return cls(content, int(json.loads(header["network"])["dimension"]), json.loads(header["settings"]))
        except (KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"no field: {error}") from None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the field to `path`, whole or not at all; raises what `Field.save` raises."""
        with atomic_write(path) as temporary:
            temporary.write_bytes(self.content)


def find(recipe: Mapping[str, Any]) -> Field | None:
    """Return the field that `recipe` made, or None where no entry has it whole."""

    def load(path: Path, _: bytes) -> Field:
        from dfd.field.field import Field

        return Field.load(path)

    return _first_whole(recipe, load)


def find_file(recipe: Mapping[str, Any]) -> CachedField | None:
    """As `find`, without making it a network."""
    return _first_whole(recipe, lambda _, content: CachedField.of(content))


def _first_whole(recipe: Mapping[str, Any], read: Callable[[Path, bytes], Found]) -> Found | None:
    for path in _entries(f"{hash_recipe(recipe)}-"):
        with contextlib.suppress(OSError, ValueError):  # tidied up by another process, or of no use
            content = path.read_bytes()
            if not _is_of(path, content):
                continue
            found = read(path, content)
            with contextlib.suppress(OSError):  # a cache that can only be read
                os.utime(path)
            return found
    return None


def store(recipe: Mapping[str, Any], field: Field) -> None:
    """Keep `field` under `recipe`; where the cache cannot be written, say so once and go on."""
    folder = _folder()
    temporary = folder / f".{secrets.token_hex(8)}.safetensors"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        field.save(temporary)
        entry = folder / f"{hash_recipe(recipe)}-{_hash(temporary.read_bytes())}.safetensors"
        temporary.replace(entry)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        warn(
            f"distill: the cache folder {folder} cannot be written ({error.strerror or error}): the field is not kept "
            "for another call; DFD_CACHE names another folder",
            RuntimeWarning,
        )
        return
    _tidy(entry)


def _tidy(newest: Path) -> None:
    """Let go of damaged twins of the `newest` entry, of litter, and of the oldest entries beyond the limit."""
    for path in _entries(f"{newest.name.partition('-')[0]}-"):
        with contextlib.suppress(OSError):
            if not _is_of(path, path.read_bytes()):
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


def _is_of(path: Path, content: bytes) -> bool:
    return _hash(content) == path.stem.rpartition("-")[2]


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
