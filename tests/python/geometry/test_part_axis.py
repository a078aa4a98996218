"""Test the axes of parts: their curves, limbs, and borders."""

import numpy as np
import pytest
from made_tube import AROUND, straight, tube

from dfd import Mesh
from dfd.geometry.coarse import MOST_NODES
from dfd.geometry.part_axis import PartAxes


def upper(mesh, low=1.0, slant=0.0):
    """Return the vertices of an upright tube above a plane, (V,) bool. `slant` is the slope of the plane."""
    return mesh.vertices[:, 1] + slant * mesh.vertices[:, 0] > low


@pytest.mark.parametrize("slant", [0.0, 0.5, -1.0])
def test_the_axis_of_a_tube_is_its_middle_however_its_border_runs(slant):
    mesh = straight()
    (axis,) = PartAxes(mesh).of(upper(mesh, slant=slant))
    # Near an oblique border, the part contains only one side of the tube.
    assert np.abs(axis.nodes[8:, [0, 2]]).max() < 0.02
    assert np.abs(axis.nodes[:, [0, 2]]).max() < 0.2
    assert axis.length == pytest.approx(3.0, abs=0.15)
    np.testing.assert_allclose(axis.radius[4:-4], 0.2, atol=0.01)
    assert axis.is_limb
    assert axis.borders == 1
    assert axis.direction @ (0, 1, 0) > 0.998
    np.testing.assert_allclose(axis.base, (0, 1, 0), atol=0.1)
    far = axis.parameter > 0.3
    height = mesh.vertices[axis.vertices[far], 1]
    line = np.polyfit(axis.parameter[far], height, 1)
    np.testing.assert_allclose(np.polyval(line, axis.parameter[far]), height, atol=0.03)


@pytest.mark.parametrize("slant", [0.0, 0.5, -1.0, 2.0])
def test_parameters_are_0_all_along_the_border_however_it_runs(slant):
    """Otherwise, a bend would move one side of an oblique border, and tear the surface there."""
    mesh = straight()
    inside = upper(mesh, slant=slant)
    (axis,) = PartAxes(mesh).of(inside)
    edges = np.concatenate([mesh.faces[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    border = np.unique(edges[inside[edges[:, 0]] & ~inside[edges[:, 1]], 0])
    assert len(border) >= AROUND
    assert axis.parameter[np.isin(axis.vertices, border)].tolist() == [0.0] * len(border)


def test_between_the_nodes_of_a_fine_mesh_parameters_stay_linear():
    """Constant parameters within each node would differ by up to 0.006, and a bend would show steps."""
    mesh = straight(rings=2001)
    (axis,) = PartAxes(mesh).of(upper(mesh))
    assert len(mesh.vertices) > MOST_NODES
    inner = (axis.parameter > 0.3) & (axis.parameter < 0.9)
    height = mesh.vertices[axis.vertices[inner], 1]
    line = np.polyfit(axis.parameter[inner], height, 1)
    np.testing.assert_allclose(np.polyval(line, axis.parameter[inner]), height, atol=2e-3)


def test_a_curved_tube_has_a_curved_axis():
    turn = np.linspace(0, np.pi, 101)
    mesh = tube(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1), 0.1)
    inside = np.zeros(len(mesh.vertices), bool)
    inside[30 * 24 : 101 * 24] = inside[-1] = True  # from ring 30 to the end: 126° of a circle of radius 1
    (axis,) = PartAxes(mesh).of(inside)
    assert axis.length == pytest.approx(0.7 * np.pi, rel=0.04)
    np.testing.assert_allclose(np.linalg.norm(axis.nodes, axis=1), 1.0, atol=0.04)
    assert axis.tangents[0] @ axis.tangents[-1] < -0.1


def test_what_is_wider_than_long_is_no_limb_and_a_middle_component_has_two_borders():
    import trimesh

    ball = trimesh.creation.icosphere(4)
    mesh = Mesh(ball.vertices, ball.faces)
    (axis,) = PartAxes(mesh).of(mesh.vertices[:, 1] > 0.5)
    assert not axis.is_limb
    mesh = straight(6.0)
    (axis,) = PartAxes(mesh).of((mesh.vertices[:, 1] > 2) & (mesh.vertices[:, 1] < 4))
    assert axis.borders == 2
    assert not axis.is_limb


def test_a_wheel_is_no_limb_and_turns_about_its_hub():
    import trimesh

    wheel = trimesh.creation.cylinder(radius=1.0, height=0.4, sections=24).subdivide()
    body = trimesh.creation.box((6.0, 1.0, 2.0)).apply_translation((1.0, 1.55, 0.0)).subdivide().subdivide()
    mesh = Mesh(*(lambda both: (both.vertices, both.faces))(trimesh.util.concatenate([wheel, body])))
    (axis,) = PartAxes(mesh).of(np.arange(len(mesh.vertices)) < len(wheel.vertices))
    assert axis.borders == 1
    assert axis.base[1] > 0.5  # the base is at the body, above the hub
    assert not axis.is_limb
    np.testing.assert_allclose(axis.middle, 0.0, atol=0.02)


def test_what_hangs_on_a_part_has_one_place_on_its_axis():
    mesh = straight(6.0, 121)
    held = (mesh.vertices[:, 1] > 4) & (mesh.vertices[:, 1] < 5)
    (axis,) = PartAxes(mesh).of(held)
    assert axis.borders == 1
    assert set(np.flatnonzero(upper(mesh, 4))) == set(axis.vertices)
    above = mesh.vertices[axis.vertices, 1] > 5.5
    assert np.ptp(axis.parameter[above]) < 1e-9
    assert axis.parameter[above].mean() > 0.9
    assert axis.nodes[-1, 1] < 5.2


def test_components_have_axes_the_largest_first_and_small_ones_none():
    one, other = straight(4.0), straight(2.0)
    count = len(one.vertices)
    mesh = Mesh(
        np.concatenate([one.vertices, other.vertices + (3, 0, 0)]), np.concatenate([one.faces, other.faces + count])
    )
    inside = mesh.vertices[:, 1] > 1
    inside[:3] = True  # three vertices of the lower end
    axes = PartAxes(mesh).of(inside)
    assert [round(axis.nodes[:, 0].mean()) for axis in axes] == [0, 3]


def test_a_part_that_is_a_whole_component_begins_at_its_end_nearer_to_the_shape():
    mesh = straight(4.0)
    far = Mesh(
        np.concatenate([mesh.vertices, mesh.vertices * 3 + (0, -20, 0)]),
        np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)]),
    )
    inside = np.arange(len(far.vertices)) < len(mesh.vertices)
    (axis,) = PartAxes(far).of(inside)
    assert axis.borders == 0
    assert not axis.is_limb
    assert axis.direction @ (0, 1, 0) > 0.99


