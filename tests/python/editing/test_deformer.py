"""The editing session: what each change does to the shape, what it costs, and what is refused."""

import math
import re
import warnings
from unittest import mock

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import dfd
from dfd.editing import handle_weights, posed_shape
from dfd.editing.edit import Edit, Place, Transform
from dfd.field.field import Field
from dfd.posing.transforms import affine
from dfd.symmetry.plane import SymmetryPlane


@pytest.fixture(scope="module")
def mesh():
    return dfd.samples.chair(4000).mesh


@pytest.fixture(scope="module")
def field(mesh):
    """A field that has learnt nothing: enough to see what the session does with one."""
    with torch.random.fork_rng():
        torch.manual_seed(1)
        return Field(16, width=32, layers=2, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents)).eval()


@pytest.fixture(scope="module")
def features(mesh, field):
    return field.features(mesh)


@pytest.fixture
def deformer(mesh, field, features):
    return dfd.Deformer(mesh, field, features=features)


class Counting:
    """Geodesic distances that note what they were asked for, and are cheap."""

    def __init__(self, mesh):
        self.mesh, self.asked = mesh, []

    def distances(self, handles):
        self.asked.append(list(handles))
        lengths = np.linalg.norm(self.mesh.vertices[handles][:, None] - self.mesh.vertices, axis=2)
        return (lengths / lengths.max(axis=1, keepdims=True)).astype(np.float32)


@pytest.fixture
def geodesics(deformer, mesh):
    counting = Counting(mesh)
    deformer._weights.__dict__["_geodesics"] = counting
    return counting


@pytest.fixture
def bound():
    """How many handles each call of `bind` was for."""
    counts = []

    def counted(features, handles, **options):
        counts.append(len(handles))
        return dfd.bind(features, handles, **options)

    with mock.patch.object(handle_weights, "bind", counted):
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

    with mock.patch.object(posed_shape, "pose", whole), mock.patch.object(posed_shape, "Drag", drag):
        yield counts


def size(mesh):
    return mesh.diagonal


# --- the shape follows


def test_without_handles_the_shape_rests(deformer, mesh):
    np.testing.assert_array_equal(deformer.vertices, mesh.vertices)
    assert deformer.weights.shape == (len(mesh.vertices), 0)
    assert deformer.transforms.shape == (0, 3, 4)


@pytest.mark.parametrize("symmetry", [None, "x"])
def test_untransformed_handles_change_nothing_at_all(deformer, mesh, folds, symmetry):
    handles = [deformer.add(vertex) for vertex in (5, 6, 7)]
    deformer.add((0.1, 0.2, 0.3))
    deformer.set_symmetry(symmetry)
    assert deformer.weights.sum(axis=1).max() > 3
    np.testing.assert_array_equal(deformer.vertices, mesh.vertices)
    deformer.move(handles[0], translation=(0, 0.2, 0))
    assert np.abs(deformer.vertices - mesh.vertices).max() > 0.1
    deformer.move(handles[0], translation=(0, 0, 0), pivot=(3, 4, 5))
    np.testing.assert_array_equal(deformer.vertices, mesh.vertices)
    assert folds == [1]


@pytest.mark.parametrize("symmetry", [None, "x"])
def test_a_handle_at_rest_beside_a_moved_one_changes_nothing(deformer, mesh, symmetry):
    deformer.set_symmetry(symmetry)
    deformer.add(5, translation=(0, 0.2, 0), rotation=(0, 30, 0))
    alone = deformer.vertices
    deformer.add(6)
    deformer.add(900)
    np.testing.assert_allclose(deformer.vertices, alone, atol=1e-6 * size(mesh))
    deformer.set_default(scale=2)
    assert np.abs(deformer.vertices - alone).max() > 0.05


def test_handles_at_look_alikes_add_up(deformer, mesh):
    deformer.add(5, translation=(0, 0.2, 0))
    deformer.add(6, translation=(0, 0.1, 0))
    shift = deformer.weights @ np.array([0.2, 0.1], np.float32)
    np.testing.assert_allclose(deformer.vertices, mesh.vertices + np.outer(shift, (0, 1, 0)), atol=1e-6)


def test_the_session_is_bind_and_pose(deformer, mesh, features):
    deformer.add(5, translation=(0, 0.2, 0), rotation=(0, 30, 0))
    deformer.add(900, scale=(1, 2, 1))
    deformer.fix(6)
    transforms = [
        affine(translation=(0, 0.2, 0), rotation=(0, 30, 0), pivot=mesh.vertices[5]),
        affine(scale=(1, 2, 1), pivot=mesh.vertices[900]),
    ]
    weights = dfd.bind(features, [5, 900], fixed=[6])
    assert weights.sum(axis=1).max() <= 1
    np.testing.assert_array_equal(deformer.weights, weights)
    np.testing.assert_array_equal(deformer.transforms, transforms)
    np.testing.assert_array_equal(deformer.vertices, dfd.pose(mesh.vertices, weights, transforms))


