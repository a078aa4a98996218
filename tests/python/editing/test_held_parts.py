"""Test the pivots, bends, twists and hinges of the part that a handle holds."""

from unittest import mock

import numpy as np
import pytest
from made_tube import AROUND, tube
from test_contacts import joined, session_of

import dfd
from dfd.editing import verbs
from dfd.editing.weights.axis_motions import bendable_parts
from dfd.posing.transforms import rotation_matrix
from dfd.symmetry.plane import SymmetryPlane

HEIGHT = 0.6  # height of the post on which the stalk stands
NEAR = 0.16  # largest distance of the found border from the top of the post: three rings of the stalk


def stalk(turn=0.0):
    """Return centers and radii of rings: a thick post, and a thin stalk on it that leans by `turn` radians about z."""
    low = np.linspace(0.0, HEIGHT, 13)
    high = np.linspace(0.0, 2.0, 41)[1:]
    points = np.concatenate(
        [
            np.stack([0 * low, low, 0 * low], axis=1),
            np.stack([-np.sin(turn) * high, HEIGHT + np.cos(turn) * high, 0 * high], axis=1),
        ]
    )
    return points, np.where(np.arange(len(points)) < 13, 0.5, 0.15)


@pytest.fixture
def one():
    """Return a session with one stalk. Its tip is the last vertex."""
    mesh = tube(*stalk())
    return session_of(mesh, (mesh.vertices[:, 1] > HEIGHT + 0.01).astype(int))


@pytest.fixture
def pair():
    """Return a session with two mirrored stalks and a bar between their posts, and the vertex count of one stalk."""
    left = tube(*stalk(0.5))
    left = dfd.Mesh(left.vertices - (1.5, 0, 0), left.faces)
    right = dfd.Mesh(left.vertices * (-1, 1, 1), left.faces[:, ::-1])
    bar = tube(np.stack([np.linspace(-1.5, 1.5, 21), np.full(21, 0.3), np.zeros(21)], axis=1), 0.3)
    mesh, _ = joined(left, right, bar)
    labels = (mesh.vertices[:, 1] > HEIGHT + 0.01).astype(int)
    labels[len(left.vertices) * 2 :] = 0
    return session_of(mesh, labels), len(left.vertices)


def rings(points):
    """Return the rings (53, AROUND, 3) of the tube."""
    return points[: 53 * AROUND].reshape(-1, AROUND, 3)


def circumferences(points):
    closed = np.concatenate([rings(points), rings(points)[:, :1]], axis=1)
    return np.linalg.norm(np.diff(closed, axis=1), axis=2).sum(axis=1)


# --- pivots


def test_a_limb_scales_and_rotates_about_its_base_with_a_handle_at_its_tip(one):
    tip = len(one.mesh.vertices) - 1
    for verb in ({"scale": 1.5}, {"rotation": (0, 0, 40)}):
        handle = one.add(tip, **verb)
        transform = one.handle(handle).transform
        assert transform.pivot_at == "base"
        np.testing.assert_allclose(transform.pivot, (0, HEIGHT, 0), atol=NEAR)
        one.remove(handle)


def test_the_first_rotation_chooses_a_pivot_that_later_rotations_keep(one):
    handle = one.add(len(one.mesh.vertices) - 1, translation=(0, 0.1, 0))
    assert one.handle(handle).transform.pivot is None
    one.move(handle, rotation=(0, 0, 10))
    chosen = one.handle(handle).transform.pivot
    one.move(handle, rotation=(0, 0, 50), merge=True)
    assert one.handle(handle).transform.pivot == chosen
    one.move(handle, pivot=(1, 2, 3))
    one.move(handle, rotation=(0, 0, 20))
    assert one.handle(handle).transform.pivot == (1, 2, 3)
    assert one.handle(handle).transform.pivot_at is None
    one.move(handle, pivot="auto")
    assert one.handle(handle).transform.pivot == chosen


def test_pivots_by_name(one):
    handle = one.add(30 * AROUND, rotation=(0, 0, 20))
    held = one.mesh.vertices[30 * AROUND]
    one.move(handle, pivot="point")
    np.testing.assert_array_equal(one.handle(handle).pivot, held)
    one.move(handle, pivot="middle")
    np.testing.assert_allclose(one.handle(handle).pivot, (0, HEIGHT + 1, 0), atol=0.1)
    with pytest.raises(ValueError, match=r"Deformer.move: `pivot` cannot be 'plane': the edit has no plane"):
        one.move(handle, pivot="plane")
    one.set_symmetry(SymmetryPlane((0.0, 0.0, 1.0), 0.0))
    one.move(handle, pivot="plane")
    np.testing.assert_allclose(one.handle(handle).pivot, held * (1, 1, 0), atol=1e-9)
    one.move(handle, pivot="auto")
    assert one.handle(handle).pivot[2] == 0  # the stalk lies on both sides of the plane


