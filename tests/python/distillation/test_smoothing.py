"""Test the smoothing of features: its energy, components close together, hidden components and mirror links."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from dfd import Mesh
from dfd.common.progress import Stages
from dfd.distillation import smoothing
from dfd.distillation.targets import PixelTargets
from dfd.geometry.topology import face_areas, sample_surface
from dfd.views.render import render


def views_of(mesh):
    return render(mesh, views=8, resolution=64)


def colored(views, color):
    """Return targets that are the `color` (P, D) of each surface point, as if every pixel were a patch."""
    count, size = views.images.shape[:2]
    tokens = np.ones((count, size, size, color.shape[1]), np.float32)
    tokens[views.view, views.row.astype(int), views.column.astype(int)] = color
    return PixelTargets(views, tokens)


def smooth(views, pixels, **how):
    problem = smoothing.build_diffusion(views, pixels.grid, **how)
    return smoothing.smooth_along_surface(pixels, problem, stages=Stages(show=False))


def spread(views, pixels, **how):
    """Return the points and their smooth features (N, D)."""
    targets = smooth(views, pixels, **how)
    return targets.points, targets.features


def two_sheets(gap):
    grid = trimesh.creation.box((1, 0.01, 1)).subdivide().subdivide()
    other = grid.copy().apply_translation((0, gap, 0))
    both = trimesh.util.concatenate([grid, other])
    return Mesh(both.vertices, both.faces)


@pytest.mark.parametrize("gradient", [(1.0, 0.0, 0.0), (0.3, -0.5, 0.8)])
def test_the_energy_is_the_integral_of_the_squared_gradient(gradient):
    # On the unit sphere, the function f(p) = g · p has ∫ ‖∇f‖² = 8π/3 · ‖g‖².
    sphere = trimesh.creation.icosphere(subdivisions=4)
    points, _ = sample_surface(sphere.vertices, sphere.faces.astype(np.int32), 8000, np.random.default_rng(0))
    area = face_areas(sphere.vertices, sphere.faces).sum() / len(points)
    piece = np.zeros(len(points), np.int32)
    laplacian = smoothing._laplacian(smoothing._surface_links(points, piece, piece == 0, area))
    values = points @ np.array(gradient)
    assert values @ (laplacian @ values) == pytest.approx(8 * np.pi / 3 * np.dot(gradient, gradient), rel=0.05)
    assert abs(laplacian @ np.ones(len(points))).max() < 1e-9


def test_sheets_close_together_do_not_mix():
    views = views_of(two_sheets(0.04))
    upper = views.points[:, 1] > 0
    color = np.stack([upper, ~upper], axis=1)
    points, targets = spread(views, colored(views, color), smoothing=0.3, seed=0)
    share = targets[:, 0] / targets.sum(axis=1)
    assert share[points[:, 1] > 0].mean() > 0.9
    assert share[points[:, 1] < 0].mean() < 0.1


def test_hidden_components_get_the_features_of_near_components():
    shell, core = trimesh.creation.icosphere(radius=1.0), trimesh.creation.icosphere(radius=0.9)
    both = trimesh.util.concatenate([shell, core])
    views = views_of(Mesh(both.vertices, both.faces))
    right = views.points[:, 0] > 0
    points, targets = spread(views, colored(views, np.stack([right, ~right], axis=1)), smoothing=0.1, seed=0)
    inside = np.linalg.norm(points, axis=1) < 0.95
    assert inside.sum() > 1000
    far = inside & (np.abs(points[:, 0]) > 0.5)
    assert ((targets[far, 0] > targets[far, 1]) == (points[far, 0] > 0)).mean() > 0.95


def test_targets_are_unit_and_the_same_twice():
    views = views_of(two_sheets(0.5))
    pixels = colored(views, np.abs(views.points) + 0.1)
    points, targets = spread(views, pixels, smoothing=0.2, seed=3)
    np.testing.assert_allclose(np.linalg.norm(targets, axis=1), 1, atol=1e-5)
    again = spread(views, pixels, smoothing=0.2, seed=3)
    np.testing.assert_array_equal(points, again[0])
    np.testing.assert_array_equal(targets, again[1])


def test_smoothing_makes_neighbors_similar_and_keeps_the_mean_distance():
    views = views_of(two_sheets(0.5))
    noise = np.random.default_rng(0).random((len(views.points), 4))
    pixels = colored(views, noise)
    wanted = pixels.rows(np.random.default_rng(0).permutation(len(noise)))
    wanted = np.linalg.norm(wanted[1:] - wanted[:-1], axis=1).mean()
    unlike = []
    for width in (0.05, 0.15, 0.5):
        points, targets = spread(views, pixels, smoothing=width, seed=0)
        _, near = cKDTree(points).query(points, 2)
        unlike.append(np.linalg.norm(targets[near[:, 1]] - targets, axis=1).mean())
        some = np.random.default_rng(1).permutation(len(targets))
        if width < 0.1:  # more smoothing of noise needs a larger factor than `LARGEST_STRETCH`
            assert np.linalg.norm(targets[some] - targets, axis=1).mean() == pytest.approx(0.75 * wanted, rel=0.05)
    assert unlike[0] > 1.5 * unlike[1] > 2 * unlike[2]


def test_targets_have_components_if_there_are_several():
    gap = 0.4
    views = views_of(two_sheets(gap))
    targets = smooth(views, colored(views, np.ones((len(views.points), 1))), smoothing=0.3, seed=0)
    np.testing.assert_array_equal(targets.component, targets.points[:, 1] > 0)
    np.testing.assert_allclose(targets.boxes[1, [1, 4]] - targets.boxes[0, [1, 4]], gap * views.scale, atol=1e-5)
    box = trimesh.creation.box((1, 1, 1))
    one = views_of(Mesh(box.vertices, box.faces))
    alone = smooth(one, colored(one, np.ones((len(one.points), 1))), smoothing=0.3, seed=0)
    assert alone.component is None
    assert alone.boxes is None


def test_mirror_links_reduce_differences_between_sides():
    views = views_of(two_sheets(0.5))
    right = views.points[:, 0] > 0
    base = np.column_stack([np.ones(len(right)), views.points[:, 1] > 0, np.zeros(len(right))]).astype(float)
    base[right, 2] = 0.3  # as if a lamp lit one side
    pixels = colored(views, base)
    points, targets = spread(views, pixels, smoothing=0.3, seed=0)
    left = points[:, 0] < -0.5
    sides = np.linalg.norm(targets[left].mean(axis=0) - targets[points[:, 0] > 0.5].mean(axis=0))
    levels = np.linalg.norm(targets[points[:, 1] > 0].mean(axis=0) - targets[points[:, 1] < 0].mean(axis=0))
    assert sides < 0.5 * levels
