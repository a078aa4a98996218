"""Compute the key of a cached field from all values on which the field depends."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.files import plain
from dfd.mesh.mesh import Mesh

# Increase this version if a change of the code gives another field or file for the same mesh, encoder and settings. The
# cache ignores fields of other versions. The test `test_golden_field.py` fails after such a change.
FIELD_VERSION = 4


def cache_key(mesh: Mesh, **settings: Any) -> dict[str, Any]:
    """Return all values on which the field of `mesh` with these `settings` depends, in types that JSON preserves."""
    values = {"field_version": FIELD_VERSION, "mesh": mesh.content_hash, **settings}
    return dict(json.loads(json.dumps(values, default=plain)))


def hash_key(key: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a cache key, 64 hexadecimal digits."""
    return hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()


def hash_arrays(*arrays: NDArray[Any]) -> str:
    """Return the SHA-256 of the types, shapes and values of `arrays`, 64 hexadecimal digits."""
    sha256 = hashlib.sha256()
    for array in arrays:
        sha256.update(f"{array.dtype} {array.shape}".encode())
        sha256.update(np.ascontiguousarray(array).data)
    return sha256.hexdigest()
