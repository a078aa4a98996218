"""Which pixels need a ray: no other one shows the surface."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dfd import Mesh
from dfd.views.cameras import Camera, camera_towards, place_cameras
from dfd.views.raycast import Scene
from dfd.views.shading import Shading


def made(seed: int, faces: int = 30, size: float = 0.3) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Triangles here and there within the box of normalized coordinates, thin ones and some without area."""
    generator = np.random.default_rng(seed)
    middles = generator.uniform(-1 + size, 1 - size, (faces, 1, 3))
    corners = middles + generator.uniform(-size, size, (faces, 3, 3)) * generator.choice([1, 0.02, 0], (faces, 1, 3))
    return corners.reshape(-1, 3).astype(np.float32), np.arange(3 * faces, dtype=np.int32).reshape(-1, 3)


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
