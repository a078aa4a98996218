"""Test the transfer of an edit to other shapes of its class."""

import re

import numpy as np
import pytest
from made_field import field_of

import dfd
from dfd.batch.one_edit import Original, UnlikeError, carry
from dfd.editing.agreement import agreements, differences, reason
from dfd.editing.transfer import Transferred, transfer


@pytest.fixture(scope="module")
def other(mesh):
    """Return the chair, three times as large and at another place."""
    return dfd.Mesh(3.0 * mesh.vertices + (5, 0, 0), mesh.faces)


@pytest.fixture
def original(mesh, tmp_path):
    session = dfd.Deformer(mesh, field_of(mesh, seed=3))
    session.add(5, translation=(0, 0.2, 0), name="leg")
    session.fix(900)
    session.save(tmp_path / "edit.json")
    return Original.read(tmp_path / "edit.json", mesh, field_of(mesh, seed=3))


def test_another_shape_of_the_class_is_deformed_alike(mesh, other, original):
    found = carry(original, other, field_of(other, seed=3))
    assert found.confidence == pytest.approx({"leg": 0.9283, "fixed 1": 1.0}, abs=1e-3)
    here = dfd.Deformer(mesh, original.field)
    here.apply(original.edit)
    np.testing.assert_allclose(found.deformer.vertices, 3 * here.vertices + (5, 0, 0), atol=1e-3)


def test_the_shape_that_it_was_made_on_gets_it_as_it_is(mesh, original):
    found = carry(original, mesh, field_of(mesh, seed=9))
    assert found.confidence == {"leg": 1.0, "fixed 1": 1.0}
    assert found.deformer.edit == original.edit


def test_a_shape_that_has_nothing_alike_is_refused_with_the_figures(other, original):
    with pytest.raises(UnlikeError, match=r".* may be on a wrong part of this shape: confidence 0\.\d\d is below 0.99"):
        carry(original, other, field_of(other, seed=9), threshold=0.99)
    with pytest.raises(UnlikeError) as refused:
        carry(original, other, field_of(other, seed=9), threshold=0.99)
    assert set(refused.value.confidence) == {"leg", "fixed 1"}
    assert re.search(r", because it(s features are too different| moves .* %| .* lies)", str(refused.value))
    accepted = carry(original, other, field_of(other, seed=9), threshold=0)
    assert accepted.confidence == refused.value.confidence


def test_an_edit_that_moves_nothing_is_refused(mesh, tmp_path):
    dfd.Deformer(mesh, field_of(mesh, seed=3)).save(tmp_path / "none.json")
    with pytest.raises(ValueError, match=r"none.json: `handles` must hold a handle: the edit moves nothing"):
        Original.read(tmp_path / "none.json", mesh, field_of(mesh, seed=3))


@pytest.mark.parametrize(("settings", "similar"), [({}, 0.45), ({"metric": "none"}, 0.45), ({"metric": "m"}, 0.25)])
def test_a_handle_whose_features_are_not_similar_is_unsure(other, original, monkeypatch, settings, similar):
    field = field_of(other, seed=3).with_settings(settings)
    for looks, wanted in ((similar, 0.9283), (similar - 0.09, 0.5 * (similar - 0.09) / similar)):
        sure = dict.fromkeys((handle.id for handle in original.edit.handles), looks)
        there = transfer(original.edit, original.mesh, original.field, other, field_of(other, seed=3)).edit
        found = Transferred(there, sure, (1.0,) * len(original.edit.fixed))
        monkeypatch.setattr("dfd.batch.one_edit.transfer", lambda *_, found=found, **__: found)
        carried = carry(original, other, field, threshold=0.0)
        assert carried.confidence["leg"] == pytest.approx(wanted, abs=1e-3)


def test_a_handle_that_moves_another_part_is_unsure(mesh, original):
    """On a shape with the same features, the handle holds more. It looks similar, but its part does not correspond."""
    session = original.session
    (likely,) = agreements(session, session)
    assert likely == pytest.approx(0.9283, abs=1e-3)
    wide = dfd.Deformer(mesh, original.field)
    wide.apply(original.edit)
    wide.change(1, reach=2.0, falloff="constant")
    (unlikely,) = agreements(session, wide)
    assert unlikely < 0.5
    share, center = differences(session, wide)[0]
    assert unlikely == pytest.approx(1 / (1 + np.exp(-(2.56 - 3.32 * share - 24.4 * center))))


@pytest.mark.parametrize(
    ("apart", "message"),
    [
        ((0.5, 0.2), "the surface that it moves lies 20% of the diagonal from its place on the first shape"),
        ((2.0, 0.2), r"it moves (\d+\.\d%) of the surface, and \1 on the first shape"),
    ],
)
def test_the_larger_difference_is_the_reason(original, monkeypatch, apart, message):
    monkeypatch.setattr("dfd.editing.agreement.differences", lambda *_: np.array([apart]))
    assert re.fullmatch(message, reason(original.session, original.session, 0))


def test_a_threshold_is_a_part(other, original):
    with pytest.raises(ValueError, match=r"carry: `threshold` must be .*, got 2"):
        carry(original, other, field_of(other, seed=3), threshold=2)
