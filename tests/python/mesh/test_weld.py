"""Positions that are one: which rows of a list are distinct, and which is which."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dfd.mesh.weld import weld


@given(arrays(np.int8, st.tuples(st.integers(0, 40), st.just(3)), elements=st.integers(-1, 1)))
@settings(max_examples=50, deadline=None)
def test_weld_numbers_distinct_rows_in_order_of_appearance(values: np.ndarray) -> None:
    positions = values * 0.1
    first, vertex = weld(positions)
    assert np.array_equal(positions[first][vertex], positions)
    assert len({tuple(row) for row in (positions + 0.0).tolist()}) == len(first)
    assert np.all(np.diff(first) > 0)


def test_weld_takes_minus_zero_for_zero_and_nothing_else_for_equal() -> None:
    tiny = np.nextafter(0, 1)
    first, vertex = weld(np.array([(0.0, 0, 0), (-0.0, 0, 0), (tiny, 0, 0)]))
    assert first.tolist() == [0, 2]
    assert vertex.tolist() == [0, 0, 1]
