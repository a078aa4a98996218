"""A session on a made chair, and what notes what the session asks for."""

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
    """Change rules of the default preset."""

    def change(**changes):
        monkeypatch.setitem(PRESETS, "default", replace(PRESETS["default"], **changes))

    return change


@pytest.fixture
def paper_handles(rules):
    """New handles reach and fall off as the paper's; counterparts have own pivots and follow as they look alike."""
    rules(reach=1.0, falloff="linear", equalize=False)


@pytest.fixture
def geodesics(deformer, mesh):
    counting = Counting(mesh)
    deformer.bound.by_features._geodesics[False] = counting
    return counting


@pytest.fixture
def bound():
    """How many handles each call of `bind` was for."""
    counts = []

    def counted(features, handles, **options):
        counts.append(len(handles))
        return dfd.bind(features, handles, **options)

    with mock.patch.object(feature_weights, "bind", counted):
        yield counts


@pytest.fixture
def folds():
    """How many handles each `Drag` was made to move, and -1 for each whole pose."""
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
    """New handles as the paper has them: all that look alike moves about one pivot."""
    rules(**PRESETS["paper"].handle, equalize=False)
