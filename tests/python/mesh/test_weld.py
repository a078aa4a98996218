"""Tests of welding, which finds the distinct positions of an array and numbers them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dfd.mesh.weld import weld


@given(arrays(np.int8, st.tuples(st.integers(0, 40), st.just(3)), elements=st.integers(-1, 1)))
def test_vertices_have_the_order_of_their_first_rows(values):
    positions = values * 0.1
    first, vertex = weld(positions)
    assert np.array_equal(positions[first][vertex], positions)
    assert len({tuple(row) for row in (positions + 0.0).tolist()}) == len(first)
    assert np.all(np.diff(first) > 0)


def test_minus_zero_equals_zero_and_there_is_no_tolerance():
    tiny = np.nextafter(0, 1)
    first, vertex = weld(np.array([(0.0, 0, 0), (-0.0, 0, 0), (tiny, 0, 0)]))
    assert first.tolist() == [0, 2]
    assert vertex.tolist() == [0, 0, 1]
