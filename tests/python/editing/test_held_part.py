"""Test the components of a held part: their borders, depths, radii, and their shares where they touch."""

from unittest import mock

import numpy as np
import pytest
from made_tube import AROUND, straight, tube
from scipy.sparse import csr_array
from sheet import grid

from dfd.editing.weights import held_part as module
from dfd.editing.weights.axis_motions import _rising as rising
from dfd.editing.weights.fill import Band, Component, band_of, weights_at
from dfd.editing.weights.held_part import BEYOND, INSIDE, OUTSIDE, hold
from dfd.geometry import coarse
from dfd.geometry.coarse import nodes_of

LENGTH, RADIUS, RINGS = 4.0, 0.2, 81
STEP = LENGTH / (RINGS - 1)  # distance between two rings


def held_above(low: float, at: float, high: float = 9.0) -> Component:
    """Return the component of a straight tube along y between two heights, held by a handle at the height `at`."""
    mesh = straight(LENGTH, RINGS, RADIUS)
    component = np.where((mesh.vertices[:, 1] > low) & (mesh.vertices[:, 1] < high), 0, -1)
    vertex = round(at / STEP) * AROUND
    return hold(mesh, component, vertex, mesh.vertices[vertex]).components[0]


def depths(component: Component) -> np.ndarray:
    """Return the depth of the vertices of the tube, NaN outside the band's largest extent."""
    found = np.full(len(straight(LENGTH, RINGS, RADIUS).vertices), np.nan)
    found[component.vertices] = component.depth
    return found


def test_a_limb_has_one_border_with_its_radius_and_the_direction_to_its_tip():
    limb = held_above(2.0, 4.0)
    np.testing.assert_allclose(limb.border[:, 1], 2.0 + STEP / 2, atol=STEP)
    assert limb.radius == pytest.approx(RADIUS, rel=0.01)
    np.testing.assert_allclose(limb.direction, (0, 1, 0), atol=0.02)


def test_a_part_with_two_borders_has_no_direction_and_the_mean_radius():
    middle = held_above(1.0, 2.0, 3.0)
    assert not middle.direction.any()
    assert middle.radius == pytest.approx(RADIUS, rel=0.01)
    np.testing.assert_allclose(np.unique(np.round(middle.border[:, 1])), (1, 3))


def test_a_motion_that_lengthens_a_part_stretches_its_thin_neck():
    heights = np.linspace(0, LENGTH, RINGS)
    mesh = tube(heights[:, None] * (0, 1, 0), np.where((heights > 0.9) & (heights < 1.5), 0.1, 0.5))
    component = np.where(mesh.vertices[:, 1] > 1.0, 0, -1)
    head = hold(mesh, component, len(mesh.vertices) - 1, mesh.vertices[-1]).components[0]
    assert 0.3 < head.link < 0.6 < 1.4 < head.inward
    assert head.room == pytest.approx(head.link / head.inward)
    assert held_above(1.0, 4.0).link == held_above(1.0, 4.0).inward
    up, aside = (np.column_stack([np.eye(3), each]) for each in ((0, 0.4, 0), (0.4, 0, 0)))
    assert band_of(head, up, np.eye(3, 4), 4.0).inward == head.link < 0.8 < band_of(head, aside, up, 4.0).inward


