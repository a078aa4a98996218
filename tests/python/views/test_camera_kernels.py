"""Rays of a camera against their slow twin, and which pixels need one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dfd import Mesh, _core, reference
from dfd.views.cameras import Camera, camera_towards, place_cameras
from dfd.views.raycast import Scene
from dfd.views.shading import Shading

TRIANGLE = np.array([[0, 1, 2]], np.int32)


def made(seed: int, faces: int = 30, size: float = 0.3) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Triangles here and there within the box of normalized coordinates, thin ones and some without area."""
    generator = np.random.default_rng(seed)
    middles = generator.uniform(-1 + size, 1 - size, (faces, 1, 3))
    corners = middles + generator.uniform(-size, size, (faces, 3, 3)) * generator.choice([1, 0.02, 0], (faces, 1, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * faces, dtype=np.int32).reshape(-1, 3)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10_000), resolution=st.sampled_from([1, 2, 7, 30]))
def test_rays_are_those_of_the_twin(seed: int, resolution: int) -> None:
    direction = np.random.default_rng(seed).normal(size=3)
    camera = camera_towards(direction, made(0)[0])
    found, exact = camera.ray_directions(resolution), reference.ray_directions(camera, resolution)
    np.testing.assert_allclose(found, exact, atol=1e-7)
    some = np.flatnonzero(np.random.default_rng(seed).random(resolution**2) < 0.5)
    np.testing.assert_array_equal(camera.ray_directions(resolution, some), found[some])


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    resolution=st.sampled_from([7, 16, 61, 200]),
    size=st.sampled_from([0.01, 0.3, 0.9]),
    distance=st.sampled_from([1.2, 2.8, 50.0]),
)
def test_no_ray_that_is_left_out_meets_the_surface(seed: int, resolution: int, size: float, distance: float) -> None:
    vertices, faces = made(seed, size=size)
    before = vertices.copy(), faces.copy()
    axis = np.random.default_rng(seed).normal(size=3)
    near = camera_towards(axis, vertices)
    camera = Camera(distance * np.sqrt(3) * near.back, near.right, near.up, near.back)
    for each in (near, camera):
        pixels = each.may_show(vertices, faces, resolution)
        hits = Scene(vertices, faces).cast(each.position, each.ray_directions(resolution))
        assert np.isin(hits.ray, pixels).all()
        assert (np.diff(pixels) > 0).all()
    np.testing.assert_array_equal(vertices, before[0])
    np.testing.assert_array_equal(faces, before[1])


def test_pictures_are_those_of_all_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = made(1, faces=200)
    mesh = Mesh(vertices, faces)
    shading = Shading(Scene(vertices, faces), mesh, vertices)
    cameras = place_cameras(6, vertices)
    some = [shading.picture(camera, 120) for camera in cameras]
    counts = [len(camera.may_show(vertices, faces, 120)) for camera in cameras]
    assert max(counts) < 0.9 * 120**2  # or this says nothing
    monkeypatch.setattr(Camera, "may_show", lambda self, vertices, faces, resolution: np.arange(resolution**2))
    for (image, hits), camera in zip(some, cameras, strict=True):
        whole, all_hits = shading.picture(camera, 120)
        np.testing.assert_array_equal(image, whole)
        for name in ("ray", "face", "barycentric", "distance"):
            np.testing.assert_array_equal(getattr(hits, name), getattr(all_hits, name))


