"""A chair, a field that has learnt nothing, and sessions on it."""

from dataclasses import replace

import pytest
from made_field import field_of

import dfd
from dfd.editing.presets import PRESETS


@pytest.fixture(autouse=True)
def linear(monkeypatch):
    """Blend linearly, as a skin does, however far handles turn."""
    monkeypatch.setitem(PRESETS, "default", replace(PRESETS["default"], blend="linear"))


@pytest.fixture
def session(mesh, field, features):
    return dfd.Deformer(mesh, field, features=features)


@pytest.fixture(scope="session")
def make_session():
    """A session on another mesh."""
    return lambda mesh: dfd.Deformer(mesh, field_of(mesh, seed=1))
