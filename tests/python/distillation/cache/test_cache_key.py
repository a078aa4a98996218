"""Recipes: equal by content, and of one version of how fields are made."""

from __future__ import annotations

import numpy as np
import pytest

import dfd
from dfd import Mesh
from dfd.field.cache_key import FIELD_VERSION, difference, hash_arrays, hash_recipe, recipe


def test_recipes_are_equal_by_content() -> None:
    mesh = dfd.samples.chair(4000).mesh
    one = recipe(mesh, views=24, rate=0.5, faces=None)
    two = recipe(mesh, faces=None, rate=np.float64(0.5), views=np.int64(24))
    assert one == two
    assert hash_recipe(one) == hash_recipe(two)
    assert hash_recipe(recipe(mesh, views=25)) != hash_recipe(recipe(mesh, views="25"))
    other = recipe(Mesh(mesh.vertices * 2, mesh.faces), views=25, rate=0.5)
    assert difference(one, other) == "another mesh; views 24, now 25"


def test_another_version_is_another_recipe(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = dfd.samples.chair(4000).mesh
    before = recipe(mesh)
    monkeypatch.setattr("dfd.field.cache_key.FIELD_VERSION", FIELD_VERSION + 1)
    assert hash_recipe(recipe(mesh)) != hash_recipe(before)
    assert difference(before, recipe(mesh)) == "another version of dfd"


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
