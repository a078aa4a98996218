"""Which mesh a file holds, noted when it is read: to read it again takes longer than to look its field up."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from dfd.common.cache import cache_directory
from dfd.common.files import atomic_write
from dfd.runs.recipe import hash_recipe

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["KnownMesh", "hash_file", "note", "recall"]

LIMIT = 500  # meshes; those noted first are forgotten first
# To be raised by hand with every change that reads another mesh from the same file; golden files in the tests tell.
MESH_VERSION = 1
# With these words a mesh file names another one, whose content would count too: OBJ, PLY and glTF, in this order.
_REFERENCES = (b"mtllib", b"texturefile", b'"uri"')


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
    return hash_recipe(
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
            temporary.write_text(json.dumps(dict(list(notes.items())[-LIMIT:])), "utf-8")


def _notes() -> dict[str, object]:
    try:
        notes = json.loads(_path().read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return notes if isinstance(notes, dict) else {}


def _path() -> Path:
    return cache_directory() / "meshes.json"
