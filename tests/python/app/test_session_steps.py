"""Test the names of undo steps, and the ladder of parts at a vertex."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from app_page import Page
from scipy.spatial import cKDTree

import dfd
from dfd.app.options import SessionOptions
from dfd.app.session.parts import ShapeParts
from dfd.app.session.requests import probed
from dfd.app.session.steps import MOST_LISTED, Steps
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit
from dfd.field.field import Field

STEPS: list[tuple[Callable[[Deformer], Any], str]] = [
    (lambda deformer: deformer.add(5, name="foot"), "Add foot"),
    (lambda deformer: deformer.add(900), "Add handle 2"),
    (lambda deformer: deformer.move(1, translation=(0, 0.1, 0)), "Move foot"),
    (lambda deformer: deformer.move(1, rotation=(0, 10, 0), pivot="point"), "Rotate foot"),
    (lambda deformer: deformer.move(2, scale=2.0), "Scale handle 2"),
    (lambda deformer: deformer.move(1, bend=(0, 0, 10)), "Bend foot"),
    (lambda deformer: deformer.move(1, twist=10), "Twist foot"),
    (lambda deformer: deformer.move(1, pivot=(0, 0, 0)), "Change the pivot of foot"),
    (lambda deformer: deformer.change(1, level=1), "Change the part of foot"),
    (lambda deformer: deformer.change(1, locality=2.0), "Change locality of foot"),
    (lambda deformer: deformer.change(1, name="hoof"), "Rename hoof"),
    (lambda deformer: deformer.fix(1500), "Fix a place"),
    (lambda deformer: deformer.release(1500), "Release a place"),
    (lambda deformer: deformer.set_symmetry("x"), "Change the symmetry"),
    (lambda deformer: deformer.set_default(translation=(0, 0.1, 0)), "Move the rest of the shape"),
    (lambda deformer: deformer.move(2, scale=1.0), "Return to rest: handle 2"),
    (lambda deformer: deformer.apply(Edit()), "Remove 2 handles"),
]


def test_each_step_has_a_name_and_can_be_reached(deformer: Deformer) -> None:
    steps = Steps(deformer)
    for work, _ in STEPS:
        work(deformer)
    assert list(steps.names()) == [name for _, name in STEPS]
    assert steps.done == len(STEPS)
    steps.go(2 - steps.done)
    assert (steps.done, len(deformer.handles), deformer.handles[0].transform.rests) == (2, 2, True)
    steps.go(-5)
    assert (steps.done, deformer.edit) == (0, Edit())
    steps.go(10**6)
    assert (steps.done, deformer.handles) == (len(STEPS), ())
    steps.begin()
    assert (steps.done, steps.names()) == (0, ())
    deformer.add(7)
    assert steps.names() == ("Add handle 3",)


def test_only_the_steps_near_the_present_are_listed(deformer: Deformer) -> None:
    steps = Steps(deformer)
    deformer.add(5)
    for number in range(MOST_LISTED + 20):
        deformer.move(1, translation=(0, number + 1, 0))
    assert (steps.done, len(steps.names())) == (MOST_LISTED, MOST_LISTED)
    steps.go(-steps.done)
    assert deformer.handles[0].transform.translation == (0, 20, 0)
    assert (steps.done, len(steps.names())) == (20 + 1, 20 + 1 + MOST_LISTED)
    steps.go(-steps.done)
    assert deformer.handles == ()


def test_nothing_can_be_undone_before_the_first_edit(new_page: Page) -> None:
    state = new_page.last("state")
    assert state["symmetry"] is not None
    assert (state["step"], state["steps"]) == (0, [])
    new_page.ask("go", by=-1)
    assert new_page.last("state")["symmetry"] is not None
    new_page.hold(5)
    new_page.ask("set_symmetry", plane=None)
    assert new_page.last("state")["steps"] == ["Add handle 1", "Change the symmetry"]
    new_page.ask("go", by=-1)
    state = new_page.last("state")
    assert (state["step"], len(state["steps"]), state["symmetry"] is None) == (1, 2, False)


def test_a_handle_is_added_at_the_level_that_the_page_showed(page: Page, deformer: Deformer) -> None:
    vertex = next(each for each in range(0, len(deformer.mesh.vertices), 20) if len(_levels(page, each)) > 2)
    levels = _levels(page, vertex)
    assert levels == sorted(set(levels))  # levels with one surface are one step
    regions = [deformer.part(vertex, level=level) for level in levels]
    sizes = [len(region.indices) for region in regions]
    assert sizes[0] < sizes[-1]
    assert deformer.part(vertex, level=levels[-1] + 1) == regions[-1]
    assert deformer.part(vertex, level=levels[0] - 1) == regions[0]
    for level in levels:
        heat = page.ask("probe", vertex=vertex, level=level)
        assert heat["level"] == level
        np.testing.assert_allclose(heat["arrays"]["values"] / 65535, probed(deformer, vertex, level), atol=1e-4)
    page.ask("add", at=vertex, level=levels[0])
    handle = page.last("state")["handles"][0]
    assert (handle["level"], handle["origin"]) == (levels[0], vertex)


def _levels(page: Page, vertex: int) -> list[int]:
    return [int(step["level"]) for step in page.ask("ladder", vertex=vertex)["steps"]]


@pytest.fixture
def ball_and_stick(options: SessionOptions, tmp_path: Path) -> Deformer:
    """Return a ball and a stick, which almost touch."""
    stick = trimesh.creation.box((3, 0.2, 0.2), trimesh.transformations.translation_matrix((2.52, 0, 0)))
    pair = trimesh.creation.icosphere(subdivisions=3), stick.subdivide().subdivide().subdivide()
    trimesh.util.concatenate(pair).export(tmp_path / "pair.ply")
    return Deformer(dfd.load(tmp_path / "pair.ply"), Field.load(options.field.path), other_shape=True)


def test_a_step_tells_that_a_component_stays_behind(ball_and_stick: Deformer) -> None:
    vertices, parts = ball_and_stick.mesh.vertices, ShapeParts(ball_and_stick)
    left = vertices[:, 0] < 1.01
    told = set()
    for vertex in range(0, len(vertices), 40):
        for step in parts.ladder(vertex):
            inside = np.zeros(len(vertices), bool)
            inside[ball_and_stick.part(vertex, level=step.level).indices] = True
            gaps = [np.inf]
            for component in (left, ~left):
                if not inside[component].any():
                    gaps.append(cKDTree(vertices[inside]).query(vertices[component])[0].min())
            # Bridges are at most 2 % of the diagonal long, and join the nearest points along the gap.
            assert not step.leaves or min(gaps) < 0.025 * ball_and_stick.mesh.diagonal, (vertex, step)
            assert step.leaves or min(gaps) > 0.021, (vertex, step)
            told.add((step.leaves, step.found))
    assert {leaves for leaves, _ in told} == {True, False}


def test_a_step_tells_that_no_part_was_found(options: SessionOptions, tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "ball.ply")
    ball = Deformer(dfd.load(tmp_path / "ball.ply"), Field.load(options.field.path), other_shape=True)
    usual = next(step for step in ShapeParts(ball).ladder(0) if step.level == 0)
    assert not usual.found
