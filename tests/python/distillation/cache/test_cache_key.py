"""Keys: equal by content, and of one version of how fields are made."""

from __future__ import annotations

import numpy as np
import pytest

import dfd
from dfd import Mesh
from dfd.field.cache_key import FIELD_VERSION, cache_key, hash_arrays, hash_key


def test_keys_are_equal_by_content() -> None:
    mesh = dfd.samples.chair(4000).mesh
    one = cache_key(mesh, views=24, rate=0.5, faces=None)
    two = cache_key(mesh, faces=None, rate=np.float64(0.5), views=np.int64(24))
    assert one == two
    assert hash_key(one) == hash_key(two)
    assert hash_key(cache_key(mesh, views=25)) != hash_key(cache_key(mesh, views="25"))
    assert hash_key(cache_key(Mesh(mesh.vertices * 2, mesh.faces), views=24, rate=0.5, faces=None)) != hash_key(one)


def test_another_version_is_another_key(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = dfd.samples.chair(4000).mesh
    before = cache_key(mesh)
    monkeypatch.setattr("dfd.field.cache_key.FIELD_VERSION", FIELD_VERSION + 1)
    assert hash_key(cache_key(mesh)) != hash_key(before)


def test_arrays_are_told_apart_by_type_shape_and_content() -> None:
    hashes = {
        hash_arrays(np.zeros(4, np.float32)),
        hash_arrays(np.zeros(2, np.float64)),
        hash_arrays(np.zeros((2, 2), np.float32)),
        hash_arrays(np.ones(4, np.float32)),
        hash_arrays(np.zeros(2, np.float32), np.zeros(2, np.float32)),
    }
    assert len(hashes) == 5
    rows = np.arange(6.0).reshape(2, 3)
    assert hash_arrays(rows.T) == hash_arrays(np.ascontiguousarray(rows.T))
