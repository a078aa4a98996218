"""Test transforms about a pivot: their effect on points, and the values that they refuse."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfd.posing.transforms import Transform, rotation_matrix, rotation_vector

coordinate = st.floats(-10, 10)
points = st.tuples(coordinate, coordinate, coordinate)


def moved(matrix, point):
    return matrix[:, :3] @ np.asarray(point) + matrix[:, 3]


@pytest.mark.parametrize(
    ("rotation", "point", "image"),
    [
        ((90, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((0, 90, 0), (0, 0, 1), (1, 0, 0)),
        ((0, 0, 90), (1, 0, 0), (0, 1, 0)),
        ((0, 0, -90), (1, 0, 0), (0, -1, 0)),
        (np.array([1, 1, 1]) / math.sqrt(3) * 120, (1, 0, 0), (0, 1, 0)),
    ],
)
def test_rotations_are_right_handed_and_in_degrees(rotation, point, image):
    np.testing.assert_allclose(rotation_matrix(rotation) @ point, image, atol=1e-15)


@pytest.mark.parametrize("turns", [1, -3, 2_000_000])
def test_whole_turns_change_nothing(turns):
    np.testing.assert_allclose(rotation_matrix((360.0 * turns + 90, 0, 0)), rotation_matrix((90, 0, 0)), atol=1e-13)


@given(points, st.tuples(*[st.floats(-720, 720)] * 3), st.floats(-3, 3))
def test_the_pivot_stays_but_for_the_translation(pivot, rotation, scale):
    matrix = Transform(translation=(0.5, 0, -2), rotation=rotation, scale=scale, pivot=pivot).matrix()
    np.testing.assert_allclose(moved(matrix, pivot), np.add(pivot, (0.5, 0, -2)), atol=1e-12)


@given(st.tuples(*[st.floats(-720, 720)] * 3))
def test_a_rotation_keeps_lengths_and_handedness(rotation):
    matrix = rotation_matrix(rotation)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)


@given(st.tuples(*[st.floats(-100, 100)] * 3))
def test_a_quaternion_is_the_rotation_vector_it_stands_for(rotation):
    angle = math.radians(np.linalg.norm(rotation))
    axis = np.asarray(rotation) / (np.linalg.norm(rotation) or 1.0)
    quaternion = [*(axis * math.sin(angle / 2)), math.cos(angle / 2)]
    np.testing.assert_allclose(rotation_vector(quaternion), rotation, atol=1e-5)
    np.testing.assert_allclose(rotation_matrix(quaternion), rotation_matrix(rotation), atol=1e-7)


def test_a_quaternion_and_its_opposite_of_any_length_are_one_rotation():
    wanted = rotation_vector((0, math.sin(0.4), 0, math.cos(0.4)))
    np.testing.assert_allclose(rotation_vector((0, -math.sin(0.4), 0, -math.cos(0.4))), wanted)
    for factor in (5, 1e-200, -1e200):
        scaled = np.multiply((0, math.sin(0.4), 0, math.cos(0.4)), factor)
        with pytest.warns(UserWarning, match=re.escape(f"a quaternion of length {abs(factor):.3g}, normalized to 1")):
            np.testing.assert_allclose(rotation_vector(scaled), wanted)


def test_scale_acts_along_the_axes_before_the_rotation():
    matrix = Transform(scale=(2, 1, 1), rotation=(0, 0, 90)).matrix()
    np.testing.assert_allclose(moved(matrix, (1, 0, 0)), (0, 2, 0), atol=1e-15)


@pytest.mark.parametrize("factor", [2, 0, -1, np.float32(0.5), np.array(3.0)])
def test_one_factor_scales_all_axes(factor):
    np.testing.assert_allclose(Transform(scale=factor).matrix()[:, :3], float(factor) * np.eye(3))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"translation": (1, 2)}, r"Transform: `translation` must be 3 numbers, got shape \(2,\)"),
        ({"translation": (1, 2, math.nan)}, r"`translation` must be finite, got nan at \[2\]"),
        ({"scale": (1, 2)}, r"`scale` must be one number or 3, got shape \(2,\)"),
        ({"rotation": 90}, r"`rotation` must be a rotation vector in degrees \(3 numbers\) or a quaternion"),
        ({"rotation": (0, 0, 0, 0)}, r"`rotation` must be a quaternion other than 0"),
        ({"rotation": (1.01e9, 0, 0)}, r"`rotation` must stay within ±1e\+09 degrees"),
        ({"bend": (0, -1.01e9, 0)}, r"`bend` must stay within ±1e\+09 degrees"),
        ({"twist": 1.01e9}, r"`twist` must be at most 1e\+09, got 1.01e\+09"),
        ({"twist": "left"}, r"`twist` must be a number, got 'left'"),
        ({"pivot_at": "base"}, r"`pivot` must be given when `pivot_at` is"),
        ({"translation": (0, -1e39, 0)}, r"`translation` must be numbers of at most 1e\+38, got 0,-1e\+39,0"),
        ({"pivot": (0, 0, 1e39)}, r"Transform: `pivot` must be numbers of at most 1e\+38, got 0,0,1e\+39"),
        ({"scale": -1e39}, r"Transform: `scale` must be numbers of at most 1e\+38, got -1e\+39"),
        ({"axes": np.eye(2)}, r"`axes` must have shape \(3, 3\), got \(2, 2\)"),
        ({"axes": [(1, 0, 0), (0, 1, 0), (0, 1, 1)]}, r"`axes` must be 3 unit vectors at right angles, got"),
    ],
)
def test_what_is_no_transform_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Transform(**arguments).matrix()


def test_without_a_pivot_or_a_center_a_transform_turns_about_the_origin():
    np.testing.assert_array_equal(Transform(rotation=(90, 0, 40), scale=(2, 3, 4)).matrix()[:, 3], 0)
    assert moved(Transform(rotation=(90, 0, 40)).matrix((1.0, 2.0, 3.0)), (1, 2, 3)) == pytest.approx((1, 2, 3))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("amount", [0.5, -1.0])
def test_every_motion_is_known_to_move(axis, amount):
    vector = tuple(amount * np.eye(3)[axis])
    for arguments, turns, bends in (
        ({"translation": vector}, False, False),
        ({"rotation": vector}, True, False),
        ({"scale": tuple(1.0 + np.array(vector))}, True, False),
        ({"bend": vector}, False, True),
        ({"twist": amount}, False, True),
    ):
        transform = Transform(**arguments)
        assert (transform.rests, transform.turns, transform.bends) == (False, turns, bends)
    still = Transform(pivot=vector, joint=0.5, axes=np.eye(3)[[1, 2, 0]])
    assert (still.rests, still.turns, still.bends) == (True, False, False)


def test_a_joint_lies_on_the_axis():
    assert [Transform(joint=joint).joint for joint in (0, 0.25, 1)] == [0.0, 0.25, 1.0]
    for joint, bound in ((-0.01, "at least 0"), (1.01, "at most 1")):
        with pytest.raises(ValueError, match=f"Transform: `joint` must be {bound}, got {joint}"):
            Transform(joint=joint)
    assert Transform(joint=0.25).changed(joint="spread").joint is None


def test_a_pivot_keeps_its_name_until_another_is_given():
    named = Transform().changed(pivot=(1, 2, 3), pivot_at="base")
    assert (named.pivot, named.pivot_at) == ((1, 2, 3), "base")
    assert named.changed(scale=2).pivot_at == "base"
    assert named.changed(pivot=(1, 2, 3)).pivot_at == "base"
    assert named.changed(pivot=(1, 2, 4)).pivot_at is None
    assert named.changed(pivot=(1, 2, 3), pivot_at="middle").pivot_at == "middle"
    assert named.changed(pivot="auto").pivot_at is None


def test_a_center_too_far_away_is_refused():
    with pytest.raises(ValueError, match="the matrix is not finite"):
        Transform(scale=1e38).matrix((1e300, 0.0, 0.0))
    assert np.isfinite(Transform(translation=(1e38, 0, 0), scale=1e38, pivot=(1e38, 0, 0)).matrix()).all()


def test_a_transform_checks_itself_once_and_keeps_its_matrix():
    transform = Transform(rotation=[0, 0, 0, 1], scale=2, pivot=np.array([1, 2, 3]))
    assert transform == Transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (2.0, 2.0, 2.0), (1.0, 2.0, 3.0))
    assert hash(transform) == hash(Transform(scale=2, pivot=(1, 2, 3)))
    assert transform.changed() is transform
    assert transform.changed(pivot="auto").pivot is None
    np.testing.assert_array_equal(transform.linear, 2 * np.eye(3))
    for array in (transform.linear, transform.matrix()):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@given(st.tuples(*[st.floats(-100, 100)] * 3), st.tuples(*[st.floats(0.1, 3)] * 3))
def test_scale_acts_along_the_axes_that_it_is_given(rotation, scale):
    axes = rotation_matrix(rotation)
    linear = Transform(scale=scale, axes=axes, rotation=(0, 0, 90)).linear
    turn = rotation_matrix((0, 0, 90))
    for axis, factor in zip(axes, scale, strict=True):
        np.testing.assert_allclose(linear @ axis, factor * turn @ axis, atol=1e-9)


def test_a_scale_of_zero_warns_that_the_part_collapses():
    with pytest.warns(UserWarning, match="`scale` is 0, so the held part collapses into its pivot"):
        assert Transform().changed(scale=0).scale == (0, 0, 0)
    assert Transform().changed(scale=(0, 1, 1)).scale == (0, 1, 1)  # flattens, which can be wanted
