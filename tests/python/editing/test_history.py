"""Test undo, redo, merged changes and steps."""

from contextlib import suppress

import pytest

from dfd.editing.edit import Edit, Fixed, History
from dfd.editing.points import Place


def states(count):
    return [Edit(fixed=(Fixed(Place((float(i), 0.0, 0.0))),)) for i in range(count)]


def test_a_new_step_forgets_what_was_undone():
    first, second, third = states(3)
    history = History(first)
    history._record(second)
    history.undo()
    history._record(third)
    assert not history.can_redo
    assert not history.redo()
    history.undo()
    assert history.edit == first


@pytest.mark.parametrize("between", ["another topic", "undo and redo", "a plain repetition", "a step"])
def test_a_merge_joins_only_an_unbroken_run(between):
    first, second, third, fourth = states(4)
    history = History(first)
    history._record(second, topic=1)
    if between == "another topic":
        history._record(third, topic=2)
    elif between == "undo and redo":
        history.undo()
        history.redo()
    elif between == "a plain repetition":  # a new drag starts, and the pointer has not moved
        history._record(second, topic=1)
    else:
        with history.step():
            pass
    before = history.edit
    history._record(fourth, topic=1, merge=True)
    history.undo()
    assert history.edit == before


@pytest.mark.parametrize("fails", [False, True])
def test_a_merged_step_that_does_nothing_or_fails_does_not_break_the_run(fails):
    first, second, third = states(3)
    history = History(first)
    history._record(second, topic=1)
    with suppress(ZeroDivisionError), history.step(1, merge=True):
        history._record(third if fails else second)
        _ = 1 / (0 if fails else 1)
    assert history.edit == second
    history._record(third, topic=1, merge=True)
    history.undo()
    assert history.edit == first


def test_undo_inside_a_step_stays_inside_it():
    first, second, third = states(3)
    history = History(first)
    history._record(second)
    with history.step():
        assert not history.can_undo
        history._record(third)
        assert history.undo()
        assert not history.undo()
        assert history.edit == second
    assert history.can_undo
    assert history.undo()
    assert history.edit == first


def test_steps_inside_steps_are_part_of_the_outer_one():
    first, second, third = states(3)
    history = History(first)
    with history.step():
        history._record(second)
        with history.step():
            history._record(third)
    history.undo()
    assert history.edit == first


@pytest.mark.parametrize("verb", ["move", "bend", "twist"])
@pytest.mark.parametrize(("how", "steps"), [({}, 3), ({"merge": True}, 2)])
def test_steps_are_merged_only_on_request(deformer, verb, how, steps):
    handle = deformer.add(5)
    for amount in (10, 20):
        given = {"scale": amount} if verb == "move" else {"angle": amount}
        getattr(deformer, verb)(handle, **given, **how)
    assert sum(iter(deformer.undo, False)) == steps
