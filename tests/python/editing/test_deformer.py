"""Test the effect of each change of a session on the shape, and its errors."""

import math
import re
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dfd
from dfd.editing.edit import Edit, Fixed, symmetry_on
from dfd.editing.points import Place
from dfd.symmetry.plane import SymmetryPlane

# --- posed vertices


def test_without_handles_the_shape_rests(deformer, mesh):
    np.testing.assert_array_equal(deformer.vertices, mesh.vertices)
    assert deformer.weights.shape == (len(mesh.vertices), 0)
    assert deformer.transforms.shape == (0, 3, 4)


@pytest.mark.parametrize("symmetry", [None, "x"])
def test_untransformed_handles_change_nothing_at_all(deformer, mesh, folds, symmetry):
    handles = [deformer.add(vertex, reach=1.0, counterparts="shared_pivot") for vertex in (5, 6, 7)]
    deformer.add((0.1, 0.2, 0.3), reach=1.0)
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
    np.testing.assert_allclose(deformer.vertices, alone, atol=1e-6 * mesh.diagonal)
    deformer.set_default(scale=2)
    assert np.abs(deformer.vertices - alone).max() > 0.05


def test_a_handle_turns_about_the_pivot_that_it_is_told(deformer, mesh):
    handle = deformer.add(5, rotation=(0, 0, 90), scale=2, pivot="point")
    np.testing.assert_allclose(deformer.vertices[5], mesh.vertices[5], atol=1e-6)
    deformer.move(handle, pivot=(0, 0, 0))
    x, y, z = mesh.vertices[5]
    np.testing.assert_allclose(deformer.vertices[5], (-2 * y, 2 * x, 2 * z), atol=1e-5)
    deformer.move(handle, pivot="point")
    assert deformer.handle(handle).pivot == tuple(mesh.vertices[5])


def test_the_default_transform_moves_what_no_handle_holds(deformer, mesh):
    deformer.set_default(scale=2)
    center = mesh.bounds.mean(axis=0)
    np.testing.assert_allclose(deformer.vertices, center + 2 * (mesh.vertices - center), atol=1e-5)
    deformer.set_default()
    assert deformer.default is None


def test_fixed_points_stay_and_can_be_released(deformer, mesh):
    deformer.add(5, translation=(0, 1, 0))
    deformer.fix(20)
    assert deformer.weights[20, 0] == 0
    np.testing.assert_allclose(deformer.vertices[20], mesh.vertices[20], atol=1e-6)
    deformer.release(20)
    assert deformer.fixed == ()
    assert deformer.weights[20, 0] > 0


def test_a_symmetric_edit_of_a_symmetric_shape_is_symmetric(mesh, field):
    # These features are equal on the left and on the right.
    folded = field(np.abs(mesh.vertices) * [1, 0, 0] + mesh.vertices * [0, 1, 1])
    deformer = dfd.Deformer(mesh, field, features=folded)
    deformer.add(int(mesh.vertices[:, 0].argmax()), translation=(0.1, 0.2, 0.0), rotation=(0, 20, 0), reach=0.7)
    deformer.set_symmetry("x")
    assert deformer.symmetry.band == pytest.approx(0.03 * max(mesh.extents))
    order = np.lexsort(np.round(mesh.vertices * [-1, 1, 1], 6).T)
    mirror = np.empty(len(order), int)
    mirror[order] = np.lexsort(np.round(mesh.vertices, 6).T)
    np.testing.assert_allclose(deformer.vertices[mirror], deformer.vertices * [-1, 1, 1], atol=1e-5)
    assert np.abs(deformer.vertices - mesh.vertices)[mesh.vertices[:, 0] < 0].max() > 0.05


def test_a_plane_beside_the_shape_is_refused(deformer):
    with pytest.raises(ValueError, match="Deformer.set_symmetry: `plane` must cut the shape, but all vertices lie"):
        deformer.set_symmetry("x=100")


def test_without_a_field_auto_is_no_plane(mesh):
    with pytest.raises(ValueError, match=r"`plane` must .*, got 'auto'"):
        symmetry_on(mesh, "auto")


def test_auto_takes_the_plane_that_looks_most_alike(deformer, mesh, field):
    planes = [SymmetryPlane((0.0, 0.6, 0.8), 0.5, 0.02, band=0.1), SymmetryPlane((1.0, 0.0, 0.0), 0.0, 0.05)]
    with mock.patch("dfd.editing.edit.symmetry_planes", return_value=planes):
        deformer.set_symmetry("auto")
    assert deformer.symmetry == replace(planes[0], band=0.03 * max(mesh.extents))
    with (
        mock.patch("dfd.editing.edit.symmetry_planes", return_value=[]),
        pytest.raises(ValueError, match="no plane has two sides that look alike"),
    ):
        deformer.set_symmetry("auto")


