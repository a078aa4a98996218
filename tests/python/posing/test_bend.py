"""Test bend and twist: rigid cross-sections, the angle of the tip, and vertices that stay."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_tube import AROUND, straight, tube
from scipy.spatial import ConvexHull

from dfd.geometry.part_axis import PartAxes
from dfd.posing.bend import STEPS, Sections, bend_maps, turn_maps

angle = st.floats(-150, 150)


def held(mesh, low=1.0):
    (axis,) = PartAxes(mesh).of(mesh.vertices[:, 1] > low)
    return axis, Sections(axis.vertices, axis.parameter)


STANDING = straight()
AXIS, SECTIONS = held(STANDING)


def moved(bend=(0, 0, 0), twist=0.0, joint=None, points=None):
    result = np.array(STANDING.vertices if points is None else points)
    SECTIONS.move(result, bend_maps(AXIS.nodes, AXIS.radius, bend, twist, joint))
    return result


def rings(points):
    return points[:-2].reshape(-1, AROUND, 3)


def girths(points):
    closed = np.concatenate([rings(points), rings(points)[:, :1]], axis=1)
    return np.linalg.norm(np.diff(closed, axis=1), axis=2).sum(axis=1)


@pytest.mark.parametrize("joint", [None, 0.4])
def test_no_angle_is_the_identity_to_the_bit(joint):
    np.testing.assert_array_equal(moved(joint=joint), STANDING.vertices)


@pytest.mark.parametrize("joint", [None, 0.4])
@pytest.mark.parametrize(("bend", "twist"), [((0, 0, 0), 0.0), ((0, 0, 40), 0.0), ((0, 0, 0), 40.0)])
def test_maps_are_rigid_and_begin_with_the_identity(bend, twist, joint):
    maps = bend_maps(AXIS.nodes, AXIS.radius, bend, twist, joint)
    assert maps.shape == (STEPS + 1, 3, 4)
    np.testing.assert_array_equal(maps[0], np.eye(3, 4))
    turns = maps[:, :, :3]
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (STEPS + 1, 1, 1)), atol=1e-12)
    angles = np.degrees(np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    assert (np.diff(angles) >= -1e-6).all()
    assert angles[-1] == pytest.approx(np.linalg.norm(bend) + twist, abs=1e-6)


@pytest.mark.parametrize("joint", [None, 0.4])
def test_a_bend_has_no_crease(joint):
    turns = bend_maps(AXIS.nodes, 1e-3 * AXIS.radius, (0, 0, 40), 0.0, joint)[:, :2, 0]
    angles = np.degrees(np.arctan2(turns[:, 1], turns[:, 0]))
    assert np.abs(np.diff(angles, 2)).max() < 0.1
    between = ((angles > 1e-9) & (angles < 40 - 1e-9)).mean()
    assert between == pytest.approx(1.0 if joint is None else 0.12, abs=0.005)  # even a thin joint has some length


def test_maps_about_a_center_turn_by_equal_steps():
    maps = turn_maps(np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.0, 90.0]))
    np.testing.assert_array_equal(maps[0], np.eye(3, 4))
    np.testing.assert_allclose(
        maps[:, :, :3] @ (1, 2, 3) + maps[:, :, 3], np.tile((1, 2, 3), (STEPS + 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(maps[STEPS // 2, 0, :2], [np.cos(np.pi / 4), -np.sin(np.pi / 4)])
    np.testing.assert_allclose(maps[-1, :, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)


@given(angle, angle, st.floats(-360, 360), st.sampled_from([None, 0.4, 0.6]))
def test_girths_are_kept_and_nothing_beyond_the_part_moves(x, z, twist, joint):
    posed = moved((x, 0, z), twist, joint)
    np.testing.assert_allclose(girths(posed), girths(STANDING.vertices), rtol=0.03)
    rest = STANDING.vertices[:, 1] <= 1.0
    np.testing.assert_array_equal(posed[rest], STANDING.vertices[rest])


@given(angle, st.sampled_from([None, 0.3, 0.6]))
def test_the_tip_turns_by_the_angle(z, joint):
    ends = rings(moved((0, 0, z), 0, joint))[-6:].mean(axis=1)
    along = ends[-1] - ends[0]
    # At the last rings, a bend over the whole length has not reached its full angle.
    assert np.degrees(np.arctan2(-along[0], along[1])) == pytest.approx(
        z, abs=0.5 + (0.1 * abs(z) if joint is None else 0)
    )


@given(st.floats(-360, 360), st.sampled_from([None, 0.5]))
def test_a_twist_and_its_reverse_return(twist, joint):
    there = moved(twist=twist, joint=joint)
    np.testing.assert_allclose(moved(twist=-twist, joint=joint, points=there), STANDING.vertices, atol=4e-3)
    # A twist about a straight vertical axis keeps all heights.
    np.testing.assert_allclose(there[:, 1], STANDING.vertices[:, 1], atol=4e-3)


def test_about_a_joint_what_lies_before_it_stays_and_what_lies_beyond_is_rigid():
    posed = moved((90, 0, 0), 0, 0.5)
    height = STANDING.vertices[:, 1]
    thigh, shin = height < 1.9, height > 3.1
    np.testing.assert_array_equal(posed[thigh], STANDING.vertices[thigh])
    one, other = (points[shin] - points[shin].mean(axis=0) for points in (STANDING.vertices, posed))
    np.testing.assert_allclose(other @ other.T, one @ one.T, atol=1e-6)


def test_the_inside_of_a_bend_at_a_joint_does_not_cross_itself():
    posed = moved((0, 0, 110), 0, 0.5)
    line = rings(posed).mean(axis=1)
    inner = rings(posed)[:, rings(STANDING.vertices)[0, :, 0].argmin()]
    ahead = (np.diff(inner, axis=0) * np.diff(line, axis=0)).sum(axis=1)
    assert (ahead > 0).all()


def test_a_curved_tube_keeps_its_volume_when_it_is_straightened():
    turn = np.linspace(0, np.pi / 2, 81)
    bent = tube(np.stack([2 * (1 - np.cos(turn)), 2 * np.sin(turn), 0 * turn], axis=1), 0.15)
    inside = np.zeros(len(bent.vertices), bool)
    inside[10 * AROUND :] = True
    inside[-2] = False
    (axis,) = PartAxes(bent).of(inside)
    points = np.array(bent.vertices)
    Sections(axis.vertices, axis.parameter).move(points, bend_maps(axis.nodes, axis.radius, (0, 0, 75), 0.0))
    np.testing.assert_allclose(girths(points), girths(bent.vertices), rtol=0.03)
    volumes = [
        ConvexHull(ring_pair.reshape(-1, 3)).volume for ring_pair in (rings(bent.vertices)[40:42], rings(points)[40:42])
    ]
    assert volumes[1] == pytest.approx(volumes[0], rel=0.1)
