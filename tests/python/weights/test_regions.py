"""Test handles and fixed points that are regions: their weight comes from the member with the nearest feature."""

import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from weights.made_features import unit_rows

import dfd
from dfd.weights.regions import MERGED, MOST_MEMBERS, resolve_points


@given(
    count=st.integers(1, 100),
    dimension=st.integers(2, 60),
    sizes=st.lists(st.integers(1, 20), min_size=1, max_size=12),
    held=st.lists(st.integers(1, 12), max_size=6),
    seed=st.integers(0, 2**32 - 1),
    reach=st.sampled_from([1.0, 0.6]),
)
def test_agrees_with_the_twin(count, dimension, sizes, held, seed, reach):
    random = np.random.default_rng(seed)
    features = unit_rows(count, dimension, seed=seed)
    handles = [random.integers(0, count, size) for size in sizes]
    fixed = [random.integers(0, count, size) for size in held]
    strength = random.uniform(0, 1, len(fixed))
    weights = dfd.bind(features, handles, fixed=fixed, strength=strength, reach=reach)
    wanted = reference.bind(features, handles, fixed=fixed, strength=strength, reach=reach)
    np.testing.assert_allclose(weights, wanted, rtol=0, atol=2e-3 / reach)  # members within 0.001 are left out


@pytest.mark.parametrize("tolerance", [None, 0.05, 0.002])
def test_members_may_be_vertices_and_rows(tolerance):
    features = unit_rows(400, 32, spread=0.2)
    source = features if tolerance is None else dfd.compact(features, tolerance=tolerance)
    mixed = dfd.bind(source, [[1, 2], features[[3, 4]], 5, features[6]])
    vertices = dfd.bind(source, [[1, 2], [3, 4], 5, 6])
    np.testing.assert_allclose(mixed, vertices, rtol=0, atol=2e-6)
    np.testing.assert_array_equal(mixed[[1, 2], 0], 1)
    assert (mixed[[3, 4], 1] == 1).all()


def test_large_regions_are_thinned_to_members_far_apart():
    angles = np.linspace(0, 1, 20_000)
    features = np.column_stack([np.cos(angles), np.sin(angles)]).astype(np.float32)
    region = resolve_points("handles", [np.arange(20_000)], features)
    assert len(region.points) == MOST_MEMBERS
    assert 0 in region.points
    again = resolve_points("handles", [np.arange(20_000)], features)
    np.testing.assert_array_equal(region.points, again.points)
    gaps = np.diff(np.sort(angles[region.points]))
    assert gaps.max() < 0.1
    assert dfd.bind(features, [np.arange(20_000)]).min() > 0.95  # no vertex is farther than half a gap


def test_members_with_nearly_equal_features_are_merged_also_if_features_are_compact():
    rows = np.random.default_rng(0).normal(scale=0.02, size=(2000, 16))
    rows[:, 0] = 1
    rows[1:101] = rows[0] + np.linspace(0, 0.0016, 100)[:, None] * np.eye(16)[1]
    compact = dfd.compact((rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32), tolerance=0.05)
    assert compact.precision == "int8"
    kept = resolve_points("handles", [np.arange(101)], compact).points
    stored = compact.step * compact.stored(kept)
    assert 1 < len(kept) < 5
    assert min(np.linalg.norm(stored[i] - stored[k]) for i in range(len(kept)) for k in range(i)) > MERGED


def test_regions_alone_and_among_others_and_on_many_threads():
    features = unit_rows(20_000, 24)
    regions = [[k, 100 + k, 200 + k] for k in range(30)]
    together = dfd.bind(features, regions, fixed=[[7000, 7001]])
    for k in (0, 13, 29):
        np.testing.assert_array_equal(dfd.bind(features, [regions[k]], fixed=[[7000, 7001]])[:, 0], together[:, k])
    dfd.set_num_threads(5)
    np.testing.assert_array_equal(dfd.bind(features, regions, fixed=[[7000, 7001]]), together)


FEATURES = unit_rows(6, 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"handles": [[1], []]}, r"`handles\[1\]` must have at least one member"),
        ({"handles": [[1, 6]]}, r"`handles\[0\]` must lie in 0 … 5, got 6"),
        ({"handles": [[1], np.array([-7])]}, r"`handles\[1\]` must lie in 0 … 5, got -7"),
        ({"handles": [[1], FEATURES[:, :3]]}, r"`handles\[1\]` must have shape \(N, 4\), got \(6, 3\)"),
        ({"handles": [[1], "all"]}, r"`handles\[1\]` must be a list of vertex indices"),
        ({"handles": [[1], [[1, 2], [3]]]}, r"`handles\[1\]` must be a vertex, vertices or feature rows"),
        ({"handles": [0], "fixed": [[1], []]}, r"`fixed\[1\]` must have at least one member"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match="^bind: " + message):
        dfd.bind(FEATURES, **arguments)
