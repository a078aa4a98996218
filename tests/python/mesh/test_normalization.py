"""Every box becomes one of the same size in the same place, however large, small or far away it was."""

from __future__ import annotations

import numpy as np
import pytest

from dfd.mesh.mesh import Mesh
from dfd.mesh.normalization import box_normalization, normalization

TRIANGLE = np.array([[1.0, 2, 3], [5, 2, 3], [1, 3, 3]])


def test_the_frame_brings_points_there_and_back() -> None:
    frame = normalization(Mesh(TRIANGLE, [[0, 1, 2]]))
    placed = frame.apply(TRIANGLE)
    assert placed.min() == -1
    assert placed.max() == 1
    assert frame.invert(placed) == pytest.approx(TRIANGLE)


@pytest.mark.parametrize("factor", [1, 1e-300, 1e-30, 1e30, 3e307])
def test_any_size_will_do(factor: float) -> None:
    center, scale = normalization(Mesh(factor * TRIANGLE, [[0, 1, 2]]))
    assert center == pytest.approx(factor * np.array([3, 2.5, 3]))
    assert scale == pytest.approx(0.5 / factor)


def test_a_box_across_all_numbers_does_not_overflow() -> None:
    most = np.finfo(np.float64).max
    found = box_normalization(np.full(3, -most), np.full(3, most))
    assert found is not None
    assert found[0] == pytest.approx([0, 0, 0])
    assert found[1] == pytest.approx(1 / most)


def test_one_point_has_no_size() -> None:
    assert box_normalization(np.ones(3), np.ones(3)) is None
    assert box_normalization(np.zeros(3), np.full(3, 1e-310)) is None  # its factor would be infinite
    with pytest.raises(ValueError, match="^`mesh` must have some extent, got all vertices at one point"):
        normalization(Mesh(np.ones((3, 3)), [[0, 1, 2]]))
