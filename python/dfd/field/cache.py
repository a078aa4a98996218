"""Cache distilled fields in files. Each field has a key: all values on which the field depends.

Each entry is a file with the name `<hash of the key>-<hash of the file>.safetensors`. Files are written atomically, so
several processes may use the cache at once. A file is ignored if its content does not match the second hash.
"""

import contextlib
import hashlib
import os
import secrets
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dfd.common.check import warn
from dfd.common.files import cache_directory
from dfd.field.cache_key import hash_key
from dfd.field.field import Field

LIMIT = 2 << 30  # largest total size of all entries in bytes; above it, the least recently used entries are removed
_ABANDONED = 3600.0  # seconds after which an unfinished file is removed


def find(key: Mapping[str, Any]) -> Field | None:
    """Return the field stored under `key`, or None if the cache has no intact entry for `key`."""
    for path in _entries(hash_key(key)):
        with contextlib.suppress(OSError, ValueError):  # another process removed the file, or the file is damaged
            if not _is_intact(path):
                continue
            found = Field.load(path)
            with contextlib.suppress(OSError):  # the cache may be read-only
                os.utime(path)
            return found
    return None


def store(key: Mapping[str, Any], field: Field) -> None:
    """Store `field` under `key`; warn if the cache cannot be written."""
    folder = _folder()
    temporary = folder / f".{secrets.token_hex(8)}.safetensors"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        field.save(temporary)
        entry = folder / f"{hash_key(key)}-{_hash(temporary.read_bytes())}.safetensors"
        temporary.replace(entry)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        reason = f"the cache folder {folder} cannot be written ({error.strerror or error})"
        remedy = "so the field is not stored; the environment variable DFD_CACHE sets another folder"
        warn(f"distill: {reason}, {remedy}", RuntimeWarning)
        return
    _clean(entry)


def _clean(newest: Path) -> None:
    """Remove abandoned files, damaged entries with the key of `newest`, and the oldest entries beyond `LIMIT`."""
    for path in _entries(newest.name.partition("-")[0]):
        with contextlib.suppress(OSError):
            if not _is_intact(path):
                path.unlink()
    for path in _folder().glob(".*"):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > _ABANDONED:
                path.unlink()
    sizes, total = [], 0
    for path in _entries():
        with contextlib.suppress(OSError):
            state = path.stat()
            sizes.append((path != newest, -state.st_mtime, state.st_size, path))
    for _, _, size, path in sorted(sizes):
        total += size
        if total > LIMIT and path != newest:
            with contextlib.suppress(OSError):
                path.unlink()


def _folder() -> Path:
    return cache_directory() / "fields"


def _entries(key_hash: str = "[!.]*") -> list[Path]:
    """Return the files of all entries, or of the entries with this `key_hash`. Unfinished files are left out."""
    return list(_folder().glob(f"{key_hash}-*.safetensors"))


def _is_intact(path: Path) -> bool:
    return _hash(path.read_bytes()) == path.stem.rpartition("-")[2]


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