def test_a_handle_turns_about_itself_unless_told_otherwise(deformer, mesh):
    handle = deformer.add(5, rotation=(0, 0, 90), scale=2)
    np.testing.assert_allclose(deformer.vertices[5], mesh.vertices[5], atol=1e-6)
    deformer.move(handle, pivot=(0, 0, 0))
    x, y, z = mesh.vertices[5]
    np.testing.assert_allclose(deformer.vertices[5], (-2 * y, 2 * x, 2 * z), atol=1e-5)
    deformer.move(handle, pivot="auto")
    assert deformer.handle(handle).pivot == tuple(mesh.vertices[5])


def test_a_handle_at_a_vertex_s_place_in_space_weighs_as_the_vertex_does(deformer, mesh):
    deformer.add(Place(tuple(mesh.vertices[70])))
    vertex = dfd.bind(deformer.features, [70])
    np.testing.assert_allclose(deformer.weights, vertex, atol=1e-3)


def test_the_default_transform_moves_what_no_handle_holds(deformer, mesh):
    deformer.set_default(scale=2)
    center = mesh.bounds.mean(axis=0)
    np.testing.assert_allclose(deformer.vertices, center + 2 * (mesh.vertices - center), atol=1e-5)
    deformer.set_default()
    assert deformer.default is None


def test_fixed_points_stay_and_can_be_released(deformer, mesh):
    deformer.add(5, translation=(0, 1, 0))
    deformer.fix(600)
    assert deformer.weights[600, 0] == 0
    np.testing.assert_allclose(deformer.vertices[600], mesh.vertices[600], atol=1e-6)
    deformer.release(600)
    assert deformer.fixed == ()
    assert deformer.weights[600, 0] > 0


def test_points_in_space_can_be_fixed_among_vertices(deformer, field, features):
    deformer.add(5)
    deformer.fix(600)
    deformer.fix((0.3, 0.1, 0.2))
    rows = np.concatenate([features[[600]], field(np.array([[0.3, 0.1, 0.2]]))])
    np.testing.assert_array_equal(deformer.weights, dfd.bind(deformer.features, [5], fixed=rows))
    deformer.release((0.3, 0.1, 0.2))
    assert [place.vertex for place in deformer.fixed] == [600]


def test_a_symmetric_edit_of_a_symmetric_shape_is_symmetric(mesh, field):
    # Features that do not tell left from right.
    folded = field(np.abs(mesh.vertices) * [1, 0, 0] + mesh.vertices * [0, 1, 1])
    deformer = dfd.Deformer(mesh, field, features=folded)
    deformer.add(int(mesh.vertices[:, 0].argmax()), translation=(0.1, 0.2, 0.0), rotation=(0, 20, 0))
    deformer.set_symmetry("x")
    assert deformer.symmetry.band == pytest.approx(0.03 * max(mesh.extents))
    order = np.lexsort(np.round(mesh.vertices * [-1, 1, 1], 6).T)
    mirror = np.empty(len(order), int)
    mirror[order] = np.lexsort(np.round(mesh.vertices, 6).T)
    np.testing.assert_allclose(deformer.vertices[mirror], deformer.vertices * [-1, 1, 1], atol=1e-5)
    deformer.set_symmetry(None)
    assert np.abs(deformer.vertices[mirror] - deformer.vertices * [-1, 1, 1]).max() > 0.05


def test_a_band_of_zero_is_equation_8(deformer, mesh):
    handle = deformer.add(5, translation=(0.3, 0, 0))
    deformer.set_symmetry("x", band=0)
    plane = SymmetryPlane((1.0, 0.0, 0.0), float(mesh.bounds.mean(axis=0)[0]))
    assert deformer.symmetry == plane
    wanted = dfd.pose(mesh.vertices, deformer.weights, [deformer.handle(handle).matrix], symmetry=plane, handles=[5])
    np.testing.assert_array_equal(deformer.vertices, wanted)


def test_any_plane_can_be_one_of_symmetry(deformer):
    plane = SymmetryPlane((0.0, 0.6, 0.8), 0.1, band=0.2)
    deformer.set_symmetry(plane)
    assert deformer.symmetry == plane


def test_auto_takes_the_plane_that_looks_most_alike(deformer, mesh, field):
    planes = [SymmetryPlane((0.0, 0.0, 1.0), 0.5, 0.02), SymmetryPlane((1.0, 0.0, 0.0), 0.0, 0.05)]
    with mock.patch("dfd.editing.edit.symmetry_planes", return_value=planes):
        deformer.set_symmetry("auto")
    assert deformer.symmetry.normal == (0.0, 0.0, 1.0)
    assert deformer.symmetry.band > 0
    with (
        mock.patch("dfd.editing.edit.symmetry_planes", return_value=[]),
        pytest.raises(ValueError, match="looks alike across no axis plane"),
    ):
        deformer.set_symmetry("auto")


