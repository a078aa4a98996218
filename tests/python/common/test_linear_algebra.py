"""Vectors of length 1."""

import numpy as np

from dfd.common.linear_algebra import unit


def test_rows_have_length_1_and_what_has_no_direction_is_0():
    rows = np.array([[3.0, 4.0], [0.0, 0.0], [1e-5, 0.0]], np.float32)
    np.testing.assert_allclose(unit(rows), [[0.6, 0.8], [0, 0], [1, 0]], atol=1e-7)
    np.testing.assert_array_equal(unit(rows, least=1e-4)[2], [0, 0])
    np.testing.assert_array_equal(rows[0], [3, 4])
    assert unit(np.zeros((0, 3))).shape == (0, 3)