def test_a_joint_is_where_a_part_is_narrow_or_bends():
    along = np.linspace(0.0, 4.0, 81)
    narrow = tube(np.stack([0 * along, along, 0 * along], axis=1), 0.3 - 0.15 * np.exp(-np.square((along - 2.2) / 0.2)))
    (axis,) = PartAxes(narrow).of(upper(narrow))
    assert axis.joint(axis.nodes[-1]) == pytest.approx(0.4, abs=0.08)
    twice = tube(
        np.stack([0 * along, along, 0 * along], axis=1),
        0.3 - 0.1 * np.exp(-np.square((along - 2) / 0.2)) - 0.15 * np.exp(-np.square((along - 3.2) / 0.2)),
    )
    (axis,) = PartAxes(twice).of(upper(twice))
    assert axis.joint(axis.nodes[-1]) == pytest.approx(0.75, abs=0.08)
    assert axis.joint(np.array([0.3, 2.1, 0.0])) == pytest.approx(0.33, abs=0.08), "the one that is held"
    knee = np.stack(
        [0.8 * np.clip(along - 2.5, 0, None), np.minimum(along, 2.5 + 0.6 * (along - 2.5)), 0 * along], axis=1
    )
    bent = tube(knee, 0.15)
    (axis,) = PartAxes(bent).of(upper(bent))
    assert axis.joint(axis.nodes[-1]) == pytest.approx(0.5, abs=0.08)


def test_a_hinge_joins_the_extremes_of_the_border_and_opens_away_from_the_rest():
    turn = np.linspace(0, np.pi, 81)
    bow = tube(np.stack([0 * turn, np.cos(turn), np.sin(turn)], axis=1), 0.1)
    wide = Mesh(bow.vertices * (3, 1, 1), bow.faces)
    inside = np.zeros(len(wide.vertices), bool)
    inside[40 * 24 : 81 * 24] = inside[-1] = True
    (axis,) = PartAxes(wide).of(inside)
    middle, across = axis.hinge
    np.testing.assert_allclose(middle, (0, 0, 1), atol=0.15)
    # The jaw opens downwards, from the front of the bow to its lower end.
    assert abs(across[0]) > 0.97
    opened = np.cross(across, axis.nodes[-1] - middle)
    assert opened[1] < 0