def test_a_chosen_pivot_moves_to_the_new_place_of_the_handle(pair):
    session, count = pair
    handle = session.add(count - 1, scale=1.3, follow="none")
    assert session.handle(handle).pivot[0] < -1
    session.change(handle, at=2 * count - 1)
    assert session.handle(handle).transform.pivot_at == "base"
    assert session.handle(handle).pivot[0] > 1


def test_the_preset_paper_rotates_about_the_point(one):
    paper = dfd.Deformer(one.mesh, one.field, features=one.features, preset="paper")
    handle = paper.add(40 * AROUND, rotation=(0, 0, 30))
    assert paper.handle(handle).transform.pivot is None


# --- bend and twist


@pytest.mark.parametrize("at", [20 * AROUND, 52 * AROUND])
def test_a_bend_keeps_circumferences_and_moves_nothing_outside_the_part(one, at):
    handle = one.add(at)
    one.bend(handle, 80, towards="right")
    moved, rest = one.vertices, one.mesh.vertices
    np.testing.assert_allclose(circumferences(moved)[14:], circumferences(rest)[14:], rtol=0.03)
    beyond = rest[:, 1] <= HEIGHT + 1e-9
    np.testing.assert_array_equal(moved[beyond], rest[beyond])
    assert moved[:, 0].max() > 0.8
    assert rings(moved)[-1].mean(axis=0)[1] < HEIGHT + 1.7


def test_a_bend_or_twist_by_0_gives_the_resting_shape(one):
    handle = one.add(52 * AROUND, bend=0, towards="right", joint="auto")
    np.testing.assert_array_equal(one.vertices, one.mesh.vertices)
    one.twist(handle, 120)
    assert np.abs(one.vertices - one.mesh.vertices).max() > 0.1
    one.twist(handle, 0)
    np.testing.assert_array_equal(one.vertices, one.mesh.vertices)
    while one.undo():
        pass
    np.testing.assert_array_equal(one.vertices, one.mesh.vertices)


def test_translation_and_rotation_move_the_bent_part(one):
    handle = one.add(52 * AROUND, bend=45, towards="left")
    bent = one.vertices
    one.move(handle, translation=(0, 0, 0.5), rotation=(0, 90, 0), pivot=(0, 0, 0))
    top = one.mesh.vertices[:, 1] > HEIGHT + 1.2  # beyond the blend band
    x, y, z = bent[top].T
    np.testing.assert_allclose(one.vertices[top], np.stack([z, y, 0.5 - x], axis=1), atol=1e-6)
    assert one.report().handles[0].arrived


def test_surface_between_base_and_joint_does_not_move(one):
    handle = one.add(45 * AROUND)
    one.bend(handle, 90, towards="right", joint=0.5)
    low = one.mesh.vertices[:, 1] < HEIGHT + 0.7
    np.testing.assert_array_equal(one.vertices[low], one.mesh.vertices[low])
    one.bend(handle, 90, towards="right", joint="here")
    assert one.handle(handle).transform.joint == pytest.approx(33 / 40, abs=0.04)
    one.bend(handle, 90, towards="right", joint="spread")
    assert one.handle(handle).transform.joint is None


def test_a_counterpart_bends_along_its_own_axis(pair):
    session, count = pair
    session.add(count - 1, bend=60, towards="up")
    left, right = session.vertices[:count], session.vertices[count : 2 * count]
    assert np.abs(left - session.mesh.vertices[:count]).max() > 0.3
    np.testing.assert_allclose(right * (-1, 1, 1), left, atol=0.025)
    post = session.mesh.vertices[2 * count :]
    np.testing.assert_array_equal(session.vertices[2 * count :], post)


@pytest.mark.parametrize("counterparts", ["own_pivot", "shared_pivot"])
def test_with_a_plane_of_symmetry_the_other_side_bends_mirrored(pair, counterparts):
    session, count = pair
    session.set_symmetry("x")
    session.add(count - 1, bend=60, towards="up", twist=40, counterparts=counterparts)
    left, right = session.vertices[:count], session.vertices[count : 2 * count]
    np.testing.assert_allclose(right * (-1, 1, 1), left, atol=0.02)


@pytest.mark.parametrize("first", ["shin", "leg"])
def test_a_bent_leg_carries_its_bent_shin(one, first):
    """If the leg were bent first, the shin would bend about the place where it was at rest."""
    grips = {"leg": (25 * AROUND, f"y>{HEIGHT + 0.01}"), "shin": (52 * AROUND, "y>1.6")}
    for name in (first, *grips.keys() - {first}):
        at, mask = grips[name]
        handle = one.add(at, mask=mask, reach=2.0, falloff="constant", follow="none")
        one.bend(handle, {"leg": 50, "shin": 60}[name], towards="right")
    np.testing.assert_allclose(circumferences(one.vertices)[14:], circumferences(one.mesh.vertices)[14:], rtol=0.03)
    ends = rings(one.vertices)[[-4, -1]].mean(axis=1)
    along = ends[1] - ends[0]
    assert np.degrees(np.arctan2(along[0], along[1])) == pytest.approx(50 + 60, abs=2)