def test_a_part_with_borders_on_one_side_has_a_direction():
    """The middle of an arch: its two posts are below."""
    turn = np.linspace(0, np.pi, RINGS)
    mesh = tube(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1))
    arch = hold(mesh, np.where(mesh.vertices[:, 1] > 0.5, 0, -1), AROUND * RINGS // 2, (0, 1, 0)).components[0]
    np.testing.assert_allclose(arch.direction, (0, 1, 0), atol=0.02)


def test_depth_is_the_distance_from_the_border_inside_and_outside():
    limb = held_above(2.0, 4.0)
    height = straight(LENGTH, RINGS, RADIUS).vertices[:, 1] - 2.0 - STEP / 2
    depth = depths(limb)
    known = np.isfinite(depth) & (np.abs(height) < 0.25)
    assert known.sum() > 8 * AROUND
    np.testing.assert_allclose(depth[known], height[known], atol=0.3 * STEP)


def test_bands_extend_to_a_radius_outside_and_to_half_of_the_depth_inside():
    limb = held_above(2.0, 4.0)
    assert limb.outward == pytest.approx(OUTSIDE * RADIUS, rel=0.02)
    assert limb.inward == pytest.approx(INSIDE * 2.0, rel=0.1)
    assert limb.room == 1
    # Outside, the band covers at most a fifth of the surface, which is about a fifth of the length of a short post.
    short = held_above(0.5, 4.0)
    assert short.outward == pytest.approx(BEYOND * (0.5 + STEP / 2 + RADIUS / 2), rel=0.2)
    assert short.outward < 0.6 * OUTSIDE * RADIUS


def test_a_handle_near_the_border_leaves_less_room_inside():
    limb, near = held_above(2.0, 4.0), held_above(2.0, 2.25)
    assert near.room == pytest.approx((0.25 - STEP / 2) / limb.inward, rel=0.1)
    assert near.inward == pytest.approx(near.room * limb.inward, rel=0.1)


def test_a_handle_outside_the_border_moves_the_border_beyond_it():
    mesh = straight(LENGTH, RINGS, RADIUS)
    at = 39 * AROUND  # a handle just below the border
    component = np.where(mesh.vertices[:, 1] > 2.01, 0, -1)
    component[nodes_of(mesh).of_vertex[at]] = 0
    found = hold(mesh, component, at, mesh.vertices[at]).components[0]
    own = np.flatnonzero(np.concatenate([found.core.vertices, found.vertices]) == at)
    depth = np.concatenate([np.full(len(found.core.vertices), 9), found.depth])[own]
    assert len(own) == 1
    assert depth[0] > 0
    assert found.inward == pytest.approx(1e-3 * found.radius, rel=1e-6)


@pytest.mark.parametrize(
    ("room", "pull", "wanted"),
    [
        (1.0, (0, 1e-3, 0), (0.03, 0.03)),  # the band at rest
        (1.0, (0.1, 0, 0), (0.15, 0.15)),  # displacements across the limb widen the band on both sides
        (1.0, (0.2, 0, 0), (0.3, 0.3)),
        (1.0, (0.4, 0, 0), (0.3, 0.9)),  # outside, there is no more room
        (1.0, (0, 0.1, 0), (0.03, 0.3)),  # along the limb, only inside
        (0.25, (0, 0.05, 0), (0.1125, 0.15)),  # near the border, also outside
        (1.0, (0, -0.4, 0), (0.3, 0.9)),  # surface that is compressed, on both sides
        (1.0, (9, 9, 9), (0.3, 1.0)),
        (1.0, (0, 0.5, 0), (0.03, 0.8)),  # only where the limb is thin
    ],
)
def test_the_band_of_a_motion(room, pull, wanted):
    border = 0.2 * np.stack([np.cos(np.arange(8)), 0 * np.arange(8), np.sin(np.arange(8))], axis=1)
    limb = Component(None, border, np.array([0.0, 1, 0]), 0.3, 0.3, 1.0, 0.8, room, None, None, None, None)
    affine = np.column_stack([np.eye(3), pull])
    assert band_of(limb, affine, np.eye(3, 4), 9.0)[:2] == pytest.approx(wanted)
    # Only the motion relative to the surroundings counts.
    assert band_of(limb, affine, affine, 9.0)[:2] == pytest.approx((0.03, 0.03))
    # At rest, a band of a small shape is narrower.
    outward = wanted[0] if wanted[0] > 0.03 else 0.0075
    assert band_of(limb, affine, np.eye(3, 4), 1.2)[0] == pytest.approx(outward)


def test_weights_in_a_band_are_a_smoothstep():
    depth = np.array([-0.3, -0.2, 0.0, 0.1, 0.3, 0.5], np.float32)
    np.testing.assert_allclose(weights_at(depth, Band(0.2, 0.2)), [0, 0, 0.5, 0.84375, 1, 1], atol=1e-6)


def test_components_that_touch_share_the_surface_between_them():
    x = np.array([0, 3, 4, 4.5, 5, 5.5, 6, 7, 10])
    apart = np.stack([np.maximum(x - 3, 0), np.maximum(7 - x, 0)])
    component = np.where(x <= 3, 0, np.where(x >= 7, 1, -1))
    shares = module._shares(apart, component, 0, np.array([2.0, 2.0]))
    np.testing.assert_allclose(shares[0], [1, 1, 1, 0.84375, 0.5, 0.15625, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(shares.sum(axis=0), 1)
    # The handle at x = 3 lies nearer to the other component than the band is wide. So the transition is narrower.
    apart[1, 1] = 1.0
    np.testing.assert_allclose(module._shares(apart, component, 1, np.array([2.0, 2.0]))[0, [1, 3]], [1, 1])
    np.testing.assert_array_equal(module._shares(apart[:1], component, 0, np.array([2.0])), 1)


def test_distances_start_with_the_offset_of_their_source():
    line = csr_array((np.ones(4), (np.arange(4), np.arange(1, 5))), shape=(5, 5))
    found = module._distances(line + line.T, np.array([0, 4, 0]), np.array([0.5, 0.25, 0.3]), 1.4)
    np.testing.assert_allclose(found, [0.3, 1.3, np.inf, 1.25, 0.25])


def test_smoothing_has_the_given_deviation_along_the_surface_and_keeps_straight_slopes():
    side, h = 81, 0.1
    number = np.arange(side * side).reshape(side, side)
    one, other = (
        np.concatenate([a.ravel(), b.ravel()]) for a, b in ((number[1:], number[:, 1:]), (number[:-1], number[:, :-1]))
    )
    grid = csr_array((np.full(len(one), h), (one, other)), shape=(side * side,) * 2)
    grid, (x, _) = (grid + grid.T).tocsr(), h * (np.indices((side, side)).reshape(2, -1) - side // 2)
    np.testing.assert_allclose(module._smoothed(grid, x, -3.0, 3.0, 0.5), x, atol=1e-6)
    spike = (number.ravel() == number[side // 2, side // 2]).astype(float)
    smooth = module._smoothed(grid, spike, -1, 2, 0.5)
    assert smooth.sum() == pytest.approx(1, abs=1e-3)
    assert np.sqrt((smooth * x**2).sum()) == pytest.approx(0.5, rel=0.02)
    assert module._smoothed(grid, spike, 0.5, 2, 0.0) is spike
    holes = np.where(x > 1, np.inf, x)  # nodes of unknown depth do not change those beside them
    np.testing.assert_allclose(module._smoothed(grid, holes, -3.0, 0.85, 0.2)[x < 0.5], x[x < 0.5], atol=0.02)


def test_a_band_of_width_0_is_a_step():
    depth = np.array([-1e-20, 0, 1e-20], np.float32)
    np.testing.assert_array_equal(weights_at(depth, Band(0.0, 0.0)), (0, 0, 1))


def test_a_part_at_a_corner_has_a_radius_of_half_an_edge():
    mesh = grid(41)
    corner = int((mesh.vertices[:, 0] - mesh.vertices[:, 2]).argmax())
    component = np.full(len(mesh.vertices), -1)
    component[corner] = 0
    found = hold(mesh, component, corner, mesh.vertices[corner]).components[0]
    edges = np.linalg.norm(mesh.vertices - mesh.vertices[corner], axis=1)
    assert found.radius == pytest.approx(np.sort(edges)[1] / 2, rel=0.05)


@pytest.mark.parametrize(("hole", "along"), [(1, 1.0), (7, 0.0)])
def test_a_small_hole_in_a_part_is_no_border_of_it(hole, along):
    """The border of the part has 41 vertices. The direction of a part with two borders is 0."""
    mesh = grid(41)
    side = mesh.vertices[:, 0] - mesh.vertices[:, 0].mean()
    component, middle = np.where(side > 0.01, 0, -1), (0.25, 0, 0.5)
    component[np.argsort(np.linalg.norm((mesh.vertices - middle) * (1, 0, 1), axis=1))[:hole]] = -1
    at = int(side.argmax())
    half = hold(mesh, component, at, mesh.vertices[at]).components[0]
    assert half.direction[0] == pytest.approx(along, abs=0.02)


def test_the_share_of_a_rotation_rises_from_0_at_the_border_to_1_at_the_inner_end_of_the_band():
    limb = held_above(2.0, 4.0)
    vertices, parameter = rising(limb)
    assert (np.diff(vertices) > 0).all()
    depth = np.full(len(straight(LENGTH, RINGS, RADIUS).vertices), np.inf)
    depth[limb.vertices] = limb.depth
    part = np.clip(depth[vertices] / limb.inward, 0, 1)
    np.testing.assert_allclose(parameter, part * part * (3 - 2 * part), atol=1e-6)
    assert (parameter[depth[vertices] <= 0] == 0).all()
    assert (parameter == 1).sum() > 16 * AROUND


@pytest.mark.parametrize("most", [500, 50_000])
def test_weights_are_those_of_the_interpolated_depth_at_every_vertex(most):
    """Two components touch. With `most` of 500, vertices are grouped into nodes."""
    mesh = straight(LENGTH, 321, RADIUS)
    with mock.patch.object(coarse, "MOST_NODES", most), mock.patch.object(coarse, "CELLS", 30):
        nodes = nodes_of(mesh)
    assert nodes.are_vertices == (most > 500)
    height = nodes.center[:, 1]
    component = np.where(height > 2.6, 0, np.where(height > 1.4, 1, -1))
    vertex, everything = 320 * AROUND, np.arange(len(mesh.vertices))
    alike = np.linspace(0.5, 1, len(mesh.vertices), dtype=np.float32)
    with mock.patch.object(module, "_at_vertices", wraps=module._at_vertices) as made:
        held = hold(mesh, component, vertex, mesh.vertices[vertex], alike)
    assert len(held.components) == 2
    for one, call in zip(held.components, made.call_args_list, strict=True):
        field, share = call.args[1:3]
        band = Band(one.outward, one.inward)
        depth = nodes.known_at(field, everything).astype(np.float32)
        shares = nodes.interpolated(share.astype(np.float32), everything)
        weights = np.zeros(len(everything), np.float32)
        weights[one.core.vertices] = one.core.values
        weights[one.vertices] = one.share * weights_at(one.depth, band)
        np.testing.assert_allclose(weights, shares * weights_at(depth, band), atol=1e-5)


def test_bands_do_not_depend_on_the_unit():
    border = 0.2 * np.stack([np.cos(np.arange(8)), 0 * np.arange(8), np.sin(np.arange(8))], axis=1)
    for unit in (1e-9, 1e9):
        sizes = unit * np.array([0.3, 0.3, 1.0])
        limb = Component(None, unit * border, np.array([0.0, 1, 0]), *sizes, sizes[-1], 1.0, None, None, None, None)
        affine = np.column_stack([np.eye(3), (0.4 * unit, 0, 0)])
        found = band_of(limb, affine, np.eye(3, 4), 9.0 * unit)
        assert np.divide(found[:2], unit) == pytest.approx((0.3, 0.9))


def test_two_places_at_nearly_one_position_are_smoothed():
    """Their edge is so short that in the equations of the smoothing, the mass of both is below rounding errors."""
    pair = csr_array(([1e-9, 1e-9], ([0, 1], [1, 0])), shape=(2, 2))
    np.testing.assert_allclose(module._smoothed(pair, np.array([0.1, 0.3]), -1.0, 1.0, 0.5), 0.2, atol=1e-3)
