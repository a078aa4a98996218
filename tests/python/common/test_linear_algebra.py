"""Vectors of length 1, and principal directions."""

import numpy as np
import pytest

from dfd.common.linear_algebra import principal_directions, unit


def test_rows_have_length_1_and_what_has_no_direction_is_0():
    rows = np.array([[3.0, 4.0], [0.0, 0.0], [1e-5, 0.0]], np.float32)
    np.testing.assert_allclose(unit(rows), [[0.6, 0.8], [0, 0], [1, 0]], atol=1e-7)
    np.testing.assert_array_equal(unit(rows, least=1e-4)[2], [0, 0])
    np.testing.assert_array_equal(rows[0], [3, 4])
    assert unit(np.zeros((0, 3))).shape == (0, 3)


def test_the_axes_of_an_ellipsoid_come_longest_first():
    rows = np.eye(3) * [[1.0], [9.0], [2.0]]
    np.testing.assert_allclose(np.abs(principal_directions(rows)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("width", [1, 5, 16])
def test_narrow_rows_keep_all_their_directions(width):
    rows = np.random.default_rng(1).normal(size=(100, width)).astype(np.float32)
    directions = principal_directions(rows, 128)
    np.testing.assert_allclose(directions.T @ directions, np.eye(width), atol=1e-5)
