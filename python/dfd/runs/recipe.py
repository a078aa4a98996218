"""What a field is made from, written down: the address of a cached field, and what a resumed run must share."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfd import _core

__all__ = ["Content", "difference", "hash_arrays", "hash_code", "hash_recipe", "origin", "plain", "recipe"]

# Goes up when the same ingredients are to be written down, or their results kept, in another way.
FORMAT = 2

# The rooms whose code makes a field of a mesh, and keeps what is done of it.
FIELD_ROOMS = ("common", "mesh", "geometry", "views", "encoders", "field", "runs", "distillation")


class Content(Protocol):
    """A mesh, as far as its content tells it from any other."""

    @property
    def content_hash(self) -> str:
        """See `dfd.Mesh`."""


def recipe(mesh: Content, **settings: Any) -> dict[str, Any]:
    """Return everything that the bits of a field depend on, as values that JSON keeps apart."""
    return plain({**origin(FIELD_ROOMS, "torch"), "kernels": _hash_kernels(), "mesh": mesh.content_hash, **settings})


def origin(rooms: tuple[str, ...], *packages: str) -> dict[str, Any]:
    """By what something was made: the versions of `packages` and the code of our own `rooms`.

    An entry of last week's code must not pass for the result of today's.
    """
    return {"format": FORMAT, "code": hash_code(rooms), **{package: _version(package) for package in packages}}


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """`values` as they come back from a JSON file."""
    return dict(json.loads(json.dumps(dict(values), default=_plain)))


def hash_recipe(ingredients: Mapping[str, Any]) -> str:
    """SHA-256 of a recipe, 64 hexadecimal digits."""
    return hashlib.sha256(json.dumps(ingredients, sort_keys=True).encode()).hexdigest()


def hash_arrays(*arrays: NDArray[Any]) -> str:
    """SHA-256 of arrays with their types and shapes."""
    sha256 = hashlib.sha256()
    for array in arrays:
        sha256.update(f"{array.dtype} {array.shape}".encode())
        sha256.update(np.ascontiguousarray(array).data)
    return sha256.hexdigest()


@cache
def _hash_kernels() -> str:
    """What tells the kernels, which make tokens and fits, from others: the instruction set and the file's SHA-256."""
    return f"{_core.instruction_set()} {hashlib.sha256(Path(_core.__file__).read_bytes()).hexdigest()}"


@cache
def hash_code(rooms: tuple[str, ...], package: Path = Path(__file__).parents[1]) -> str:
    """SHA-256 of modules and learned numbers in some `rooms`, and of the version, which alone counts in an archive."""
    sha256 = hashlib.sha256(_version("dfd").encode())
    for room in rooms:
        own = (path for path in (package / room).rglob("*") if path.suffix in (".py", ".safetensors"))
        for path in sorted(own):
            sha256.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return sha256.hexdigest()


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """In what two recipes differ, in words: the first few things."""
    words = {
        "mesh": "another mesh",
        "code": "other code of dfd",
        "kernels": "other kernels of dfd",
        "format": "another version of dfd",
    }
    names = [name for name in sorted({*before, *now}) if before.get(name) != now.get(name)]
    said = [
        words.get(name) or (f"{name} {before.get(name)}, now {now.get(name)}" if _short(before, now, name) else name)
        for name in names
    ]
    return "; ".join(said[:3]) + ("; …" if len(said) > 3 else "")


def _short(before: Mapping[str, Any], now: Mapping[str, Any], name: str) -> bool:
    return len(str(before.get(name))) + len(str(now.get(name))) < 60


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's; what else is no JSON by what it looks like, to be refused where it is used."""
    return value.item() if isinstance(value, np.generic) else repr(value)
