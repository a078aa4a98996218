"""Suggested handles."""

from __future__ import annotations

import numpy as np
import pytest

import dfd
from dfd.editing.suggestions import suggest_handles


def features_of(labels: np.ndarray, width: int = 8) -> np.ndarray:
    """Unit rows that are equal within a part and at right angles between parts."""
    return np.eye(width, dtype=np.float32)[labels]


@pytest.fixture(scope="module")
def sample():
    return dfd.samples.chair(4000)


def test_there_is_one_handle_for_each_kind_of_part(sample) -> None:
    found = suggest_handles(sample.mesh, features_of(sample.labels))
    assert sorted(sample.labels[each.vertex] for each in found) == [0, 1, 2]
    assert sum(each.share for each in found) == pytest.approx(1)
    leg = next(each for each in found if sample.parts[sample.labels[each.vertex]] == "leg")
    legs = {int(sample.instances[counterpart.vertex]) for counterpart in leg.counterparts}
    assert leg.counterparts[0].vertex == leg.vertex
    assert legs == {0, 1, 2, 3}


def test_no_more_than_asked_for_and_the_same_every_time(sample) -> None:
    rows = features_of(sample.labels)
    (one,) = suggest_handles(sample.mesh, rows, count=1)
    (again,) = suggest_handles(sample.mesh, rows, count=1)
    assert (one.vertex, one.share) == (again.vertex, 1.0)
    kept = rows.copy()
    suggest_handles(sample.mesh, rows)
    np.testing.assert_array_equal(rows, kept)


def test_a_shape_that_looks_alike_everywhere_has_one_handle(sample) -> None:
    assert len(suggest_handles(sample.mesh, features_of(np.zeros_like(sample.labels)))) == 1


@pytest.mark.parametrize("count", [0, -1, 1.5])
def test_odd_counts_are_refused(sample, count) -> None:
    with pytest.raises(ValueError, match="`count` must be a whole number"):
        suggest_handles(sample.mesh, features_of(sample.labels), count=count)