def test_results_are_read_only_and_the_mesh_stays(deformer, mesh):
    before = mesh.vertices.copy()
    deformer.add(5, translation=(1, 2, 3))
    for array in (deformer.vertices, deformer.weights):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    np.testing.assert_array_equal(mesh.vertices, before)


# --- changes of handles


def test_ids_are_stable_and_never_given_twice(deformer):
    first, second, third = (deformer.add(vertex, name=f"n{vertex}") for vertex in (1, 2, 3))
    deformer.remove(second)
    assert [handle.id for handle in deformer.handles] == [first, third]
    assert deformer.handle(third).name == "n3"
    deformer.undo()
    deformer.undo()
    assert deformer.add(9) not in (first, second, third)
    deformer.apply(replace(deformer.edit, handles=(replace(deformer.handles[0], id=70),)))
    assert deformer.add(11) == 71


def test_what_is_left_out_of_a_move_stays(deformer):
    handle = deformer.add(5, translation=(1, 2, 3), rotation=(0, 0, 5), scale=2, locality=0, name="foot")
    deformer.move(handle, rotation=(0, math.sin(0.5), 0, math.cos(0.5)))
    kept = deformer.handle(handle)
    assert kept.transform.translation == (1, 2, 3)
    assert kept.transform.scale == (2, 2, 2)
    assert kept.name == "foot"
    np.testing.assert_allclose(kept.transform.rotation, (0, math.degrees(1), 0))


def test_a_handle_can_sit_elsewhere_and_its_pivot_comes_along(deformer, mesh):
    handle = deformer.add(5, rotation=(0, 0, 90), pivot="point")
    deformer.change(handle, at=900, name="seat")
    np.testing.assert_allclose(deformer.vertices[900], mesh.vertices[900], atol=1e-6)
    assert deformer.handle(handle).place.vertex == 900
    assert deformer.handle(handle).name == "seat"
    deformer.change(handle, at=901)
    assert deformer.handle(handle).name == "seat"


# --- errors


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.add(10**6), r"Deformer.add: `at` must lie in 0 … \d+, got 1000000"),
        (lambda d: d.add(1.5), r"Deformer.add: `at` must be a vertex index, a point, a region or a text, got 1.5"),
        (lambda d: d.add((0, 0, math.nan)), r"Deformer.add: `at` must be finite"),
        (lambda d: d.add(5), r"`handles` must lie at distinct places, got two at 5"),
        (lambda d: d.add(d.mesh.vertices[5]), r"`handles` must lie at distinct places, got two at"),
        (lambda d: d.add(6), r"`fixed` must be at unused places, but the place 6 is already used by handle"),
        (lambda d: d.add(7, locality=-1), r"Deformer.add: `locality` must be at least 0, got -1"),
        (lambda d: d.add(7, name=""), r"Deformer.add: `name` must be a text that is not empty, got ''"),
        (lambda d: d.add(7, scale=1e39), r"Deformer.add: `scale` must be numbers of at most 1e\+38, got 1e\+39"),
        (lambda d: d.set_symmetry("x=1e39"), r"Deformer.set_symmetry: `plane` must be at most 1e\+38"),
        (lambda d: d.add("component@" * 5000 + "5"), r"Deformer.add: `at` must be a vertex index, a point x,y,z"),
        (lambda d: d.move(99, scale=2), r"Deformer.move: `handle` must be the id of a handle \(1\), got 99"),
        (lambda d: d.move(1, translation=(0, math.inf, 0)), r"Deformer.move: `translation` must be finite"),
        (lambda d: d.move(1, pivot="center"), r"Deformer.move: `pivot` must be auto, base, middle, point"),
        (lambda d: d.move(1, towards="up"), r"Deformer.move: `bend` must be given with `towards`"),
        (
            lambda d: d.move(1, bend=(1, 0, 0), towards="up"),
            r"Deformer.move: `bend` must be one angle, and not a vector, beside `towards`",
        ),
        (lambda d: d.move(1, joint="knee"), r"Deformer.move: `joint` must be spread, auto, here"),
        (lambda d: d.change(99), r"Deformer.change: `handle` must be the id of a handle"),
        (lambda d: d.change(1, at=6), r"`fixed` must be at unused places, but the place 6 is already used by handle 1"),
        (lambda d: d.change(1, locality=-2), r"Deformer.change: `locality` must be at least 0"),
        (lambda d: d.remove(99), r"Deformer.remove: `handle` must be the id of a handle"),
        (lambda d: d.fix(6), r"`fixed` must be at unused places, but the place 6 is already used by a fixed point"),
        (lambda d: d.fix(5), r"`fixed` must be at unused places, but the place 5 is already used by handle 1"),
        (
            lambda d: d.fix("seat"),
            r"Deformer.fix: `at` must be a vertex index, a point x,y,z, top, bottom, .*, got 'seat'",
        ),
        (lambda d: d.release(8), r"Deformer.release: `at` must be a fixed point, got 8"),
        (lambda d: d.set_symmetry("w"), r"Deformer.set_symmetry: `plane` must have the form x, x=0.1 or 0.6,0,0.8=0.1"),
        (lambda d: d.set_symmetry(1), r"`plane` must be a text such as x or x=0.1, or a SymmetryPlane, got int"),
        (lambda d: d.set_symmetry("x", band=-1), r"Deformer.set_symmetry: `band` must be at least 0"),
        (
            lambda d: d.apply(Edit(fixed=(Fixed(Place((0.0, 0.0, 0.0), 10**6)),))),
            r"Deformer.apply: `fixed\[0\]` must lie in 0",
        ),
        (
            lambda d: d.apply(Edit(fixed=(Fixed(Place((0.0, 0.0, 1e6))),))),
            r"Deformer.apply: `fixed\[0\]` must lie near the shape, but 0,0,1e\+06 is",
        ),
        (
            lambda d: d.apply(Edit(symmetry=SymmetryPlane((1.0, 0.0, 0.0), 1e38))),
            r"Deformer.apply: `symmetry` must cut the shape, but all vertices lie",
        ),
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
    deformer.add(5, translation=(0, 1, 0))
    deformer.fix(6)
    assert repr(deformer).endswith("1 handle, 1 fixed point)")
    shown = repr(deformer.handle(1))
    assert re.fullmatch(r"Handle\(id=1, place=Place\(position=\(.*\), vertex=5\), transform=Transform\(.*\)\)", shown)
    assert shown.endswith("transform=Transform(translation=(0.0, 1.0, 0.0)))")
    assert repr(deformer.report()).startswith("Report('moved ")