def test_results_are_read_only_and_the_mesh_stays(deformer, mesh):
    before = mesh.vertices.copy()
    deformer.add(5, translation=(1, 2, 3))
    for array in (deformer.vertices, deformer.weights):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    np.testing.assert_array_equal(mesh.vertices, before)


# --- live handles


def test_handles_are_re_edited_from_the_resting_shape_never_baked(deformer):
    handle = deformer.add(5, translation=(0, 0.5, 0))
    once = deformer.vertices
    deformer.move(handle, translation=(1, 1, 1), rotation=(10, 20, 30), scale=3)
    deformer.move(handle, translation=(0, 0.5, 0), rotation=(0, 0, 0), scale=1)
    np.testing.assert_array_equal(deformer.vertices, once)


def test_a_removed_handle_leaves_nothing_behind(deformer):
    deformer.add(5, translation=(0, 0.5, 0))
    alone = deformer.vertices
    other = deformer.add(900, scale=3)
    deformer.remove(other)
    np.testing.assert_array_equal(deformer.vertices, alone)


def test_ids_are_stable_and_never_given_twice(deformer):
    first, second, third = (deformer.add(vertex, name=f"n{vertex}") for vertex in (1, 2, 3))
    deformer.remove(second)
    assert [handle.id for handle in deformer.handles] == [first, third]
    assert deformer.handle(third).name == "n3"
    deformer.undo()
    deformer.undo()
    assert deformer.add(9) not in (first, second, third)


def test_what_is_left_out_of_a_move_stays(deformer):
    handle = deformer.add(5, translation=(1, 2, 3), rotation=(0, 0, 5), scale=2, locality=0, name="foot")
    deformer.move(handle, rotation=(0, math.sin(0.5), 0, math.cos(0.5)))
    kept = deformer.handle(handle)
    assert kept.transform.translation == (1, 2, 3)
    assert kept.transform.scale == (2, 2, 2)
    assert kept.name == "foot"
    np.testing.assert_allclose(kept.transform.rotation, (0, math.degrees(1), 0))


def test_a_handle_can_sit_elsewhere_and_its_pivot_comes_along(deformer, mesh):
    handle = deformer.add(5, rotation=(0, 0, 90))
    deformer.change(handle, at=900, name="seat")
    np.testing.assert_allclose(deformer.vertices[900], mesh.vertices[900], atol=1e-6)
    assert deformer.handle(handle).place.vertex == 900
    assert deformer.handle(handle).name == "seat"


# --- what it costs


def test_a_move_binds_nothing_and_a_new_handle_binds_itself(deformer, bound):
    first = deformer.add(5)
    _ = deformer.vertices
    for angle in range(5):
        deformer.move(first, rotation=(0, 0, angle))
        _ = deformer.vertices
    assert bound == [1]
    second = deformer.add(900, scale=2)
    _ = deformer.vertices
    third = deformer.add((0.5, 0.5, 0.5), scale=2)
    _ = deformer.vertices
    assert bound == [1, 1, 1]
    deformer.remove(second)
    _ = deformer.vertices
    assert bound == [1, 1, 1]
    np.testing.assert_array_equal(deformer.weights[:, 0], dfd.bind(deformer.features, [5])[:, 0])
    assert deformer.handles[1].id == third
    assert deformer.weights.shape[1] == 2


def test_nothing_is_bound_before_somebody_looks(deformer, bound):
    for vertex in range(10):
        deformer.add(vertex)
    deformer.fix(100)
    assert bound == []
    _ = deformer.vertices  # nothing moves yet
    assert bound == []
    _ = deformer.weights
    assert bound == [10]


def test_one_call_binds_what_it_can(deformer, bound, geodesics, features, field):
    for at in (1, 2, (0.1, 0.2, 0.3), (0.2, 0.1, 0.3), 3):
        deformer.add(at)
    for vertex in (4, 5):
        deformer.add(vertex, locality=2.0)
    weights = deformer.weights
    assert bound == [2, 2, 1, 1, 1]
    points = field(np.array([(0.1, 0.2, 0.3), (0.2, 0.1, 0.3)]))
    np.testing.assert_array_equal(weights[:, [0, 1, 4]], dfd.bind(features, [1, 2, 3]))
    np.testing.assert_array_equal(weights[:, 2:4], dfd.bind(features, points))
    near = dfd.bind(features, [4, 5], geodesic=geodesics.distances([4, 5]), locality=2.0)
    np.testing.assert_array_equal(weights[:, 5:], near)


