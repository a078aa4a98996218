"""Compare the slow reference functions with numbers that were computed by hand from the paper's equations."""

import numpy as np
import reference

import dfd


def test_feature_weights():
    features = np.array([[1.0, 0.0], [0.8, 0.6], [0.0, 1.0]])
    expected = [[1.0], [1 - np.sqrt(0.4)], [0.0]]
    np.testing.assert_allclose(reference.feature_weights(features, features[:1]), expected, atol=1e-15)
    assert reference.feature_weights(features, features[:0]).shape == (3, 0)


def test_subtract_fixed():
    weights = np.array([[0.9, 0.2], [0.5, 0.5]])
    np.testing.assert_allclose(
        reference.subtract_fixed(weights, [[0.3, 0.1], [0.0, 0.5]]), [[0.6, 0.0], [0.0, 0.0]], atol=1e-15
    )
    np.testing.assert_array_equal(reference.subtract_fixed(weights, np.zeros((2, 0))), weights)


def test_geodesic_falloff():
    weights = np.ones((3, 2))
    falloff = reference.geodesic_falloff(weights, [[0.0, 0.5, 1.0], [0.0, 0.5, 1.0]], [2.0, 0.0])
    np.testing.assert_allclose(falloff, [[1.0, 1.0], [0.25, 1.0], [0.0, 1.0]])


def test_pose():
    shift = np.eye(3, 4)
    shift[:, 3] = [1.0, 2.0, 3.0]
    double = np.eye(3, 4) * 2
    moved = reference.pose([[1.0, 1.0, 1.0]], [[0.5, 0.25]], [shift, double])
    np.testing.assert_allclose(moved, [[1.75, 2.25, 2.75]])
    moved = reference.pose([[1.0, 1.0, 1.0]], [[0.5]], [shift], default=double)
    np.testing.assert_allclose(moved, [[2.0, 2.5, 3.0]])


def test_mirrored_pose():
    plane = dfd.SymmetryPlane((1.0, 0.0, 0.0), 1.0)
    shift = np.eye(3, 4)
    shift[:, 3] = [1.0, 2.0, 0.0]
    vertices = np.array([[3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    moved = reference.pose(vertices, np.ones((2, 1)), [shift], symmetry=plane, handles=[0])
    np.testing.assert_allclose(moved, [[4.0, 2.0, 0.0], [-2.0, 2.0, 0.0]])
    moved = reference.pose(vertices, np.ones((2, 1)), [shift], symmetry=plane, handles=[1])
    np.testing.assert_allclose(moved, [[2.0, 2.0, 0.0], [0.0, 2.0, 0.0]])


def test_positive_share():
    plane = dfd.SymmetryPlane((0.0, 1.0, 0.0), 0.5, band=0.25)
    vertices = np.array([[0.0, y, 0.0] for y in (0.0, 0.25, 0.5, 0.625, 0.75, 2.0)])
    np.testing.assert_allclose(reference.positive_share(vertices, plane), [0, 0, 0.5, 0.84375, 1, 1])
    sharp = dfd.SymmetryPlane((0.0, 1.0, 0.0), 0.5)
    np.testing.assert_array_equal(reference.positive_share(vertices, sharp), [0, 0, 1, 1, 1, 1])
