"""Test the bands of a held part, and unusual borders; `test_recorded_gestures` has the usual ones."""

import numpy as np
import pytest
from made_tube import AROUND, straight
from scipy.sparse import csr_array
from sheet import grid

from dfd.editing.weights import held_part as module
from dfd.editing.weights.fill import Band, Component, band_of, weights_at
from dfd.editing.weights.held_part import hold
from dfd.geometry.coarse import nodes_of

LENGTH, RADIUS, RINGS = 4.0, 0.2, 81
STEP = LENGTH / (RINGS - 1)  # distance between two rings


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
    ],
)
def test_the_band_of_a_motion(room, pull, wanted):
    border = 0.2 * np.stack([np.cos(np.arange(8)), 0 * np.arange(8), np.sin(np.arange(8))], axis=1)
    limb = Component(None, border, np.array([0.0, 1, 0]), 0.3, 0.3, 1.0, room, None, None, None, None)
    affine = np.column_stack([np.eye(3), pull])
    assert band_of(limb, affine, np.eye(3, 4), 9.0)[:2] == pytest.approx(wanted)
    # Only the motion relative to the surroundings counts.
    assert band_of(limb, affine, affine, 9.0)[:2] == pytest.approx((0.03, 0.03))
    # At rest, a band of a small shape is narrower.
    outward = wanted[0] if wanted[0] > 0.03 else 0.0075
    assert band_of(limb, affine, np.eye(3, 4), 1.2)[0] == pytest.approx(outward)


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


def test_bands_do_not_depend_on_the_unit():
    border = 0.2 * np.stack([np.cos(np.arange(8)), 0 * np.arange(8), np.sin(np.arange(8))], axis=1)
    for unit in (1e-9, 1e9):
        sizes = unit * np.array([0.3, 0.3, 1.0])
        limb = Component(None, unit * border, np.array([0.0, 1, 0]), *sizes, 1.0, None, None, None, None)
        affine = np.column_stack([np.eye(3), (0.4 * unit, 0, 0)])
        found = band_of(limb, affine, np.eye(3, 4), 9.0 * unit)
        assert np.divide(found[:2], unit) == pytest.approx((0.3, 0.9))


def test_two_places_at_nearly_one_position_are_smoothed():
    """Their edge is so short that in the equations of the smoothing, the mass of both is below rounding errors."""
    pair = csr_array(([1e-9, 1e-9], ([0, 1], [1, 0])), shape=(2, 2))
    np.testing.assert_allclose(module._smoothed(pair, np.array([0.1, 0.3]), -1.0, 1.0, 0.5), 0.2, atol=1e-3)