def test_new_fixed_points_bind_all_handles_once(deformer, bound):
    for vertex in (5, 6, 7):
        deformer.add(vertex)
    _ = deformer.weights
    deformer.fix(100)
    _ = deformer.weights
    _ = deformer.vertices
    assert bound == [3, 3]


def test_looking_twice_costs_nothing(deformer):
    deformer.add(5, scale=2)
    assert deformer.vertices is deformer.vertices
    assert deformer.weights is deformer.weights


def test_features_are_asked_for_once_and_only_when_needed(mesh, field):
    with mock.patch.object(Field, "features", return_value=field.features(mesh)) as asked:
        deformer = dfd.Deformer(mesh, field)
        deformer.add(5, scale=2)
        asked.assert_not_called()
        _ = deformer.vertices
        deformer.add(6)
        _ = deformer.vertices
        deformer.prepare()
        asked.assert_called_once()


def test_a_drag_costs_what_moves_and_gives_what_a_pose_gives(mesh, field, features, folds):
    for symmetry, default in ((None, None), ("x", None), (None, (0, 0, 5)), ("x", (0, 0, 5))):
        deformer = dfd.Deformer(mesh, field, features=features)
        handles = [deformer.add(vertex, translation=(0, 0.01 * vertex, 0)) for vertex in (5, 6, 7, 8, 9)]
        deformer.set_symmetry(symmetry)
        deformer.set_default(rotation=default)
        assert deformer.weights.sum(axis=1).max() > 4
        start = deformer.vertices
        del folds[:]
        for frame in range(1, 4):
            deformer.move(handles[2], rotation=(0, 10 * frame, 0), scale=1 + 0.1 * frame, merge=frame > 1)
            dragged = deformer.vertices
        assert folds == [1]
        whole = dfd.Deformer(mesh, field, features=features)
        whole.apply(deformer.edit)
        np.testing.assert_allclose(dragged, whole.vertices, rtol=0, atol=1e-12)
        assert np.abs(dragged - start).max() > 0.05
        deformer.undo()
        np.testing.assert_allclose(deformer.vertices, start, rtol=0, atol=1e-12)
        deformer.redo()
        np.testing.assert_allclose(deformer.vertices, dragged, rtol=0, atol=1e-12)


def test_a_drag_ends_with_whatever_else_changes(deformer, mesh, field, features, folds):
    handles = [deformer.add(vertex) for vertex in (5, 6, 7, 8, 9)]
    deformer.add(900, translation=(0.1, 0, 0))
    changes = (
        lambda: deformer.move(handles[0], scale=2),
        lambda: deformer.move(handles[0], scale=1.5),
        lambda: deformer.move(handles[1], scale=2),
        lambda: deformer.change(handles[1], at=10),
        lambda: deformer.move(handles[1], scale=3),
        lambda: deformer.fix(1500),
        lambda: deformer.move(handles[1], scale=1.2),
        lambda: deformer.set_symmetry("x"),
        lambda: deformer.move(handles[1], scale=1.1),
        lambda: deformer.set_default(translation=(0, 0, 1)),
        lambda: deformer.remove(handles[3]),
        lambda: deformer.change(handles[2], name="knee"),
    )
    _ = deformer.vertices
    for change in changes:
        change()
        moved = deformer.vertices
        fresh = dfd.Deformer(mesh, field, features=features)
        fresh.apply(deformer.edit)
        with mock.patch.object(posed_shape, "pose", dfd.pose):
            np.testing.assert_allclose(moved, fresh.vertices, rtol=0, atol=1e-12)
    assert folds == [-1, 1, 1, -1, 1, -1, 1, -1, 1, -1, -1]


def test_what_moves_nearly_whole_is_posed_whole(deformer, folds):
    first, second = deformer.add(5), deformer.add(6)
    _ = deformer.vertices
    for frame in range(1, 3):
        with deformer.step():
            deformer.move(first, scale=1 + frame)
            deformer.move(second, scale=1 + frame)
        _ = deformer.vertices
    deformer.remove(second)
    _ = deformer.vertices
    deformer.move(first, scale=1)
    deformer.move(first, scale=2)
    _ = deformer.vertices
    assert folds == [-1, -1, -1, -1]


def test_handles_that_rest_come_and_go_for_nothing(deformer, folds, bound):
    deformer.add(5, translation=(0, 0.2, 0))
    second = deformer.add(6)
    moved = deformer.vertices
    deformer.add(7, pivot=(1, 2, 3))
    assert deformer.vertices is moved
    deformer.remove(second)
    assert deformer.vertices is moved
    assert (folds, bound) == ([-1], [2])
    deformer.set_default(scale=2)
    held = deformer.vertices
    deformer.add(900)
    assert np.abs(deformer.vertices - held).max() > 0.05