def test_bending_towards_the_axis_raises_an_error(one):
    handle = one.add(52 * AROUND)
    with pytest.raises(ValueError, match="`towards` must not be parallel to the axis"):
        one.bend(handle, 30, towards="up")
    with pytest.raises(ValueError, match="`towards` must be up, down, right, left, front, back or 3 numbers"):
        one.bend(handle, 30, towards="north")
    one.bend(handle, 30)  # an upright part bends to the front
    assert one.vertices[-1, 2] > 0.2


def test_opening_a_part_rotates_it_about_its_hinge(one):
    handle = one.add(30 * AROUND)
    one.open(handle, 20)
    transform = one.handle(handle).transform
    assert transform.pivot_at == "hinge"
    assert np.linalg.norm(transform.rotation) == pytest.approx(20)
    np.testing.assert_allclose(transform.pivot[1], HEIGHT, atol=NEAR)


def test_motions_that_are_none_change_nothing(one):
    handle = one.add(30 * AROUND, rotation=(0, 0, 20))
    before = one.edit
    one.move(handle, open=None, towards=None, bend=None, pivot=None, joint=None)
    assert one.edit == before


def test_a_default_transform_has_no_part(one):
    with pytest.raises(TypeError, match="'bend' needs the part that a handle holds"):
        one.set_default(bend=30)


def test_rotations_are_blended_as_dual_quaternions_without_a_jump(one):
    handle = one.add(52 * AROUND, mask="y>0", reach=0.9, scale=1.2, translation=(0.1, 0.2, 0), pivot=(0.1, 0, 0.3))
    assert one.edit.blending == "linear"
    linear = one.vertices
    one.move(handle, rotation=(0, 1e-7, 0))
    assert one.edit.blending == "dual_quaternion"
    np.testing.assert_allclose(one.vertices, linear, atol=1e-7)


def test_counterparts_are_mirror_images_without_symmetry_of_the_whole_shape(pair):
    """The pair is rotated and joined to another shape. The result has no plane of symmetry."""
    session, count = pair
    turn = rotation_matrix((10, 35, 20))
    rest = session.mesh.vertices
    bulk = tube(np.stack([np.full(9, 2.0), np.full(9, 1.0), np.linspace(3.0, 5.0, 9)], axis=1), 0.7)
    bar = tube(np.stack([np.linspace(0.0, 2.0, 9), np.linspace(0.3, 1.0, 9), np.linspace(0.0, 3.5, 9)], axis=1), 0.2)
    whole, _ = joined(session.mesh, bulk, bar)
    labels = np.zeros(len(whole.vertices), int)
    labels[: 2 * count] = rest[: 2 * count, 1] > HEIGHT + 0.01
    turned = session_of(dfd.Mesh(whole.vertices @ turn.T, whole.faces), labels)
    for motion in (
        {"translation": turn @ (0.2, 0.3, 0.1)},
        {"rotation": turn @ (20, 5, 30)},
        {"bend": 40, "twist": 30},
    ):
        handle = turned.add(count - 1, **motion)
        moved = (turned.vertices - turned.mesh.vertices) @ turn
        assert np.abs(moved[:count]).max() > 0.2
        np.testing.assert_allclose(moved[count : 2 * count] * (-1, 1, 1), moved[:count], atol=0.06)
        turned.remove(handle)


def test_a_bend_towards_a_vector_is_one_towards_its_direction(one):
    tip = one.add(len(one.mesh.vertices) - 1)
    for name, vector in (("front", (0, 0, 3.0)), ("left", np.array([-1, 0, 0]))):
        one.bend(tip, 40, towards=name)
        named = one.vertices
        one.bend(tip, 40, towards=vector)
        np.testing.assert_allclose(one.vertices, named, atol=1e-12)


@pytest.mark.parametrize(("level", "told"), [(None, "$"), (1, "; the part at level 1 has one$")])
def test_what_needs_an_axis_names_the_level_that_has_one_if_there_is_one(one, level, told):
    handle = one.add(len(one.mesh.vertices) - 1)
    with (
        mock.patch.object(verbs, "bendable_parts", return_value=[]),
        mock.patch.object(verbs, "level_with_axis", return_value=level),
        pytest.raises(ValueError, match=f"`open` needs a part with an axis, and the handle holds none{told}"),
    ):
        one.move(handle, open=30)


@pytest.mark.parametrize(
    ("offset", "across"), [(-0.148, False), (-0.1, True), (0.0, True), (0.1, True), (0.148, False)]
)
def test_a_part_lies_across_a_plane_if_a_tenth_of_it_is_on_each_side(one, offset, across):
    one.symmetry = SymmetryPlane((1.0, 0.0, 0.0), offset)
    handle = one.add(len(one.mesh.vertices) - 1)
    assert bendable_parts(one.bound, one.edit, one.handle(handle))[0].across == across
