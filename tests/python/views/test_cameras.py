"""Test cameras: even directions, orthonormal bases, tight framing of the whole shape, and mirrored pairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dfd.views.cameras import CLEARANCE, MARGIN, camera_towards, fibonacci_directions, place_cameras


def cloud(seed, count, stretch=(1.0, 1.0, 1.0)):
    points = np.random.default_rng(seed).normal(size=(count, 3)) * stretch
    points -= (points.max(axis=0) + points.min(axis=0)) / 2
    return (points / np.abs(points).max()).astype(np.float32)


def depths(camera, points):
    return -(points - camera.position) @ camera.back


def test_directions_spread_evenly_over_the_sphere():
    for count in (1, 2, 3, 24, 200):
        directions = fibonacci_directions(count)
        assert directions.shape == (count, 3)
        assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0)
    assert np.abs(directions.mean(axis=0)).max() < 0.01
    # The mean of d dᵀ over the sphere is a third of the identity.
    assert directions.T @ directions / 200 == pytest.approx(np.eye(3) / 3, abs=0.01)
    between = np.arccos((directions @ directions.T - 2 * np.eye(200)).max(axis=1))
    assert between.min() > 0.5 * np.sqrt(4 * np.pi / 200)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 24, 25, 26, 27])
@pytest.mark.parametrize("axis", [0, 2])
def test_mirrored_directions_are_their_own_mirror_images(count, axis):
    directions = fibonacci_directions(count, mirrored=True)
    assert directions.shape == (count, 3)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1)
    image = directions.copy()
    image[:, axis] *= -1
    found = {tuple(direction) for direction in directions.round(9) + 0.0}
    missing = [direction for direction in image.round(9) + 0.0 if tuple(direction) not in found]
    assert len(missing) == (count % 2 if axis == 2 else 0)  # the camera at the front has no counterpart at the back


@pytest.mark.parametrize("direction", [(0, 1, 0), (0, -1, 0), (0, 0, 1), (1, 0, 0), (1e-9, 1, -1e-9), (0.03, -1, 0.01)])
def test_axes_are_orthonormal_from_everywhere(direction):
    camera = camera_towards(direction, cloud(0, 20))
    axes = np.stack([camera.right, camera.up, camera.back])
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert camera.back == pytest.approx(np.array(direction) / np.linalg.norm(direction))
    assert camera.up[1] >= -1e-8


def test_rays_and_projection_agree_on_pixel_centers():
    camera = camera_towards((0.3, 0.4, -0.8), cloud(1, 50), field_of_view=40)
    directions = camera.ray_directions(7).astype(np.float64)
    assert np.linalg.norm(directions, axis=1) == pytest.approx(1.0, abs=1e-6)
    row, column = camera.project(camera.position + 2.5 * directions, 7)
    assert row == pytest.approx(np.repeat(np.arange(7), 7), abs=1e-5)
    assert column == pytest.approx(np.tile(np.arange(7), 7), abs=1e-5)
    # The first pixel is at the upper left.
    assert directions[0] @ camera.up > 0 > directions[0] @ camera.right
    assert camera.ray_directions(1) == pytest.approx(-camera.back[None], abs=1e-6)


@given(
    seed=st.integers(0, 10_000),
    count=st.integers(2, 200),
    stretch=st.tuples(*[st.sampled_from([1.0, 0.1, 1e-3, 0.0])] * 3),
    mirrored=st.booleans(),
)
def test_framing_cuts_nothing_off_and_is_tight(seed, count, stretch, mirrored):
    if not any(stretch):
        return
    points = cloud(seed, count, stretch)
    clearance = CLEARANCE * np.ptp(points, axis=0).max() / 2
    for camera in place_cameras(5, points, mirrored=mirrored):
        depth = depths(camera, points)
        assert depth.min() >= clearance - 1e-5
        row, column = camera.project(points, 100)
        across = np.abs(np.concatenate([row, column]) - 49.5).max() / 50
        assert across <= 1 / MARGIN + 1e-4
        if depth.min() > clearance + 1e-5:  # not limited by the clearance
            assert across >= 1 / MARGIN - 1e-3
            rims = [abs(place.min() + place.max() - 99) for place in (row, column)]
            assert min(rims) < 0.05  # the shape touches two opposite sides of the picture


def test_the_paper_looks_at_the_origin_from_its_distance():
    for camera in place_cameras(6, cloud(0, 10), framing="paper"):
        assert np.linalg.norm(camera.position) == pytest.approx(2.8)
        row, column = camera.project(np.zeros((1, 3)), 101)
        assert (row[0], column[0]) == pytest.approx((50, 50))


@pytest.mark.parametrize("framing", ["shape", "paper"])
@pytest.mark.parametrize("axis", [0, 2])
def test_mirrored_cameras_are_mirror_images(framing, axis):
    mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
    points = cloud(4, 100)
    points = np.concatenate([points, points * mirror.astype(np.float32)])
    cameras = place_cameras(10, points, framing=framing, mirrored=True)
    partners = {tuple((camera.back * mirror).round(9) + 0.0): camera for camera in cameras}
    for camera in cameras:
        other = partners[tuple(camera.back.round(9) + 0.0)]
        if other is camera:
            continue  # the camera lies in the plane
        for name in ("right", "up", "back"):
            assert getattr(other, name) == pytest.approx(getattr(camera, name) * mirror, abs=1e-12)
        assert other.position == pytest.approx(camera.position * mirror, abs=1e-6)
        assert other.ray_directions(5) == pytest.approx(camera.ray_directions(5) * mirror, abs=1e-6)


@pytest.mark.parametrize("count", [0, -1, 2.0, True, "3", None])
def test_bad_counts_are_refused(count):
    with pytest.raises(ValueError, match="fibonacci_directions: `count` must be a whole number"):
        fibonacci_directions(count)


def test_bad_framing_and_field_of_view_are_refused():
    with pytest.raises(ValueError, match="`framing` must be one of shape, paper, got 'tight'"):
        place_cameras(3, cloud(0, 10), framing="tight")
    for angle in (0, -30, 180, 200, float("nan")):
        with pytest.raises(ValueError, match="`field_of_view` must be"):
            camera_towards((0, 0, 1), cloud(0, 10), field_of_view=angle)
    with pytest.raises(ValueError, match="`direction` must"):
        camera_towards((0, 0, 0), cloud(0, 10))
