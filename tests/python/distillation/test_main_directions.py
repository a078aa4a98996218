"""Main directions: those of the largest moments, and a field that is turned back to all of them."""

from __future__ import annotations

import numpy as np
import pytest

from dfd import Field
from dfd.distillation.main_directions import MOST, main_directions, turned


def test_rows_of_few_directions_are_kept_whole() -> None:
    random = np.random.default_rng(0)
    rows = (random.normal(size=(500, 20)) @ random.normal(size=(20, 300))).astype(np.float32)
    directions = main_directions(rows, np.ones(500))
    assert directions.shape == (MOST, 300)
    np.testing.assert_allclose(directions @ directions.T, np.eye(MOST), atol=1e-5)
    np.testing.assert_allclose(rows @ directions.T @ directions, rows, atol=1e-3)
    moments = np.square(rows @ directions.T).sum(axis=0)
    assert (np.diff(moments) <= 1e-4 * moments[0]).all()
    assert moments[20:].max() < 1e-5 * moments[0]


def test_rows_that_do_not_count_have_no_say() -> None:
    rows = np.eye(3, 200, dtype=np.float32) * np.float32([[1], [2], [9]])
    directions = main_directions(rows, np.array([1.0, 1.0, 0.0]))
    np.testing.assert_allclose(np.abs(directions[:2, :3]), [[0, 1, 0], [1, 0, 0]], atol=1e-6)


@pytest.mark.parametrize("width", [5, 16])
def test_narrow_features_keep_all_their_directions(width: int) -> None:
    rows = np.random.default_rng(1).normal(size=(100, width)).astype(np.float32)
    directions = main_directions(rows, np.ones(100))
    np.testing.assert_allclose(directions.T @ directions, np.eye(width), atol=1e-5)


def test_a_turned_field_gives_features_times_directions() -> None:
    random = np.random.default_rng(2)
    directions = np.linalg.qr(random.normal(size=(40, 8)))[0].T.astype(np.float32)
    field = Field.seeded(3, 8, width=16, layers=2, octaves=2, center=(1.0, 2.0, 3.0), scale=0.5, settings={"seed": 3})
    points = random.normal(size=(30, 3))
    wide = turned(field, directions)
    assert (wide.dimension, wide.width, wide.layers, wide.octaves, wide.settings) == (40, 16, 2, 2, {"seed": 3})
    np.testing.assert_allclose(wide(points), field(points) @ directions, atol=1e-6)
    assert not any(parameter.requires_grad for parameter in wide.parameters())
