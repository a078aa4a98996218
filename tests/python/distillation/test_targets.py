"""Test the targets of the fit: interpolation of tokens, unit length, and means over groups."""

import numpy as np
import pytest

import dfd
from dfd.distillation.targets import PixelTargets, PointTargets, side_by_side
from dfd.views.render import Views


@pytest.fixture
def views():
    """Return four points in two pictures of 8 × 8 pixels; each picture has a grid of 2 × 2 tokens."""
    return Views(
        images=np.zeros((2, 8, 8, 3), np.uint8),
        covered=np.ones((2, 8, 8), bool),
        cameras=[],
        points=np.arange(12, dtype=np.float32).reshape(4, 3),
        view=np.array([0, 0, 1, 1], np.int16),
        row=np.array([1.5, 3.5, 0.0, 7.0], np.float32),
        column=np.array([1.5, 3.5, 5.5, 7.0], np.float32),
        face=np.zeros(4, np.int32),
        vertices=np.zeros((3, 3), np.float32),
        faces=np.zeros((1, 3), np.int32),
        center=np.zeros(3),
        scale=1.0,
    )


@pytest.fixture
def tokens():
    return np.random.default_rng(0).normal(size=(2, 2, 2, 5)).astype(np.float32)


def test_tokens_lie_at_patch_centers_and_are_interpolated_between(views, tokens):
    targets = PixelTargets(views, tokens).rows(np.arange(4))

    def unit(row):
        return row / np.linalg.norm(row)

    np.testing.assert_allclose(targets[0], unit(tokens[0, 0, 0]), atol=1e-6)  # position 1.5 is the center of patch 0
    np.testing.assert_allclose(targets[1], unit(tokens[0].mean(axis=(0, 1))), atol=1e-6)  # the picture's middle
    np.testing.assert_allclose(targets[2], unit(tokens[1, 0, 1]), atol=1e-6)  # tokens are not extrapolated
    np.testing.assert_allclose(targets[3], unit(tokens[1, 1, 1]), atol=1e-6)


def test_means_of_groups_are_means_of_unit_tokens(views, tokens):
    pixels = PixelTargets(views, tokens)
    before = tokens.copy()
    mean = pixels.means_by(pixels.grid.means(np.array([0, 2, 3]), np.array([2, 0, 0]), 4))
    np.testing.assert_array_equal(tokens, before)
    unit = tokens / np.linalg.norm(tokens, axis=-1, keepdims=True)
    np.testing.assert_allclose(mean[0], (unit[1, 0, 1] + unit[1, 1, 1]) / 2, atol=1e-6)
    np.testing.assert_allclose(mean[2], unit[0, 0, 0], atol=1e-6)
    assert not mean[[1, 3]].any()


def test_means_are_the_same_on_any_number_of_threads(views):
    tokens = np.random.default_rng(0).normal(size=(2, 60, 60, 5)).astype(np.float32)
    pixels = PixelTargets(views, tokens)
    generator = np.random.default_rng(1)
    shares = pixels.grid.means(generator.integers(0, 4, 9000), generator.integers(0, 3000, 9000), 3000)
    means = []
    for count in (1, 2, 5):
        dfd.set_num_threads(count)
        means.append(pixels.means_by(shares))
    np.testing.assert_array_equal(means[0], means[1])
    np.testing.assert_array_equal(means[0], means[2])


def test_squared_distances_side_by_side_are_weighted_means():
    generator = np.random.default_rng(0)
    points = generator.normal(size=(50, 3)).astype(np.float32)
    angle = generator.normal(size=(2, 50))
    seen = [np.stack([np.cos(each), np.sin(each), *np.zeros((2, 50))], axis=1).astype(np.float32) for each in angle]
    one, other = PointTargets(points, seen[0]), PointTargets(points[:49], seen[1][:49])
    assert side_by_side([one], [1.0]) is one
    both = side_by_side([one, other], [0.75, 0.25])
    assert both.points is points
    assert both.dimension == 4
    first, second, pairs = (np.square(rows[:20] - rows[20:40]).sum(axis=1) for rows in (*seen, both.targets))
    np.testing.assert_allclose(pairs, 0.75 * first + 0.25 * second, atol=1e-5)
