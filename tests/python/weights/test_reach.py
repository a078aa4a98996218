"""The reach that is found where nobody gives one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dfd
from dfd.weights.reach import auto_reach


@pytest.mark.parametrize(("near", "far"), [(0.2, 0.8), (0.5, 1.2), (0.4, 0.7)])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7])
def test_it_ends_in_the_gap_behind_a_part_whatever_share_of_the_shape_that_is(near, far, share):
    random = np.random.default_rng(0)
    part, count = int(2000 * share), 2000
    distances = np.concatenate([random.uniform(0, near, part), random.uniform(far, 1.3, count - part)])
    random.shuffle(distances)
    assert near < auto_reach(distances) < far
    assert auto_reach(distances) == auto_reach(np.sort(distances)[::-1])


@pytest.mark.parametrize("distances", [[], [0.0], [0.0] * 50, [0.0, *[1.3] * 99]])
def test_without_a_gap_it_is_the_paper_s(distances):
    assert auto_reach(np.array(distances, np.float32)) == 1.0


@given(st.lists(st.floats(0, 2), max_size=60))
def test_it_is_a_reach_whatever_the_distances(distances):
    before = np.array(distances)
    reach = auto_reach(before)
    assert reach == 1.0 or 0.35 <= reach <= 0.9
    np.testing.assert_array_equal(before, distances)


@pytest.mark.parametrize(
    ("distances", "message"),
    [
        ([[1.0]], r"auto_reach: `distances` must have shape \(V,\), got \(1, 1\)"),
        ([0.0, -1.0], "auto_reach: `distances` must be at least 0, got -1"),
        ([0.0, np.nan], "auto_reach: `distances` must be finite, got nan"),
    ],
)
def test_what_are_no_distances_is_refused(distances, message):
    with pytest.raises(ValueError, match=message):
        auto_reach(np.array(distances))


def test_it_takes_a_part_and_its_likes_and_little_else():
    sample = dfd.samples.chair(4000)
    leg = sample.labels == sample.parts.index("leg")
    features = np.where(leg[:, None], [1.0, 0.0], [0.3, 0.95])
    features += np.random.default_rng(0).normal(0, 0.05, features.shape)
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    distances = np.linalg.norm(features - features[sample.vertices_of("leg", 0)[0]], axis=1)
    np.testing.assert_array_equal(distances < auto_reach(distances), leg)
