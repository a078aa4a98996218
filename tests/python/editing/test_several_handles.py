"""Test edits with several handles: each arrives, and a new handle on moving surface does not make the shape jump."""

import numpy as np
import pytest
from made_field import field_of, looks
from prepared import sessions_on

import dfd
from dfd.app.options import SAMPLE_FIELDS
from dfd.editing.key_pose import KeyPose
from dfd.editing.weights.axis_motions import level_with_axis
from dfd.editing.weights.several_handles import depths

FRONT, BEHIND, LEFT = "0.115,0,0.245", "0.115,0,-0.29", "-0.115,0,0.245"
KNEE = "0.115,0.2,0.245"  # on the leg of `FRONT`


@pytest.fixture(scope="module")
def animal():
    """Return a sample of a quadruped, and a function that makes sessions with it."""
    sample = dfd.samples.quadruped()
    return sample, sessions_on(sample.mesh, dfd.Field.load(SAMPLE_FIELDS / "quadruped.field.safetensors"), None)


@pytest.mark.parametrize(
    "motion",
    [
        {"translation": (0.1, -0.2, 0)},
        {"rotation": (10, 0, 30)},
        {"rotation": (0, 0, 30), "scale": (1.2, 1, 0.9), "counterparts": "shared_pivot"},
    ],
)
def test_a_second_handle_takes_over_the_motion_of_the_surface(animal, motion):
    sample, fresh = animal
    session, size = fresh(), sample.mesh.diagonal
    session.add(FRONT, **motion)
    start = session.vertices
    handle = session.add(LEFT)
    assert not session.handle(handle).transform.rests
    before = session.vertices
    # The blend bands of a handle with a shared pivot are not those of a handle on the other leg.
    np.testing.assert_allclose(before, start, atol=(3e-3 if "counterparts" in motion else 1e-6) * size)
    pull = np.array(session.handle(handle).transform.translation) + (0, 0, 1e-9)
    session.move(handle, translation=pull)
    np.testing.assert_allclose(session.vertices, before, atol=1e-6 * size)
    session.move(handle, translation=pull + (0, 0.05, 0))
    assert all(each.arrived for each in session.report().handles)
    assert np.abs(session.vertices - before).max() == pytest.approx(0.05, rel=0.05)


def test_a_second_handle_on_a_part_of_another_size_rests(animal):
    """Its motion would move more or less surface, so the shape would change before a drag."""
    _, fresh = animal
    session = fresh()
    session.add(FRONT, translation=(0.1, -0.2, 0))
    start = session.vertices
    handle = session.add(BEHIND, level=-1)
    assert session.handle(handle).transform.rests
    np.testing.assert_array_equal(session.vertices, start)


def test_a_given_motion_is_absolute_and_a_handle_on_resting_surface_rests(animal):
    sample, fresh = animal
    session = fresh()
    session.add(FRONT, translation=(0.1, -0.2, 0))
    top = session.add("top")
    assert session.handle(top).transform.rests
    behind = session.add(BEHIND, translation=(0, 0, 0.01))
    assert session.handle(behind).transform.translation == (0, 0, 0.01)
    vertex = session.report().handles[2].vertex
    np.testing.assert_allclose(session.vertices[vertex], sample.mesh.vertices[vertex] + (0, 0, 0.01), atol=1e-6)
    paper = fresh("paper")
    paper.add(FRONT, translation=(0.1, -0.2, 0))
    assert paper.handle(paper.add(BEHIND)).transform.rests


def test_a_pivot_and_a_bend_do_not_depend_on_other_handles(animal):
    _, fresh = animal
    found = []
    for first in ((), (KNEE,)):
        session = fresh()
        for place in first:
            session.add(place, translation=(0.05, 0, 0))
        handle = session.add(FRONT, rotation=(0, 0, 30), bend=20, joint="auto")
        found.append(session.handle(handle).transform)
    assert found[0] == found[1]


def test_the_depth_of_a_component_is_above_that_of_each_carrier():
    """The last component is nested in the second, but not in the first, in which the second is nested."""
    nested = np.zeros((4, 4), bool)
    nested[1, 0] = nested[3, 1] = True
    np.testing.assert_array_equal(depths(nested, np.array([10.0, 4, 5, 1])), [0, 1, 0, 2])


def test_a_shared_pivot_yields_to_other_handles(animal):
    _, fresh = animal
    session = fresh()
    session.add(FRONT, translation=(0, -0.2, 0), rotation=(0, 40, 0), counterparts="shared_pivot")
    session.add(BEHIND, translation=(0, 0.1, 0.1))
    told = session.report()
    assert all(each.arrived for each in told.handles)
    assert told.handles[0].counterparts == 1


def test_a_report_and_an_error_with_key_poses_of_two_handles(animal):
    _, fresh = animal
    session = fresh()
    whole = session.add(FRONT, bend=20, level=1)
    session.add("top", translation=(0, 0.1, 0))
    session.set_poses([KeyPose(0.0, {each.id: each.transform for each in session.handles})])
    assert level_with_axis(session.bound, session.edit, session.handle(whole)) is not None
    assert session.report().handles[0].arrived


@pytest.mark.parametrize("feather", ["1%", "5%", "10%"])
def test_a_mask_lowers_counterparts_as_far_as_its_edge_says(animal, feather):
    sample, fresh = animal
    session = fresh()
    handle = session.add(FRONT, translation=(0, -0.2, 0), mask="x>0", mask_feather=feather)
    outside = -sample.mesh.vertices[:, 0].clip(None, 0)
    left = (1 - outside / session.handle(handle).controls.mask_feather).clip(0)
    most = 0.2 * left * left * (3 - 2 * left)
    moved = np.linalg.norm(session.vertices - sample.mesh.vertices, axis=1)
    assert (moved <= most + 1e-6).all()


def controls(random, size):
    """Return a random motion and random controls."""
    given = {"translation": 0.1 * size * random.normal(size=3), "level": int(random.integers(-2, 3))}
    given["counterparts"] = str(random.choice(["own_pivot", "own_pivot", "shared_pivot"]))
    given["follow"] = str(random.choice(["all", "all", "mirror", "none"]))
    given["detach"] = bool(random.random() < 0.1)
    if random.random() < 0.5:
        given["rotation"] = 40 * random.normal(size=3)
    if random.random() < 0.25:
        given["scale"] = float(random.uniform(0.6, 1.6))
    if random.random() < 0.2:
        given["reach"] = float(random.uniform(0.4, 1.4))
    if random.random() < 0.3:
        given |= {"radius": "40%"} if random.random() < 0.5 else {"locality": float(random.uniform(0, 4))}
    if random.random() < 0.1:
        given["mask"] = "part"
    return given


@pytest.mark.parametrize("rounds", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_six_random_handles_arrive(rounds):
    sample = dfd.samples.quadruped(4000)
    fresh = sessions_on(sample.mesh, field_of(sample.mesh), looks(sample))
    missed = []
    for seed in range(rounds):
        random, session = np.random.default_rng(seed), fresh()
        for at in random.choice(len(sample.labels), 6, replace=False):
            session.add(int(at), **controls(random, sample.mesh.diagonal))
        missed += [(seed, each.id, each.missing) for each in session.report().handles if not each.arrived]
    assert not missed
