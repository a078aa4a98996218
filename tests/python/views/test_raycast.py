"""Test intersections of rays with triangles: the conventions of Embree, and rays without a hit."""

import numpy as np
import pytest

from dfd.views.raycast import Scene

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture
def triangle():
    return Scene(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def test_barycentric_weights_belong_to_the_corners_in_order(triangle):
    hits = triangle.cast(np.array([0.2, 0.3, 1.0]), DOWN[None])
    assert hits.ray.tolist() == [0]
    assert hits.face.tolist() == [0]
    assert hits.barycentric == pytest.approx(np.array([[0.5, 0.2, 0.3]]), abs=1e-6)
    assert hits.distance == pytest.approx([1.0])


def test_both_sides_are_hit_and_rays_keep_their_numbers(triangle):
    origins = np.array([[0.2, 0.3, 1.0], [5, 5, 1.0], [0.2, 0.3, -1.0], [0.2, 0.3, 1.0]])
    hits = triangle.cast(origins, np.stack([DOWN, DOWN, -DOWN, -DOWN]))
    assert hits.ray.tolist() == [0, 2]
    assert np.array_equal(hits.barycentric[0], hits.barycentric[1])
    assert (hits.barycentric.dtype, hits.face.dtype, hits.distance.dtype) == (np.float32, np.int32, np.float32)


def test_rays_hit_the_first_of_equal_faces():
    faces = np.array([[0, 1, 2], [1, 2, 0], [2, 1, 0], [1, 3, 2], [2, 3, 1]])
    scene = Scene(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]), faces)
    hits = scene.cast(np.array([[0.2, 0.3, 1.0], [0.9, 0.8, 1.0]]), np.stack([DOWN, DOWN]))
    assert hits.face.tolist() == [0, 3]
    assert hits.barycentric[0] == pytest.approx([0.5, 0.2, 0.3], abs=1e-6)


def test_rays_hardly_slip_through_common_edges():
    n = 40
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij"), -1).reshape(-1, 2)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + n, corner + n + 1], 1), np.stack([corner, corner + n + 1, corner + 1], 1)]
    )
    scene = Scene(np.column_stack([grid, np.sin(3 * grid[:, 0])]), faces)
    # Rays aim at the vertices, and at the middles of the diagonals.
    aims = np.concatenate([grid, (grid[corner] + grid[corner + n + 1]) / 2])
    aims = aims[np.abs(aims).max(axis=1) < 0.99]
    eye = np.array([0.1, 0.2, 5.0])
    hits = scene.cast(eye, np.column_stack([aims, np.sin(3 * aims[:, 0])]) - eye)
    assert len(hits.ray) >= 0.99 * len(aims)  # without `robust`, only six of seven rays hit
    assert hits.barycentric.min() >= 0
    assert hits.barycentric.sum(axis=1) == pytest.approx(1, abs=1e-6)


def test_a_surface_hides_what_is_behind_it_and_not_what_lies_on_it(triangle):
    eye = np.array([0.2, 0.3, 1.0])
    points = np.array([[0.2, 0.3, 0.5], [0.2, 0.3, 0.0], [0.2, 0.3, -0.01], [0.2, 0.3, -1], [5, 5, -1]])
    assert triangle.hides(eye, points, 1e-4).tolist() == [False, False, True, True, False]
    assert triangle.hides(eye, points, 0.1).tolist() == [False, False, False, True, False]
    assert triangle.hides(eye, points[:0], 1e-4).shape == (0,)
