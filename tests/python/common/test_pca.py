"""Principal directions: orthonormal, the largest moments first."""

from __future__ import annotations

import numpy as np
import pytest

from dfd.common.linear_algebra import principal_directions


def test_the_axes_of_an_ellipsoid_come_longest_first() -> None:
    rows = np.eye(3) * [[1.0], [9.0], [2.0]]
    np.testing.assert_allclose(np.abs(principal_directions(rows)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("width", [1, 5, 16])
def test_narrow_rows_keep_all_their_directions(width: int) -> None:
    rows = np.random.default_rng(1).normal(size=(100, width)).astype(np.float32)
    directions = principal_directions(rows, 128)
    np.testing.assert_allclose(directions.T @ directions, np.eye(width), atol=1e-5)