def test_several_handles_can_be_dragged_at_once(deformer, mesh, field, features, folds):
    handles = [deformer.add(vertex) for vertex in (5, 6, 900, 8, 9)]
    deformer.move(handles[4], translation=(0.1, 0, 0))
    _ = deformer.vertices
    for frame in range(1, 4):
        with deformer.step():
            deformer.move(handles[0], translation=(0, 0.1 * frame, 0))
            deformer.move(handles[2], rotation=(0, 0, 9 * frame))
        _ = deformer.vertices
    deformer.move(handles[2], rotation=(0, 0, 5))
    moved = deformer.vertices
    assert folds == [-1, 2]
    fresh = dfd.Deformer(mesh, field, features=features)
    fresh.apply(deformer.edit)
    np.testing.assert_allclose(moved, fresh.vertices, rtol=0, atol=1e-12)


# --- columns of weights


def test_a_new_handle_touches_no_other_column(deformer):
    deformer.add(5)
    first = deformer.weights
    deformer.add(6)
    both = deformer.weights
    assert np.shares_memory(first, both[:, :1])
    assert not np.shares_memory(first, both[:, 1:])
    assert both[:, 0].flags.c_contiguous
    assert both[:, 1].flags.c_contiguous


def test_weights_that_somebody_holds_stay_as_they_are(deformer):
    second = [deformer.add(vertex) for vertex in (5, 6, 7)][1]
    changes = (
        lambda: deformer.remove(second),
        lambda: deformer.undo(),
        lambda: deformer.change(second, at=900),
        lambda: deformer.fix(1500),
        lambda: deformer.undo(),
        lambda: deformer.apply(Edit(handles=deformer.handles[::-1])),
        lambda: deformer.apply(Edit()),
        lambda: deformer.add(8),
        lambda: deformer.add(9),
    )
    held = []
    for change in changes:
        held += [(array, array.copy()) for array in (deformer.weights, deformer.weights[:, -1:])]
        change()
    _ = deformer.weights
    for array, copy in held:
        np.testing.assert_array_equal(array, copy)


def test_weights_that_nobody_holds_make_room_in_their_place(deformer):
    second = [deformer.add(vertex) for vertex in (5, 6, 7)][1]
    first = deformer.weights.__array_interface__["data"]
    deformer.remove(second)
    assert deformer.weights.__array_interface__["data"] == first
    deformer.undo()
    assert deformer.weights.__array_interface__["data"] == first


def test_handles_may_come_in_another_order(deformer, features):
    for vertex in (5, 6, 7):
        deformer.add(vertex)
    assert deformer.weights.shape == (len(features), 3)
    deformer.apply(Edit(handles=deformer.handles[::-1]))
    np.testing.assert_array_equal(deformer.weights, dfd.bind(features, [7, 6, 5]))


STEPS = st.sampled_from(["add", "remove", "change", "turn", "undo", "redo", "look", "hold"])


@given(st.lists(st.tuples(STEPS, st.integers(0))))
def test_weights_are_those_of_the_handles_whatever_was_done_before(steps):
    features = FEW.features(SMALL)
    deformer = dfd.Deformer(SMALL, FEW, features=features)
    held = []
    for step, number in steps:
        taken = [handle.place.vertex for handle in deformer.handles]
        free = [vertex for vertex in range(len(SMALL.vertices)) if vertex not in taken]
        if step == "add":
            deformer.add(free[number % len(free)])
        elif step == "remove" and taken:
            deformer.remove(deformer.handles[number % len(taken)].id)
        elif step == "change" and taken:
            deformer.change(deformer.handles[number % len(taken)].id, at=free[number % len(free)])
        elif step == "turn":
            deformer.apply(Edit(handles=deformer.handles[::-1]))
        elif step == "undo":
            deformer.undo()
        elif step == "redo":
            deformer.redo()
        elif step == "hold":
            held.append((deformer.weights, deformer.weights.copy()))
        elif step == "look":
            now = [handle.place.vertex for handle in deformer.handles]
            np.testing.assert_array_equal(deformer.weights, dfd.bind(features, now))
    now = [handle.place.vertex for handle in deformer.handles]
    np.testing.assert_array_equal(deformer.weights, dfd.bind(features, now))
    for array, copy in held:
        np.testing.assert_array_equal(array, copy)


SMALL = dfd.Mesh(np.random.default_rng(0).standard_normal((40, 3)), [[0, 1, 2]])
FEW = Field.seeded(0, 4, width=8, layers=1, center=SMALL.bounds.mean(0), scale=2 / max(SMALL.extents))


def test_the_memory_of_many_handles_is_given_back(deformer):
    with deformer.step():
        for vertex in range(100):
            deformer.add(vertex)
    _ = deformer.weights
    many = deformer._weights._columns._rows.nbytes
    deformer.apply(Edit())
    _ = deformer.weights
    assert deformer._weights._columns._rows.nbytes < many / 5


# --- compact features


