"""Fixtures: sessions on a chair whose field has random parameters."""

from dataclasses import replace

import pytest
from made_field import field_of

import dfd
from dfd.editing.presets import PRESETS


@pytest.fixture(autouse=True)
def linear(monkeypatch):
    """Blend linearly for all rotations, as a skin does."""
    monkeypatch.setitem(PRESETS, "default", replace(PRESETS["default"], blend="linear"))


@pytest.fixture
def session(mesh, field, features):
    return dfd.Deformer(mesh, field, features=features)


@pytest.fixture(scope="session")
def make_session():
    """Return a function that returns a session on a given mesh."""
    return lambda mesh: dfd.Deformer(mesh, field_of(mesh, seed=1))
