"""Reach, falloff and strength: against the twin, and by what they promise."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from weights.made_features import unit_rows

import dfd

FALLOFFS = ["linear", "smooth", "sharp", "root", "sphere", "constant"]


@settings(max_examples=80, deadline=None)
@given(
    count=st.integers(1, 120),
    dimension=st.integers(1, 70),
    handle_count=st.integers(0, 20),
    fixed_count=st.integers(0, 20),
    seed=st.integers(0, 2**32 - 1),
    local=st.booleans(),
    columns=st.booleans(),
)
def test_agrees_with_the_twin(count, dimension, handle_count, fixed_count, seed, local, columns):
    random = np.random.default_rng(seed)
    features = unit_rows(count, dimension, seed=seed, spread=random.uniform(0.01, 1))
    handles = random.permutation(count)[:handle_count]
    options = {
        "fixed": random.integers(0, count, fixed_count),
        "strength": random.choice([0.0, 0.3, 1.0], fixed_count),
        "reach": random.choice([0.2, 0.7, 1.0, 2.5], len(handles)),
        "falloff": random.choice(FALLOFFS[:3] + ["linear"], len(handles)).tolist(),
        "geodesic": random.random((len(handles), count), dtype=np.float32) if local else None,
        "locality": random.uniform(0, 6, len(handles)) if local else 0.0,
    }
    out = np.empty((len(handles), count), np.float32).T if columns else None
    weights = dfd.bind(features, handles, out=out, **options)
    np.testing.assert_allclose(weights, reference.bind(features, handles, **options), rtol=0, atol=5e-5)


@pytest.mark.parametrize("falloff", FALLOFFS)
@pytest.mark.parametrize("reach", [0.3, 1, 1.7, 3])
def test_every_falloff(falloff, reach):
    angles = np.linspace(0, np.pi, 500)  # unit rows at every distance from 0 to 2
    features = np.column_stack([np.cos(angles), np.sin(angles)]).astype(np.float32)
    weights = dfd.bind(features, [0], reach=reach, falloff=falloff)[:, 0]
    distances = np.linalg.norm(features.astype(np.float64) - features[0], axis=1)
    apart = np.abs(distances - reach) > 1e-5  # where they end, √ and constant are steep
    wanted = reference.bind(features, [0], reach=reach, falloff=falloff)[:, 0]
    np.testing.assert_allclose(weights[apart], wanted[apart], rtol=0, atol=1e-4)
    assert weights[0] == 1
    assert (np.diff(weights) <= 0).all()
    assert (weights[distances > reach + 1e-5] == 0).all()
    assert (weights[distances < reach - 1e-5] > 0).all()
    if reach > 2:
        assert (weights > 0).all()


@pytest.mark.parametrize("handle_count", [1, 5, 40])
def test_the_papers_settings_give_the_papers_bits(handle_count):
    features = unit_rows(300, 40)
    fixed = [290, 291, 292]
    plain = dfd.bind(features, np.arange(handle_count), fixed=fixed)
    reach, falloff = [1.0] * handle_count + [0.4], ["linear"] * handle_count + ["smooth"]
    beside = dfd.bind(features, np.arange(handle_count + 1), fixed=fixed, strength=1.0, reach=reach, falloff=falloff)
    np.testing.assert_array_equal(beside[:, :-1], plain)
    np.testing.assert_array_equal(dfd.bind(features, np.arange(handle_count), fixed=fixed, reach=1), plain)


@pytest.mark.parametrize("tolerance", [0.05, 0.002])
def test_compact_features_take_them_too(tolerance):
    features = unit_rows(500, 48, spread=0.2)
    compact = dfd.compact(features, tolerance=tolerance)
    stored = compact.step * compact.stored(np.arange(500)).astype(np.float64)
    handles, reach = [1, 2, 3], [0.3, 1.0, 2.0]
    options = {"reach": reach, "falloff": ["smooth", "sphere", "sharp"], "fixed": [7, 8], "strength": [0.5, 0.25]}
    weights, wanted = dfd.bind(compact, handles, **options), reference.bind(stored, handles, **options)
    np.testing.assert_allclose(weights, wanted, rtol=0, atol=2e-5)
    free = dfd.bind(compact, handles, reach=reach, falloff="root")
    np.testing.assert_array_equal(free[handles, [0, 1, 2]], 1)


FEATURES = unit_rows(6, 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"reach": 0}, r"`reach` must be above 0, got 0"),
        ({"reach": -1.5}, r"`reach` must be above 0, got -1.5"),
        ({"reach": np.inf}, r"`reach` must be finite, got inf"),
        ({"reach": np.nan}, r"`reach` must be finite, got nan"),
        ({"reach": [1.0, 2.0]}, r"`reach` must have shape \(1,\), got \(2,\)"),
        ({"reach": [0.0]}, r"`reach` must be above 0, got 0"),
        ({"reach": "far"}, r"`reach` must be a number, got 'far'"),
        ({"falloff": "cubic"}, r"`falloff` must be one of linear, smooth, sharp, root, sphere, constant, got 'cubic'"),
        ({"falloff": ["smooth", "sharp"]}, r"`falloff` must be one name or 1, as many as handles, got 2"),
        ({"falloff": [3]}, r"`falloff` must be one of .*, got 3"),
        ({"strength": 0.5}, r"`fixed` must be given when `strength` is"),
        ({"fixed": [1], "strength": 1.5}, r"`strength` must be at most 1, got 1.5"),
        ({"fixed": [1], "strength": -0.5}, r"`strength` must be at least 0, got -0.5"),
        ({"fixed": [1], "strength": [0.5, 0.5]}, r"`strength` must have shape \(1,\), got \(2,\)"),
        ({"fixed": [1], "strength": [np.nan]}, r"`strength` must be finite, got nan"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match="^bind: " + message):
        dfd.bind(FEATURES, [0], **arguments)
