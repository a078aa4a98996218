"""Test steps of a session: undo, redo, and sessions that start from a file."""

import numpy as np
import pytest

import dfd
from dfd.editing.edit import Edit

# --- steps


def test_every_change_is_a_step(deformer):
    shapes = [deformer.vertices]
    handle = deformer.add(5, translation=(0, 1, 0))
    shapes.append(deformer.vertices)
    for change in (
        lambda: deformer.move(handle, scale=2),
        lambda: deformer.change(handle, at=7),
        lambda: deformer.fix(100),
        lambda: deformer.set_symmetry("x"),
        lambda: deformer.set_default(translation=(1, 0, 0)),
        lambda: deformer.release(100),
        lambda: deformer.remove(handle),
        lambda: deformer.apply(Edit()),
    ):
        change()
        shapes.append(deformer.vertices)
    for shape in shapes[-2::-1]:
        assert deformer.undo()
        np.testing.assert_array_equal(deformer.vertices, shape)
    assert not deformer.can_undo
    for shape in shapes[1:]:
        assert deformer.redo()
        np.testing.assert_array_equal(deformer.vertices, shape)
    assert not deformer.can_redo


def test_every_verb_can_join_the_step_before_about_the_same(deformer):
    handle = deformer.add(5)
    for change in (
        lambda merge: deformer.change(handle, strength=0.5 + 0.1 * merge, merge=merge),
        lambda merge: deformer.set_symmetry("x", band=0.1 + merge, merge=merge),
        lambda merge: deformer.set_default(translation=(0, 0, 1 + merge), merge=merge),
    ):
        before = deformer.edit
        change(False)
        first = deformer.edit
        change(True)
        assert deformer.edit not in (before, first)
        deformer.undo()
        assert deformer.edit == before
        deformer.redo()


def test_steps_of_several_changes_join_by_their_topic(deformer):
    handle = deformer.add(5)
    before = deformer.edit
    for height in (0.1, 0.2):
        with deformer.step("drag", merge=True):
            deformer.move(handle, translation=(0, height, 0))
            deformer.change(handle, strength=1 - height)
    assert deformer.handle(handle).transform.translation == (0, 0.2, 0)
    deformer.undo()
    assert deformer.edit == before


def test_several_changes_can_be_one_step_or_none(deformer):
    with deformer.step():
        deformer.add(5)
        deformer.fix(6)
    deformer.undo()
    assert deformer.edit == Edit()
    deformer.redo()

    def fail():
        with deformer.step():
            deformer.add(7)
            deformer.add(10**6)

    with pytest.raises(ValueError, match="`at` must lie in"):
        fail()
    assert [handle.place.vertex for handle in deformer.handles] == [5]


# --- files


def test_a_session_goes_on_from_its_file(deformer, mesh, field, features, geodesics, tmp_path):
    deformer.add(5, translation=(0, 0.2, 0), locality=2.0, name="leg")
    deformer.add((0.2, 0.3, 0.1), rotation=(0, 0, 30))
    deformer.fix(900)
    deformer.set_symmetry("x")
    deformer.set_default(rotation=(0, 5, 0))
    deformer.save(tmp_path / "edit.json")
    again = dfd.Deformer.load(tmp_path / "edit.json", mesh, field, features=features)
    again.bound.rows.kept.get("geodesics", False, lambda: geodesics)
    assert again.edit == deformer.edit
    assert not again.can_undo
    np.testing.assert_array_equal(again.vertices, deformer.vertices)
    assert again.add(7) not in [handle.id for handle in deformer.handles]
