"""Test the colors of weights and features."""

import numpy as np
import pytest

from dfd.pictures.colors import feature_colors, oklab, weight_colors


def test_heat_darkens_in_even_steps():
    lab = oklab(weight_colors(np.linspace(0, 1, 101)))
    assert (np.diff(lab[:, 0]) < 0).all()
    steps = np.linalg.norm(np.diff(lab, axis=0), axis=1)
    assert steps.max() < 1.1 * np.median(steps)
    assert steps.min() > 0.75 * np.median(steps)  # a step across a color stop cuts the corner, so it is shorter


def test_similar_features_get_similar_colors():
    random = np.random.default_rng(1)
    centers = np.eye(8)[:4] * 4
    features = np.repeat(centers, 50, axis=0) + random.normal(scale=0.02, size=(200, 8))
    colors = feature_colors(features).reshape(4, 50, 3)
    assert colors.std(axis=1).max() < 0.1
    means = colors.mean(axis=1)
    assert min(np.linalg.norm(means[i] - means[j]) for i in range(4) for j in range(i)) > 0.4
    assert colors.min() >= 0
    assert colors.max() <= 1


def test_feature_colors_do_not_depend_on_scale_offset_or_order():
    features = np.random.default_rng(2).normal(size=(300, 12))
    colors = feature_colors(features)
    np.testing.assert_allclose(feature_colors(features * 1000 + 5), colors, atol=2e-3)
    np.testing.assert_allclose(feature_colors(features[::-1])[::-1], colors, atol=1e-4)


@pytest.mark.parametrize("features", [np.ones((5, 4)), np.ones((1, 3)), np.zeros((4, 1))])
def test_features_without_spread_are_gray(features):
    np.testing.assert_allclose(feature_colors(features), 0.5, atol=1e-6)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: weight_colors([[1.0]]), "`weights` must have shape"),
        (lambda: weight_colors([np.nan]), "`weights` must be finite"),
        (lambda: feature_colors(np.ones(4)), "`features` must have shape"),
        (lambda: feature_colors([[np.inf, 1.0]]), "`features` must be finite"),
        (lambda: feature_colors(np.ones((0, 4))), "`features` must not be empty"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(ValueError, match=message):
        call()