def test_squares_far_from_a_triangle_show_nothing() -> None:
    # At distance 2 with a half width of 1 at distance 1, the picture of 64 pixels is 4 wide: 16 pixels a unit.
    frame = np.array([[0, 0, 2], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    vertices = np.array(
        [[0.1, 0.1, 0], [0.3, 0.1, 0], [0.1, 0.3, 0]], np.float32
    )  # columns 33.1 to 36.3, rows up to 29.9
    shown = np.empty((64, 64), np.uint8)
    _core.may_show(frame, 1.0, 64, vertices, TRIANGLE, shown)
    wanted = np.zeros((64, 64), np.uint8)
    wanted[24:32, 24:40] = 1  # its own square, and the one within a pixel and a half
    assert np.argwhere(shown).min(axis=0).tolist() == [24, 24]
    assert np.argwhere(shown).max(axis=0).tolist() == [31, 39]
    np.testing.assert_array_equal(shown, wanted)


def test_of_what_is_not_before_the_eye_nothing_is_left_out() -> None:
    frame = np.array([[0, 0, 2], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    shown = np.zeros((20, 20), np.uint8)
    for z in (2.0, 5.0, np.nan):
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, z]], np.float32)
        shown[:] = 0
        _core.may_show(frame, 1.0, 20, vertices, TRIANGLE, shown)
        assert shown.all()


def test_what_no_face_uses_counts_for_nothing_and_neither_does_what_is_beside_the_picture() -> None:
    frame = np.array([[0, 0, 2], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    vertices = np.array([[9, 0, 0], [9, 1, 0], [8, 0, 0], [0, 0, 7]], np.float32)
    shown = np.ones((20, 20), np.uint8)
    _core.may_show(frame, 1.0, 20, vertices, TRIANGLE, shown)
    assert not shown.any()
    _core.may_show(frame, 1.0, 20, vertices, np.zeros((0, 3), np.int32), shown)
    assert not shown.any()


def test_more_faces_than_pixels_are_not_gone_through() -> None:
    vertices, faces = made(0, faces=30)
    camera = camera_towards((0, 0, 1), vertices)
    np.testing.assert_array_equal(camera.may_show(vertices, faces, 5), np.arange(25))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"frame": np.zeros((3, 3))}, "may_show: `frame` must have shape (4, 3), `half_width` and `resolution` be"),
        ({"half_width": 0.0}, "may_show: `frame` must have shape (4, 3), `half_width` and `resolution` be above 0"),
        ({"vertices": np.zeros((3, 2), np.float32)}, "may_show: `vertices` must have shape (V, 3)"),
        ({"faces": TRIANGLE + 1}, "may_show: `faces` must be (F, 3) vertex indices"),
        ({"faces": TRIANGLE[:, :2].copy()}, "may_show: `faces` must be (F, 3) vertex indices"),
        ({"out": np.zeros((7, 8), np.uint8)}, "may_show: `out` must have a row and a column for each of the picture's"),
    ],
)
def test_what_cannot_be_seen_is_refused(wrong: dict[str, Any], message: str) -> None:
    given = {
        "frame": np.concatenate([np.zeros((1, 3)), np.eye(3)]),
        "half_width": 1.0,
        "resolution": 8,
        "vertices": np.zeros((3, 3), np.float32),
        "faces": TRIANGLE,
        "out": np.zeros((8, 8), np.uint8),
    }
    with pytest.raises(ValueError) as error:  # noqa: PT011  # the message is compared
        _core.may_show(**{**given, **wrong})
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"frame": np.zeros((4, 2))},
            "ray_directions: `frame` must have shape (4, 3), `half_width` and `resolution` be",
        ),
        ({"resolution": 0}, "ray_directions: `frame` must have shape (4, 3), `half_width` and `resolution` be above 0"),
        ({"pixels": np.array([0, 64])}, "ray_directions: `pixels` must be those of the picture"),
        ({"pixels": np.array([-1, 0])}, "ray_directions: `pixels` must be those of the picture"),
        ({"out": np.zeros((3, 3), np.float32)}, "ray_directions: `out` must have shape (N, 3)"),
    ],
)
def test_rays_that_cannot_be_are_refused(wrong: dict[str, Any], message: str) -> None:
    given = {
        "frame": np.concatenate([np.zeros((1, 3)), np.eye(3)]),
        "half_width": 1.0,
        "resolution": 8,
        "pixels": np.array([0, 5]),
        "out": np.zeros((2, 3), np.float32),
    }
    with pytest.raises(ValueError) as error:  # noqa: PT011  # the message is compared
        _core.ray_directions(**{**given, **wrong})
    assert str(error.value).startswith(message)
