"""Tests of the normalization of shapes, including very large and very small shapes."""

import numpy as np
import pytest

from dfd.geometry.normalization import box_normalization, normalization
from dfd.mesh.mesh import Mesh

TRIANGLE = np.array([[1.0, 2, 3], [5, 2, 3], [1, 3, 3]])


def test_apply_and_invert_are_inverse():
    found = normalization(Mesh(TRIANGLE, [[0, 1, 2]]))
    normalized = found.apply(TRIANGLE)
    assert normalized.min() == -1
    assert normalized.max() == 1
    assert found.invert(normalized) == pytest.approx(TRIANGLE)


@pytest.mark.parametrize("factor", [1, 1e-300, 1e-30, 1e30, 3e307])
def test_huge_and_tiny_shapes(factor):
    center, scale = normalization(Mesh(factor * TRIANGLE, [[0, 1, 2]]))
    assert center == pytest.approx(factor * np.array([3, 2.5, 3]))
    assert scale == pytest.approx(0.5 / factor)


def test_the_largest_possible_box_does_not_overflow():
    most = np.finfo(np.float64).max
    found = box_normalization(np.full(3, -most), np.full(3, most))
    assert found[0] == pytest.approx([0, 0, 0])
    assert found[1] == pytest.approx(1 / most)


def test_a_box_without_size_has_no_normalization():
    assert box_normalization(np.ones(3), np.ones(3)) is None
    assert box_normalization(np.zeros(3), np.full(3, 1e-310)) is None  # the scale would be infinite
    with pytest.raises(ValueError, match="^`mesh` must have some extent, got all vertices at one point"):
        normalization(Mesh(np.ones((3, 3)), [[0, 1, 2]]))
