"""A session on a generated chair, and fixtures that record its calls of `bind`, `pose` and `Drag`."""

from dataclasses import replace
from unittest import mock

import pytest
from counting import Counting

import dfd
from dfd.editing import shape
from dfd.editing.influence import feature_weights
from dfd.editing.presets import PRESETS


@pytest.fixture
def deformer(mesh, field, features):
    return dfd.Deformer(mesh, field, features=features)


@pytest.fixture
def rules(monkeypatch):
    """Return a function that changes rules of the default preset during a test."""

    def change(**changes):
        monkeypatch.setitem(PRESETS, "default", replace(PRESETS["default"], **changes))

    return change


@pytest.fixture
def paper_handles(rules):
    """Give new handles the paper's reach and falloff. Counterparts keep own pivots; more similar ones follow more."""
    rules(reach=1.0, falloff="linear", equalize=False)


@pytest.fixture
def geodesics(deformer, mesh):
    counting = Counting(mesh)
    deformer.bound.by_features._geodesics[False] = counting
    return counting


@pytest.fixture
def bound():
    """Record the number of handles of each call of `bind`."""
    counts = []

    def counted(features, handles, **options):
        counts.append(len(handles))
        return dfd.bind(features, handles, **options)

    with mock.patch.object(feature_weights, "bind", counted):
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


@pytest.fixture
def about_one_pivot(rules):
    """Give new handles the controls of the preset "paper": all counterparts move about one pivot."""
    rules(**PRESETS["paper"].handle, equalize=False)
