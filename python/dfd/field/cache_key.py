"""What a field is made from, written down: the address of a cached field, and what a resumed run must share."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["FIELD_VERSION", "Content", "difference", "hash_arrays", "hash_recipe", "plain", "recipe"]

# To be raised by hand with every change that gives another field for the same mesh, encoder and settings, or keeps it
# in another way: fields of other versions are not taken from the cache. A golden field in the tests tells when.
FIELD_VERSION = 4


class Content(Protocol):
    """A mesh, as far as its content tells it from any other."""

    @property
    def content_hash(self) -> str:
        """See `dfd.Mesh`."""


def recipe(mesh: Content, **settings: Any) -> dict[str, Any]:
    """Return everything that a field depends on, as values that JSON keeps apart."""
    return plain({"field_version": FIELD_VERSION, "mesh": mesh.content_hash, **settings})


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


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """In what two recipes differ, in words: the first few things."""
    words = {"mesh": "another mesh", "field_version": "another version of dfd"}
    names = [name for name in sorted({*before, *now}) if before.get(name) != now.get(name)]
    said = [
        words.get(name) or (f"{name} {before.get(name)}, now {now.get(name)}" if _short(before, now, name) else name)
        for name in names
    ]
    return "; ".join(said[:3]) + ("; …" if len(said) > 3 else "")


def _short(before: Mapping[str, Any], now: Mapping[str, Any], name: str) -> bool:
    return len(str(before.get(name))) + len(str(now.get(name))) < 60


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's; what else is no JSON by what it looks like, to be refused where it is used."""
    return value.item() if isinstance(value, np.generic) else repr(value)
