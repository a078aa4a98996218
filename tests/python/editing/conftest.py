"""A session on a generated chair, and fixtures that record its calls of `bind`, `pose` and `Drag`."""

from unittest import mock

import pytest
from counting import Counting
from prepared import sessions_on

import dfd
from dfd.editing import shape
from dfd.editing.weights import by_features


@pytest.fixture(scope="session")
def fresh(mesh, field, features):
    """Return a function that makes a session without handles. All sessions share the planes and parts of the chair."""
    return sessions_on(mesh, field, features)


@pytest.fixture
def deformer(fresh):
    return fresh()


@pytest.fixture
def paper(fresh):
    return fresh("paper")


@pytest.fixture
def geodesics_of():
    """Return a function that replaces the distances of a session by a `Counting`, and returns it."""

    def replaced(session):
        counting = Counting(session.mesh)
        for exact in (True, False):
            session.bound.rows.kept.get("geodesics", exact, lambda: counting)
        return counting

    return replaced


@pytest.fixture
def geodesics(deformer, geodesics_of):
    return geodesics_of(deformer)


@pytest.fixture
def bound():
    """Record the number of handles of each call of `bind`."""
    counts = []

    def counted(features, handles, **options):
        counts.append(len(handles))
        return dfd.bind(features, handles, **options)

    with mock.patch.object(by_features, "bind", counted):
        yield counts


@pytest.fixture
def folds():
    """Record the number of moving handles of each `Drag`, and -1 for each call of `pose`."""
    counts = []

    def whole(*arguments, **options):
        counts.append(-1)
        return dfd.pose(*arguments, **options)

    def drag(*arguments, moving, **options):
        counts.append(len(moving))
        return dfd.Drag(*arguments, moving=moving, **options)

    with mock.patch.object(shape, "pose", whole), mock.patch.object(shape, "Drag", drag):
        yield counts
