"""Principal directions: orthonormal, the largest moments first."""

from __future__ import annotations

import numpy as np
import pytest

from dfd.common.linear_algebra import principal_directions


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_rows_of_few_directions_are_kept_whole(dtype: type[np.floating]) -> None:
    random = np.random.default_rng(0)
    rows = (random.normal(size=(500, 20)) @ random.normal(size=(20, 300))).astype(dtype)
    before = rows.copy()
    directions = principal_directions(rows, 128)
    assert (directions.shape, directions.dtype) == ((128, 300), dtype)
    np.testing.assert_allclose(directions @ directions.T, np.eye(128), atol=1e-5)
    np.testing.assert_allclose(rows @ directions.T @ directions, rows, atol=1e-3)
    moments = np.square(rows @ directions.T).sum(axis=0)
    assert (np.diff(moments) <= 1e-4 * moments[0]).all()
    assert moments[20:].max() < 1e-5 * moments[0]
    np.testing.assert_array_equal(rows, before)


def test_the_axes_of_an_ellipsoid_come_longest_first() -> None:
    rows = np.eye(3) * [[1.0], [9.0], [2.0]]
    np.testing.assert_allclose(np.abs(principal_directions(rows)), [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("width", [1, 5, 16])
def test_narrow_rows_keep_all_their_directions(width: int) -> None:
    rows = np.random.default_rng(1).normal(size=(100, width)).astype(np.float32)
    directions = principal_directions(rows, 128)
    np.testing.assert_allclose(directions.T @ directions, np.eye(width), atol=1e-5)
