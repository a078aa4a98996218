"""Test the effect of each control on weights and vertices, and undo."""

import numpy as np
import pytest
from prepared import sessions_on

import dfd
from dfd.editing.controls import Controls, length_on
from dfd.editing.points import Place
from dfd.editing.regions import Ball, HalfSpace
from dfd.editing.weights.axis_motions import bendable_parts
from dfd.posing.transforms import frame_of_normal


@pytest.fixture(scope="module")
def chair():
    return dfd.samples.chair(4000)


@pytest.fixture(scope="module")
def labeled(chair, mesh):
    """Return (V, 16) unit features that depend on the label of a vertex, and a little on its position."""
    rows = np.zeros((len(mesh.vertices), 16), np.float32)
    rows[np.arange(len(rows)), chair.labels] = 1.0
    rows[:, 8:11] = 0.4 * np.abs(mesh.vertices)
    rows[:, 12] = 1.5
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


@pytest.fixture(scope="module")
def fresh(mesh, field, labeled):
    return sessions_on(mesh, field, labeled)


@pytest.fixture
def session(fresh):
    return fresh()


@pytest.fixture(scope="module")
def foot(chair, mesh):
    legs = chair.vertices_of("leg", 0)
    return int(legs[mesh.vertices[legs, 1].argmin()])


# --- controls of weights


def test_reach_and_falloff_are_those_of_bind(paper, labeled, foot):
    handle = paper.add(foot, reach=0.5, falloff="sharp")
    np.testing.assert_array_equal(paper.weights, dfd.bind(labeled, [foot], reach=0.5, falloff="sharp"))
    paper.change(handle, reach=0.7)
    np.testing.assert_array_equal(paper.weights, dfd.bind(labeled, [foot], reach=0.7, falloff="sharp"))
    paper.undo()
    paper.undo()
    assert paper.handles == ()
    paper.redo()
    assert paper.handle(handle).controls == Controls(0.5, "sharp", counterparts="shared_pivot")


@pytest.mark.parametrize("radius", [1e-320, 1e-38, "1e-300%"])
def test_within_the_smallest_radius_only_the_handle_moves(session, mesh, foot, radius):
    session.add(foot, radius=radius, translation=(0, 0.1, 0))
    moved = np.abs(session.vertices - mesh.vertices).max(axis=1) > 0
    assert moved[foot]
    np.testing.assert_array_equal(mesh.vertices[moved], np.tile(mesh.vertices[foot], (moved.sum(), 1)))


def test_a_radius_ends_smoothly_where_it_says(paper, geodesics_of, labeled, foot):
    lengths = geodesics_of(paper).lengths([foot])
    handle = paper.add(foot, radius=0.3)
    weights, free = paper.weights[:, 0], dfd.bind(labeled, [foot])[:, 0]
    wanted = np.where(lengths[0] < 0.3, free * (1 - (lengths[0] / 0.3) ** 2) ** 2, 0)
    np.testing.assert_allclose(weights, wanted, atol=1e-6)
    assert weights[foot] == 1
    paper.change(handle, radius="20%")
    assert paper.handle(handle).controls.radius == pytest.approx(0.2 * paper.mesh.diagonal)
    assert length_on(paper.mesh, "radius", "0.5") == 0.5


@pytest.mark.parametrize(
    ("region", "away"),
    [
        ("x>0", lambda points: -points[:, 0]),
        ("ball:0,0.5,0,0.2", lambda points: np.linalg.norm(points - (0, 0.5, 0), axis=1) - 0.2),
        ("box:-1,0.3,-1,1,0.6,1", lambda points: np.maximum(0.3 - points[:, 1], points[:, 1] - 0.6)),
    ],
)
def test_a_limit_may_have_a_soft_edge(session, foot, mesh, region, away):
    session.add(foot)
    everywhere = session.weights[:, 0].copy()
    session.change(1, mask=region, mask_feather=0.2)
    left = np.clip(1 - away(mesh.vertices) / 0.2, 0, 1)
    wanted = everywhere * left * left * (3 - 2 * left)
    np.testing.assert_allclose(session.weights[:, 0], wanted, atol=1e-6)
    assert ((left > 0) & (left < 1)).any()
    session.change(1, mask_feather=0)
    np.testing.assert_allclose(session.weights[:, 0], np.where(away(mesh.vertices) <= 0, everywhere, 0), atol=1e-6)
    session.change(1, mask_feather="10%")
    assert session.handle(1).controls.mask_feather == pytest.approx(0.1 * mesh.diagonal)