@pytest.fixture
def compacted():
    """Every shape is one of many vertices."""
    with (
        mock.patch.object(handle_weights, "MOST_EXACT", 100),
        mock.patch.object(Field, "features", side_effect=AssertionError),
    ):
        yield


def test_many_vertices_bind_from_compact_features(compacted, mesh, field, features):
    deformer = dfd.Deformer(mesh, field)
    for vertex in (5, 900, 1500):
        deformer.add(vertex, translation=(0, 0.1, 0))
    deformer.add(mesh.vertices[70], scale=2)
    deformer.add((0.3, 0.1, 0.2))
    places = np.concatenate([features[[5, 900, 1500, 70]], field(np.array([(0.3, 0.1, 0.2)]))])
    for fixed in (None, 600, (0.1, 0.2, 0.3)):
        if fixed is not None:
            deformer.fix(fixed)
        rows = {
            None: None,
            600: features[[600]],
            (0.1, 0.2, 0.3): np.concatenate([features[[600]], field(np.array([(0.1, 0.2, 0.3)]))]),
        }[fixed]
        exact = dfd.bind(features, places, fixed=rows)
        assert 0 < np.abs(deformer.weights - exact).max() <= (0.01 if fixed is None else 0.02)  # W less W of the fixed
    assert isinstance(deformer.features, dfd.CompactFeatures)
    assert deformer.features.error <= 0.01
    np.testing.assert_array_equal(deformer.weights[600], 0)
    exactly = dfd.Deformer(mesh, field, features=features)
    exactly.apply(deformer.edit)
    np.testing.assert_allclose(deformer.vertices, exactly.vertices, atol=0.02 * size(mesh))


def test_a_vertex_that_is_held_weighs_1_whatever_binds_it(compacted, mesh, field):
    for tolerance, precision in ((0.01, None), (0.05, "int8"), (0.002, "float16")):
        compact = dfd.compact(field, mesh.vertices, tolerance=tolerance)
        assert precision is None or compact.precision == precision
        deformer = dfd.Deformer(mesh, field, features=compact)
        assert deformer.features is compact
        deformer.add((0.3, 0.1, 0.2))
        vertices = list(range(0, len(mesh.vertices), 100))
        for vertex in vertices:
            deformer.add(vertex)
        np.testing.assert_array_equal(deformer.weights[vertices, np.arange(1, 1 + len(vertices))], 1)
        np.testing.assert_array_equal(deformer.vertices, mesh.vertices)


@pytest.mark.parametrize("most_exact", [100, 10_000])
def test_preparing_tells_how_far_it_is(mesh, field, most_exact):
    done = []
    with mock.patch.object(handle_weights, "MOST_EXACT", most_exact):
        deformer = dfd.Deformer(mesh, field)
        deformer.prepare(done.append)
        deformer.prepare(done.append)
    assert sum(done) == len(mesh.vertices)
    assert isinstance(deformer.features, dfd.CompactFeatures) == (most_exact == 100)


def test_compact_features_of_another_shape_are_refused(mesh, field, features):
    with pytest.raises(ValueError, match=r"Deformer: `features` must have shape \(2004, 16\), got \(2003, 16\)"):
        dfd.Deformer(mesh, field, features=dfd.compact(features[1:]))


# --- a field of another shape


def moved(mesh, factor=1.0, shift=(0.0, 0.0, 0.0)):
    """The mesh in other units and at another place; a shift of 1 is its longest side."""
    return dfd.Mesh(factor * mesh.vertices + np.array(shift) * max(mesh.extents), mesh.faces)


@pytest.mark.parametrize(
    "stranger",
    [
        lambda mesh: moved(mesh, 100),
        lambda mesh: moved(mesh, 0.01),
        lambda mesh: moved(mesh, 2.54),
        lambda mesh: moved(mesh, 1 / 2.54),
        lambda mesh: moved(mesh, 1, (0, 3, 0)),
        lambda mesh: moved(mesh, 1, (-1.6, 0, 0)),
    ],
)
def test_a_field_of_another_shape_is_refused(mesh, field, features, stranger):
    other = stranger(mesh)
    message = (
        "Deformer: `field` must belong to this mesh, but it was distilled from a shape with a longest side of 0.9897 "
        f"around (0, 0.526, -0.007948), and this mesh has one of {max(other.extents):.4g} around "
    )
    with pytest.raises(ValueError, match=re.escape(message) + r"\(.*\): bring the mesh to that shape's units"):
        dfd.Deformer(other, field)
    dfd.Deformer(other, field, features=features)  # whoever brings features knows what they are