def test_in_the_paper_s_preset_a_resting_handle_takes_its_share(paper, fresh, mesh):
    """The displacements of Eq. 1 are divided by the sum of all weights, so a handle that rests counts, too."""
    paper.add(5, translation=(0, 0.2, 0))
    alone = paper.vertices
    other = int(np.argsort(np.abs(paper.weights[:, 0] - 0.6))[0])
    paper.add(other)
    both = fresh("paper")
    both.add(5, translation=(0, 0.2, 0))
    both.add(other)
    np.testing.assert_array_equal(paper.vertices, both.vertices)
    assert np.abs(paper.vertices - alone).max() > 0.01


@pytest.mark.parametrize("size", [3, 4])
@pytest.mark.parametrize("preset", ["default", "paper"])
@pytest.mark.filterwarnings("ignore:Deformer. `preset` is 'paper'")
def test_a_handle_takes_any_affine_matrix(fresh, preset, size):
    session = fresh(preset)
    random = np.random.default_rng(3)
    matrix = np.eye(4)
    matrix[:3] += 0.4 * random.standard_normal((3, 4))
    handle = session.add(5, matrix=matrix[:size])
    np.testing.assert_allclose(session.transforms[0], matrix[:3], atol=1e-12)
    mirrored = matrix @ np.diag([-1, 1, 1, 1])
    session.move(handle, matrix=mirrored[:size])
    np.testing.assert_allclose(session.transforms[0], mirrored[:3], atol=1e-12)
    session.move(handle, matrix=np.eye(4))
    np.testing.assert_allclose(session.transforms[0], np.eye(3, 4), atol=1e-15)
    with pytest.raises(ValueError, match=r"^Deformer.move: `matrix` must not be given with `rotation`"):
        session.move(handle, matrix=matrix, rotation=(0, 1, 0))
    with pytest.raises(ValueError, match=r"`matrix` must have shape \(3, 4\) or \(4, 4\), got \(3, 3\)"):
        session.move(handle, matrix=np.eye(3))


def test_a_rotation_of_scipy_goes_where_a_rotation_goes(deformer):
    turn = Rotation.from_rotvec((10, 20, 30), degrees=True)
    handle = deformer.add(5, rotation=turn)
    assert deformer.handle(handle).transform.rotation == pytest.approx((10, 20, 30))
    deformer.move(handle, bend=turn)
    assert deformer.handle(handle).transform.bend == pytest.approx((10, 20, 30))
    assert dfd.Transform(rotation=turn).rotation == pytest.approx((10, 20, 30))


def test_a_key_pose_takes_matrices():
    matrix = np.eye(3, 4) + 0.1 * np.arange(12).reshape(3, 4)
    pose = dfd.KeyPose(0, {1: matrix, 2: dfd.Transform()})
    np.testing.assert_allclose(pose.transforms[1].matrix((5, 6, 7)), matrix, atol=1e-12)
    with pytest.raises(ValueError, match=r"^KeyPose: `transforms` must hold transforms or matrices \(3, 4\), got int"):
        dfd.KeyPose(0, {1: 3})