def test_strength_is_a_factor_and_within_a_limit(paper, labeled, foot, mesh):
    handle = paper.add(foot, strength=0.25, mask="x>0")
    weights = 0.25 * dfd.bind(labeled, [foot])[:, 0]
    weights[mesh.vertices[:, 0] < 0] = 0
    np.testing.assert_array_equal(paper.weights[:, 0], weights)
    paper.change(handle, mask="everywhere", strength=1)
    np.testing.assert_array_equal(paper.weights, dfd.bind(labeled, [foot]))


def test_a_region_is_held_as_its_nearest_member_is(paper, labeled, chair):
    seat = chair.vertices_of("seat")
    paper.add(seat, translation=(0, 0.2, 0))
    weights = paper.weights[:, 0]
    np.testing.assert_array_equal(weights[seat], 1)
    nearest = dfd.bind(labeled, seat).max(axis=1)
    np.testing.assert_allclose(weights, nearest, atol=0.05)
    assert (weights <= nearest + 1e-6).all()
    np.testing.assert_allclose(paper.vertices[seat], paper.mesh.vertices[seat] + (0, 0.2, 0), atol=1e-6)
    low, high = paper.mesh.vertices[seat].min(axis=0), paper.mesh.vertices[seat].max(axis=0)
    np.testing.assert_allclose(paper.handles[0].pivot, (low + high) / 2)


# --- fixed points and regions


def test_handles_arrive_although_fixed_points_take_from_them(session, paper, chair, labeled, foot, mesh):
    seat = int(chair.vertices_of("seat")[0])
    session.add(foot, translation=(0, -0.2, 0), reach=1.0, falloff="linear", counterparts="shared_pivot")
    session.fix(seat)
    left = dfd.bind(labeled, [foot], fixed=[seat])
    assert 0.2 < left[foot, 0] < 0.9
    np.testing.assert_allclose(session.weights, np.minimum(left / left[foot, 0], 1), rtol=1e-6)
    np.testing.assert_allclose(session.vertices[foot], mesh.vertices[foot] - (0, 0.2, 0), atol=1e-7)
    np.testing.assert_array_equal(session.vertices[seat], mesh.vertices[seat])
    paper.add(foot)
    paper.fix(seat)
    np.testing.assert_array_equal(paper.weights, left)


@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0])
def test_a_fixed_point_holds_by_its_strength(paper, labeled, chair, foot, strength):
    seat = int(chair.vertices_of("seat")[0])
    paper.add(foot)
    paper.fix(seat, strength=strength)
    np.testing.assert_array_equal(paper.weights, dfd.bind(labeled, [foot], fixed=[seat], strength=strength))


def test_all_of_a_fixed_region_stays(session, chair, foot, mesh):
    session.add(foot, translation=(0, -0.2, 0))
    back = chair.vertices_of("back")
    session.fix(HalfSpace((0, 1, 0), 0.5))
    held = mesh.vertices[:, 1] >= 0.5
    assert set(back) & set(np.flatnonzero(held))
    np.testing.assert_array_equal(session.vertices[held], mesh.vertices[held])
    assert np.abs(session.vertices - mesh.vertices).max() == pytest.approx(0.2)
    session.release(HalfSpace((0, 1, 0), 0.5))
    assert session.fixed == ()


def test_nothing_left_of_a_handle_is_said_at_once(session, foot):
    session.add(foot)
    message = rf"Deformer.fix: `fixed` must leave handle 1 at {foot} a weight of at least 0.01, but leaves 0: "
    with pytest.raises(ValueError, match=message):
        session.fix(Ball(session.mesh.vertices[foot], 0.05))
    assert session.fixed == ()
    session.fix(Ball(session.mesh.vertices[foot], 0.05), strength=0.5)


# --- several handles


def test_scale_along_the_normal_makes_thicker_and_not_longer(session, foot, mesh):
    vertex = int(np.abs(mesh.normals).max(axis=1).argmin())
    session.add(vertex, scale=(1, 1, 2), axes="normal")
    normal = mesh.normals[vertex]
    linear = session.transforms[0][:, :3]
    np.testing.assert_allclose(linear @ normal, 2 * normal, atol=1e-6)
    across = np.asarray(frame_of_normal(normal))[:2]
    np.testing.assert_allclose(linear @ across.T, across.T, atol=1e-6)
    session.move(1, axes="auto")
    np.testing.assert_allclose(session.transforms[0][:, :3], np.diag([1, 1, 2]))


def test_a_point_of_space_has_the_normal_of_the_nearest_vertex(session, mesh):
    vertex = int(np.abs(mesh.normals).max(axis=1).argmin())
    handle = session.add(mesh.vertices[vertex] + 1e-4 * mesh.normals[vertex], axes="normal")
    np.testing.assert_allclose(session.handle(handle).transform.axes[2], mesh.normals[vertex], atol=1e-9)