@pytest.mark.parametrize(
    "relative",
    [
        lambda mesh: dfd.samples.chair(9000).mesh,
        lambda mesh: moved(mesh, 1.2),
        lambda mesh: moved(mesh, 0.6),
        lambda mesh: moved(mesh, 1, (0.2, 0, 0)),
        lambda mesh: dfd.Mesh(mesh.vertices[mesh.vertices[:, 1] > 0.4], [[0, 1, 2]]),
        lambda mesh: dfd.Mesh(mesh.vertices - (mesh.vertices[:, 1:2] < 0.4) * [0, 0.2, 0], mesh.faces),
    ],
)
def test_relatives_of_the_field_s_shape_are_welcome(mesh, field, relative):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        deformer = dfd.Deformer(relative(mesh), field)
    deformer.add(0, scale=2)
    assert np.isfinite(deformer.vertices).all()


def test_a_mesh_that_reaches_far_out_of_the_field_s_box_is_told_so(mesh, field):
    standing = moved(mesh, 1, -np.array([0, mesh.bounds[0, 1], 0]) / max(mesh.extents))
    ground = Field(16, center=standing.bounds.mean(0), scale=2 / max(standing.extents))
    dfd.Deformer(standing, ground)
    lying = dfd.Mesh(standing.vertices @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]], mesh.faces)
    with pytest.warns(UserWarning, match=r"weights beyond that shape's box are a guess\. Unless the mesh is a pose"):
        dfd.Deformer(lying, ground)


# --- what geodesics are asked


def test_geodesics_are_for_those_who_ask_for_locality(deformer, geodesics, bound):
    near, far = deformer.add(5), deformer.add(900)
    _ = deformer.vertices
    assert geodesics.asked == []
    deformer.move(far, scale=2)
    _ = deformer.vertices
    deformer.change(near, locality=2.0)
    _ = deformer.weights
    assert geodesics.asked == [[5]]
    assert bound == [2, 1]
    deformer.change(near, locality=4.0)
    _ = deformer.weights
    deformer.fix(100)
    _ = deformer.weights
    assert geodesics.asked == [[5]]
    assert deformer.handle(far).locality == 0


def test_locality_is_each_handle_s_own(deformer, geodesics, mesh):
    deformer.add(5, locality=3.0)
    deformer.add(900)
    wanted = dfd.bind(deformer.features, [5, 900], geodesic=geodesics.distances([5, 900]), locality=[3.0, 0.0])
    np.testing.assert_array_equal(deformer.weights, wanted)


def test_a_point_s_distances_start_at_the_nearest_vertex(deformer, geodesics, mesh):
    deformer.add(mesh.vertices[70] + 1e-4, locality=1.0)
    _ = deformer.weights
    assert geodesics.asked == [[70]]


def test_locality_of_a_symmetric_edit_starts_at_both_mirror_images(deformer, geodesics, bound, mesh):
    vertex = int(mesh.vertices[:, 0].argmax())
    mirrored = int(np.linalg.norm(mesh.vertices - mesh.vertices[vertex] * [-1, 1, 1], axis=1).argmin())
    deformer.add(vertex, locality=3.0)
    deformer.add(5)
    _ = deformer.weights
    deformer.set_symmetry("x")
    both = geodesics.distances([vertex, mirrored]).min(axis=0)
    wanted = dfd.bind(deformer.features, [vertex], geodesic=both[None], locality=3.0)
    np.testing.assert_array_equal(deformer.weights[:, :1], wanted)
    assert bound == [1, 1, 1]


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


def test_a_drag_is_one_step(deformer):
    handle = deformer.add(5)
    deformer.move(handle, translation=(0, 0.1, 0))
    for height in (0.2, 0.3, 0.4):
        deformer.move(handle, translation=(0, height, 0), merge=True)
    deformer.undo()
    assert deformer.handle(handle).transform == Transform()
    assert len(deformer.handles) == 1
    deformer.redo()
    assert deformer.handle(handle).transform.translation == (0, 0.4, 0)


def test_drags_of_two_handles_are_two_steps(deformer):
    first, second = deformer.add(5), deformer.add(6)
    deformer.move(first, scale=2)
    deformer.move(second, scale=3, merge=True)
    deformer.undo()
    assert deformer.handle(first).transform.scale == (2, 2, 2)


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
            deformer.add(-1)

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
    again._weights.__dict__["_geodesics"] = geodesics
    assert again.edit == deformer.edit
    assert not again.can_undo
    np.testing.assert_array_equal(again.vertices, deformer.vertices)
    assert again.add(7) not in [handle.id for handle in deformer.handles]


