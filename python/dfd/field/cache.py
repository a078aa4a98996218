"""A cache of distilled fields by the hash of their key.

An entry is one file, `<hash of the key>-<hash of the file>.safetensors`. It is written atomically, so that several
processes may read, write and clean up at once; a file whose content does not match its name is ignored.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.common.check import warn
from dfd.common.files import atomic_write, cache_directory
from dfd.field.cache_key import hash_key
from dfd.field.field import Field

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

LIMIT = 2 << 30  # bytes of all entries together; the ones longest unused go first
_ABANDONED = 3600.0  # seconds after which an unfinished file is removed


def find(key: Mapping[str, Any]) -> Field | None:
    """Return the field that `key` made, or None where no entry has it whole."""
    for path in _entries(f"{hash_key(key)}-"):
        with contextlib.suppress(OSError, ValueError):  # removed by another process, or damaged
            if not _is_of(path, path.read_bytes()):
                continue
            found = Field.load(path)
            with contextlib.suppress(OSError):  # a cache that can only be read
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
        warn(
            f"distill: the cache folder {folder} cannot be written ({error.strerror or error}): the field is not kept "
            "for another call; DFD_CACHE names another folder",
            RuntimeWarning,
        )
        return
    _tidy(entry)


def _tidy(newest: Path) -> None:
    """Remove damaged copies of the `newest` entry, unfinished files, and the oldest entries beyond the limit."""
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


MOST_MESHES = 500  # noted; those noted first are forgotten first
# To be raised by hand with every change that reads another mesh from the same file; golden files in the tests tell.
MESH_VERSION = 1
# With these words a mesh file names another one, whose content would count too: OBJ, PLY and glTF, in this order.
_REFERENCES = (b"mtllib", b"texturefile", b'"uri"', b"relativefilename")


@dataclass(frozen=True)
class KnownMesh:
    """A mesh of which no more is known than the hash of its content, see `Mesh.content_hash`."""

    content_hash: str


def hash_file(path: str | os.PathLike[str]) -> str | None:
    """Hash all that `dfd.load(path)` depends on; None where that is more than this one file, or it cannot be read."""
    try:
        data = Path(path).read_bytes()
    except OSError:
        return None
    folded = data.lower()
    if any(word in folded for word in _REFERENCES):
        return None
    content = hashlib.sha256(data).hexdigest()
    libraries = {package: version(package) for package in ("trimesh", "pillow")}
    return hash_key(
        {"mesh_version": MESH_VERSION, **libraries, "ending": Path(path).suffix.lower(), "content": content}
    )


def recall(file: str | None) -> KnownMesh | None:
    """Return the mesh that was noted for a `hash_file`, or None."""
    content = _notes().get(file) if file else None
    return KnownMesh(content) if isinstance(content, str) else None


def note(file: str | None, mesh: Mesh) -> None:
    """Note that a file of this `hash_file` holds `mesh`; what cannot be noted will be read again.

    Of two processes that note something at once one may be forgotten.
    """
    if file is None:
        return
    notes = {**_notes(), file: mesh.content_hash}
    path = _path()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            temporary.write_text(json.dumps(dict(list(notes.items())[-MOST_MESHES:])), "utf-8")


def _notes() -> dict[str, object]:
    try:
        notes = json.loads(_path().read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return notes if isinstance(notes, dict) else {}


def _path() -> Path:
    return cache_directory() / "meshes.json"