# --- errors


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"reach": 0}, r"Deformer.add: `reach` must be above 0, got 0"),
        ({"reach": "far"}, r"Deformer.add: `reach` must be \"part\" or a number above 0, got 'far'"),
        ({"falloff": "steep"}, r"Deformer.add: `falloff` must be one of linear, smooth, .*, got 'steep'"),
        ({"radius": 0}, r"Deformer.add: `radius` must be above 0, got 0"),
        ({"radius": "wide"}, r"Deformer.add: `radius` must be a length or a percentage such as 20%, got 'wide'"),
        ({"radius": 1, "locality": 1}, r"Deformer.add: `radius` and `locality` must not be given both, got 1 and 1"),
        ({"strength": 1.5}, r"Deformer.add: `strength` must be at most 1, got 1.5"),
        ({"counterparts": "all"}, r"Deformer.add: `counterparts` must be one of own_pivot, shared_pivot, got 'all'"),
        ({"mask": "y>0", "mask_feather": -1}, r"Deformer.add: `mask_feather` must be at least 0, got -1"),
        ({"mask": "y>0", "mask_feather": "wide"}, r"Deformer.add: `mask_feather` must be a length or a percentage"),
        ({"mask": "top"}, r"Deformer.add: `mask` must be a region, got 'top'"),
        ({"mask": "y>70"}, r"Deformer.add: `mask` must hold a vertex, but the side"),
        ({"axes": np.ones((3, 3))}, r"Deformer.add: `axes` must be 3 unit vectors at right angles"),
    ],
)
def test_odd_controls_are_refused_by_name(session, given, message):
    with pytest.raises(ValueError, match=message):
        session.add(given.pop("at", 5), **given)
    assert session.handles == ()


@pytest.mark.parametrize(
    ("verb", "given", "message"),
    [
        ("add", "stretch", "is not a motion or control of a handle; choose from translation, .*, reach, falloff"),
        ("add", "translate", "did you mean translation"),
        ("move", "rotate", "'rotate' is not a motion of a handle; .*did you mean rotation"),
        ("change", "reech", "'reech' is not a control of a handle; .*did you mean reach"),
        ("set_default", "translate", "'translate' is not a motion; .*did you mean translation"),
    ],
)
def test_names_that_are_not_settings_are_refused(session, verb, given, message):
    handle = session.add(5)
    first = {"add": [6], "set_default": []}.get(verb, [handle])
    with pytest.raises(TypeError, match=message):
        getattr(session, verb)(*first, **{given: 2})


def test_weights_that_fixed_points_subtract_are_their_largest(session, paper, chair, labeled, mesh):
    """A handle on a region keeps, at each of its vertices, what the fixed points leave there."""
    fixed = (3, 0.5), (900, 0.9), ("y>0.3", 0.8)
    for place, strength in fixed:
        session.fix(place, strength=strength)
    subtracted = session.bound.by_features.subtracted(session.fixed)
    wanted = np.zeros(len(mesh.vertices))
    for place, strength in fixed:
        chosen = np.flatnonzero(mesh.vertices[:, 1] >= 0.3) if place == "y>0.3" else [place]
        apart = np.linalg.norm(labeled[:, None] - labeled[chosen], axis=2).min(axis=1)
        wanted = np.maximum(wanted, strength * np.maximum(1 - apart, 0))
    np.testing.assert_allclose(subtracted, wanted, atol=0.03)  # a region is represented by 32 of its vertices
    on_region = mesh.vertices[:, 1] >= 0.3
    np.testing.assert_allclose(subtracted[on_region], np.maximum(wanted[on_region], 0.8), atol=1e-6)


def test_excluded_counterparts_are_places():
    for wrong in ((5,), [Place((0, 0, 0))], (Place((0, 0, 0), region=Ball((0, 0, 0), 1)),)):
        with pytest.raises(ValueError, match="`excluded_counterparts` must be places that are points"):
            Controls(excluded_counterparts=wrong)


def test_a_handle_without_strength_has_no_part_that_bends(session, foot):
    handle = session.add(foot, strength=0)
    assert bendable_parts(session.bound, session.edit, session.handle(handle)) == []
    with pytest.raises(ValueError, match="`open` needs a part with an axis"):
        session.move(handle, open=20)


def test_a_radius_and_a_locality_replace_each_other_and_nothing_else_does(session, foot):
    handle = session.add(foot, radius=0.3)
    for given, radius, locality in (
        ({"strength": 0.5}, 0.3, 0),
        ({"locality": 2.0}, None, 2.0),
        ({"falloff": "smooth"}, None, 2.0),
        ({"radius": 0.4}, 0.4, 0),
    ):
        session.change(handle, **given)
        controls = session.handle(handle).controls
        assert (controls.radius, controls.locality) == (radius, locality)
