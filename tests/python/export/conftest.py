"""A chair, a field that has learnt nothing, and sessions on it."""

import pytest
from made_field import made_field

import dfd


@pytest.fixture(scope="session")
def mesh():
    return dfd.samples.chair(4000).mesh


def field_of(mesh, seed=1):
    return made_field(16, seed=seed, width=32, layers=2, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents))


@pytest.fixture(scope="session")
def field(mesh):
    return field_of(mesh)


@pytest.fixture(scope="session")
def features(mesh, field):
    return field.features(mesh)


@pytest.fixture
def session(mesh, field, features):
    return dfd.Deformer(mesh, field, features=features)


@pytest.fixture(scope="session")
def make_session():
    """A session on another mesh."""
    return lambda mesh: dfd.Deformer(mesh, field_of(mesh))
