"""A chair, a field that has learnt nothing, and sessions on it."""

import pytest
from made_field import field_of

import dfd


@pytest.fixture(scope="session")
def mesh(chair_mesh):
    return chair_mesh


@pytest.fixture(scope="session")
def field(mesh):
    return field_of(mesh, seed=1)


@pytest.fixture(scope="session")
def features(mesh, field):
    return field.features(mesh)


def linear(session):
    """A session whose poses a skin has to the bit, however far they turn."""
    session.blend = "linear"
    return session


@pytest.fixture
def session(mesh, field, features):
    return linear(dfd.Deformer(mesh, field, features=features))


@pytest.fixture(scope="session")
def make_session():
    """A session on another mesh."""
    return lambda mesh: linear(dfd.Deformer(mesh, field_of(mesh, seed=1)))