def test_an_edit_holds_on_another_resolution(deformer, mesh, field, tmp_path):
    deformer.add(5, translation=(0, 0.2, 0))
    deformer.add(900, rotation=(0, 20, 0))
    deformer.fix(1500)
    deformer.save(tmp_path / "edit.json")
    # Every face in three, the new vertices first.
    centers = mesh.vertices[mesh.faces].mean(axis=1)
    count = len(centers)
    corners = mesh.faces + count
    fans = [np.column_stack([corners[:, i], corners[:, i - 2], np.arange(count)]) for i in range(3)]
    finer = dfd.Mesh(np.concatenate([centers, mesh.vertices]), np.concatenate(fans))
    moved = dfd.Deformer.load(tmp_path / "edit.json", finer, field)
    assert [handle.place.vertex for handle in moved.handles] == [None, None]
    np.testing.assert_allclose(moved.vertices[count:], deformer.vertices, atol=1e-3 * size(mesh))
    assert np.abs(deformer.vertices - mesh.vertices).max() > 0.1


# --- what is refused


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.add(10**6), r"Deformer.add: `at` must lie in 0 … \d+, got 1000000"),
        (lambda d: d.add(-1), r"Deformer.add: `at` must lie in 0"),
        (lambda d: d.add(1.5), r"Deformer.add: `at` must be a vertex index or a point, got 1.5"),
        (lambda d: d.add((0, 0, math.nan)), r"Deformer.add: `at` must be finite"),
        (lambda d: d.add(5), r"`handles` must lie at distinct places, got two at 5"),
        (lambda d: d.add(6), r"`fixed` must be free places, but 6 is handle"),
        (lambda d: d.add(7, locality=-1), r"Deformer.add: `locality` must be at least 0, got -1"),
        (lambda d: d.add(7, locality=math.nan), r"Deformer.add: `locality` must be finite, got nan"),
        (lambda d: d.add(7, name=""), r"Deformer.add: `name` must be a text that is not empty, got ''"),
        (lambda d: d.add(7, name=3), r"Deformer.add: `name` must be a text"),
        (lambda d: d.add(7, scale=(1, 2)), r"Deformer.add: `scale` must be one number or 3"),
        (lambda d: d.add(7, scale=1e308, pivot=(10, 0, 0)), r"the matrix is not finite"),
        (lambda d: d.move(99, scale=2), r"Deformer.move: `handle` must be the id of a handle \(1\), got 99"),
        (lambda d: d.move(1, translation=(0, math.inf, 0)), r"Deformer.move: `translation` must be finite"),
        (lambda d: d.move(1, rotation=(0, 0)), r"Deformer.move: `rotation` must be a rotation vector"),
        (lambda d: d.move(1, pivot="centre"), r"Deformer.move: `pivot` must be a numeric array"),
        (lambda d: d.change(99), r"Deformer.change: `handle` must be the id of a handle"),
        (lambda d: d.change(1, at=6), r"`fixed` must be free places, but 6 is handle 1 already"),
        (lambda d: d.change(1, locality=-2), r"Deformer.change: `locality` must be at least 0"),
        (lambda d: d.remove(99), r"Deformer.remove: `handle` must be the id of a handle"),
        (lambda d: d.handle(99), r"Deformer.handle: `handle` must be the id of a handle"),
        (lambda d: d.fix(6), r"`fixed` must be free places, but 6 is fixed already"),
        (lambda d: d.fix(5), r"`fixed` must be free places, but 5 is handle 1 already"),
        (lambda d: d.fix("seat"), r"Deformer.fix: `at` must be a vertex index or a point, got 'seat'"),
        (lambda d: d.release(8), r"Deformer.release: `at` must be a fixed point, got 8"),
        (lambda d: d.set_symmetry("w"), r"Deformer.set_symmetry: `plane` must be x, y, z or a SymmetryPlane"),
        (lambda d: d.set_symmetry("x", band=-1), r"Deformer.set_symmetry: `band` must be at least 0"),
        (lambda d: d.set_default(scale=math.nan), r"Deformer.set_default: `scale` must be finite"),
        (lambda d: d.apply(Edit(fixed=(Place((0.0, 0.0, 0.0), 10**6),))), r"Deformer.apply: `edit` must lie in 0"),
    ],
)
def test_what_is_refused_changes_nothing(deformer, change, message):
    deformer.add(5)
    deformer.fix(6)
    before = deformer.edit
    with pytest.raises(ValueError, match=message):
        change(deformer)
    assert deformer.edit is before


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda rows: rows[:-1], r"Deformer: `features` must have shape \(\d+, 16\), got"),
        (lambda rows: rows[:, :-1], r"Deformer: `features` must have shape"),
        (lambda rows: rows * np.nan, r"Deformer: `features` must be finite"),
        (lambda rows: rows.astype(str), r"Deformer: `features` must be a numeric array"),
    ],
)
def test_features_that_do_not_fit_are_refused(mesh, field, features, spoil, message):
    with pytest.raises(ValueError, match=message):
        dfd.Deformer(mesh, field, features=spoil(features))


def test_it_says_what_it_holds(deformer):
    deformer.add(5)
    deformer.fix(6)
    assert repr(deformer).endswith("1 handles, 1 fixed points)")
