"""What a field is made from: the key of a cached field, and what a resumed run must share."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

# To be raised by hand with every change that gives another field for the same mesh, encoder and settings, or keeps it
# in another way: fields of other versions are not taken from the cache. A golden field in the tests tells when.
FIELD_VERSION = 6


class Content(Protocol):
    """A mesh, as far as its content tells it from any other."""

    @property
    def content_hash(self) -> str:
        """See `dfd.Mesh`."""


def cache_key(mesh: Content, **settings: Any) -> dict[str, Any]:
    """Return everything that a field depends on, as values that come back alike from a JSON file."""
    values = {"field_version": FIELD_VERSION, "mesh": mesh.content_hash, **settings}
    return dict(json.loads(json.dumps(values, default=_plain)))


def hash_key(key: Mapping[str, Any]) -> str:
    """SHA-256 of a cache key, 64 hexadecimal digits."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()


def hash_arrays(*arrays: NDArray[Any]) -> str:
    """SHA-256 of arrays with their types and shapes."""
    sha256 = hashlib.sha256()
    for array in arrays:
        sha256.update(f"{array.dtype} {array.shape}".encode())
        sha256.update(np.ascontiguousarray(array).data)
    return sha256.hexdigest()


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Describe the first few differences between two keys."""
    words = {"mesh": "another mesh", "field_version": "another version of dfd"}

    def describe(name: str) -> str:
        one, other = before.get(name), now.get(name)
        return words.get(name) or (f"{name} {one}, now {other}" if len(f"{one}{other}") < 60 else name)

    names = [name for name in sorted({*before, *now}) if before.get(name) != now.get(name)]
    return "; ".join(map(describe, names[:3])) + ("; …" if len(names) > 3 else "")


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's; what else is not JSON by its text, to be refused where it is used."""
    return value.item() if isinstance(value, np.generic) else repr(value)
