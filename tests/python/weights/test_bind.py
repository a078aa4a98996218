"""Test weights: against the slow reference implementation, against exact values, and with bad input."""

import numpy as np
import pytest
import reference
import torch
from hypothesis import given
from hypothesis import strategies as st
from weights.made_features import unit_rows

import dfd

FALLOFFS = ["linear", "smooth", "sharp", "root", "sphere", "constant"]


@given(
    count=st.integers(1, 200),
    dimension=st.integers(1, 130),
    handle_count=st.integers(0, 20),
    fixed_count=st.integers(0, 40),
    seed=st.integers(0, 2**32 - 1),
    local=st.booleans(),
    shaped=st.booleans(),
    columns=st.booleans(),
)
def test_agrees_with_the_twin(count, dimension, handle_count, fixed_count, seed, local, shaped, columns):
    random = np.random.default_rng(seed)
    features = unit_rows(count, dimension, seed=seed, spread=random.uniform(0.01, 1))
    handles = random.permutation(count)[:handle_count]
    options = {
        "fixed": random.integers(0, count, fixed_count),
        "geodesic": random.random((len(handles), count), dtype=np.float32) if local else None,
        "locality": random.uniform(0, 6, len(handles)) if local else 0.0,
    }
    if shaped:
        options["strength"] = random.choice([0.0, 0.3, 1.0], fixed_count)
        options["reach"] = random.choice([0.2, 0.7, 1.0, 2.5], len(handles))
        options["falloff"] = random.choice(["linear", "smooth", "sharp"], len(handles)).tolist()
    out = np.empty((len(handles), count), np.float32).T if columns else None
    weights = dfd.bind(features, handles, out=out, **options)
    assert weights.dtype == np.float32
    assert columns or weights.flags.c_contiguous
    wanted = reference.bind(features, handles, **options)
    np.testing.assert_allclose(weights, wanted, rtol=0, atol=5e-5 if shaped else 1e-5)


@pytest.mark.parametrize("dimension", [2, 64, 384, 1536])
def test_close_rows_keep_their_digits(dimension):
    features = unit_rows(300, dimension, spread=1e-4)
    np.testing.assert_allclose(dfd.bind(features, [5]), reference.bind(features, [5]), rtol=0, atol=2e-7)


def test_finite_features_whose_distance_overflows_are_simply_far():
    features = np.array([[3e30, 0], [-3e30, 1], [3e30, 0]], np.float32)
    np.testing.assert_array_equal(dfd.bind(features, [0]), [[1], [0], [1]])


def test_handle_weighs_exactly_one_at_itself():
    features = unit_rows(1000, 64, spread=1e-3)
    handles = np.arange(0, 1000, 37)
    geodesic = np.random.default_rng(0).random((len(handles), 1000), dtype=np.float32)
    geodesic[np.arange(len(handles)), handles] = 0
    weights = dfd.bind(features, handles, geodesic=geodesic, locality=2.5)
    np.testing.assert_array_equal(weights[handles, np.arange(len(handles))], 1)
    assert weights.max() == 1


def test_handles_and_fixed_points_may_be_feature_rows():
    features = unit_rows(60, 24)
    between = features[[3]] + features[[4]]
    between /= np.linalg.norm(between)
    weights = dfd.bind(features, between, fixed=features[[7]])
    np.testing.assert_allclose(
        weights,
        reference.subtract_fixed(
            reference.feature_weights(features, between), reference.feature_weights(features, features[[7]])
        ),
        atol=1e-5,
    )
    np.testing.assert_array_equal(dfd.bind(features, features[[5, 9]]), dfd.bind(features, [5, 9]))


@pytest.mark.parametrize("fixed", [[77], [77, 78, 79], list(range(60, 93))])
def test_a_handle_weighs_the_same_alone_and_among_others(fixed):
    features = unit_rows(500, 96)
    together = dfd.bind(features, np.arange(40), fixed=fixed)
    for handle in range(40):
        np.testing.assert_array_equal(dfd.bind(features, [handle], fixed=fixed)[:, 0], together[:, handle])


@pytest.mark.parametrize("locality", [0, 1, 2, 3, 5, 8, 9, 40, 0.5, 1.5, 8.25])
def test_falloff_takes_any_power(locality):
    features = unit_rows(80, 16, spread=0.1)
    geodesic = np.linspace(0, 1, 80, dtype=np.float32)[None]
    weights = dfd.bind(features, [4], geodesic=geodesic, locality=locality)
    wanted = reference.bind(features, [4], geodesic=geodesic, locality=locality)
    np.testing.assert_allclose(weights, wanted, rtol=0, atol=1e-6)


def test_no_vertices_and_no_handles():
    for dimension in (0, 8):
        assert dfd.bind(np.zeros((0, dimension), np.float32), []).shape == (0, 0)
    assert dfd.bind(unit_rows(5, 8), []).shape == (5, 0)
    assert dfd.bind(unit_rows(1, 8), [0]).tolist() == [[1.0]]
    np.testing.assert_array_equal(dfd.bind(unit_rows(5, 8), [0], fixed=[]), dfd.bind(unit_rows(5, 8), [0]))


@pytest.mark.parametrize("change", [np.asfortranarray, lambda a: a[::-1][::-1], lambda a: a.astype(np.float64)])
def test_any_layout_and_type_gives_the_same_weights(change):
    features = unit_rows(50, 12)
    np.testing.assert_array_equal(dfd.bind(change(features), [1]), dfd.bind(features, [1]))


def test_inputs_stay_and_out_is_filled():
    features, geodesic = unit_rows(50, 12), np.full((2, 50), 0.5, np.float32)
    features.flags.writeable = geodesic.flags.writeable = False
    out = np.empty((50, 2), np.float32)
    assert dfd.bind(features, [1, 2], fixed=[3], geodesic=geodesic, locality=1, out=out) is out
    np.testing.assert_array_equal(out, dfd.bind(features, [1, 2], fixed=[3], geodesic=geodesic, locality=1))


def test_torch_tensors_share_their_memory():
    features = torch.from_numpy(unit_rows(50, 12))
    weights = dfd.bind(features, torch.tensor([1, 2]))
    assert isinstance(weights, torch.Tensor)
    np.testing.assert_array_equal(weights.numpy(), dfd.bind(features.numpy(), [1, 2]))
    out = torch.empty(50, 2)
    assert dfd.bind(features, [1, 2], out=out) is out
    np.testing.assert_array_equal(out.numpy(), weights.numpy())


def test_without_recording_tensors_are_taken_as_they_are():
    features = torch.from_numpy(unit_rows(50, 12)).requires_grad_()
    with torch.no_grad():
        np.testing.assert_array_equal(dfd.bind(features, [1]).numpy(), dfd.bind(features.detach(), [1]).numpy())


@pytest.mark.parametrize("falloff", FALLOFFS)
@pytest.mark.parametrize("reach", [0.3, 1.0, 1.7, 2.0, 3])
def test_every_falloff(falloff, reach):
    angles = np.linspace(0, np.pi, 500)  # unit rows at every distance from 0 to 2
    features = np.column_stack([np.cos(angles), np.sin(angles)]).astype(np.float32)
    weights = dfd.bind(features, [0], reach=reach, falloff=falloff)[:, 0]
    distances = np.linalg.norm(features.astype(np.float64) - features[0], axis=1)
    apart = np.abs(distances - reach) > 1e-5  # at the reach, "root" and "constant" are steep
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
NAN_FEATURES = np.where(np.arange(24).reshape(6, 4) == 14, np.nan, FEATURES)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"features": FEATURES[0]}, r"`features` must have shape \(V, D\), got \(4,\)"),
        ({"features": NAN_FEATURES}, r"`features` must be finite, got nan at \[3, 2\]"),
        ({"handles": [6]}, r"`handles` must lie in 0 … 5, got 6"),
        ({"handles": np.array([1, 2**63], np.uint64)}, r"`handles` must lie in 0 … 5, got 9223372036854775808"),
        ({"handles": [2, 3, 2]}, r"`handles` names vertex 2 more than once"),
        ({"handles": [0.5]}, r"`handles` must be a list of vertex indices"),
        ({"handles": np.full((1, 4), np.inf)}, r"`handles` must be finite, got inf at \[0, 0\]"),
        ({"handles": FEATURES[:, :3]}, r"`handles` must have shape \(N, 4\), got \(6, 3\)"),
        ({"fixed": [9]}, r"`fixed` must lie in 0 … 5, got 9"),
        ({"locality": 1}, r"`geodesic` must be given when `locality` is above 0"),
        ({"locality": -1, "geodesic": np.zeros((1, 6))}, r"`locality` must be at least 0, got -1"),
        ({"locality": [1, 2], "geodesic": np.zeros((1, 6))}, r"`locality` must have shape \(1,\), got \(2,\)"),
        ({"geodesic": np.zeros((6, 1))}, r"`geodesic` must have shape \(1, 6\), got \(6, 1\)"),
        ({"geodesic": np.full((1, 6), 1.5)}, r"`geodesic` must lie in \[0, 1\]"),
        ({"out": np.empty((6, 2), np.float32)}, r"`out` must be an array of shape \(6, 1\) and type float32"),
        (
            {"handles": [0, 1], "out": np.empty((6, 4), np.float32)[:, ::2]},
            r"`out` must have contiguous rows or columns",
        ),
        ({"out": np.frombuffer(bytes(24), np.float32).reshape(6, 1)}, r"`out` must be writable"),
        ({"features": torch.empty(6, 4, device="meta")}, r"`features` must be on the CPU"),
        ({"features": np.empty((2**40, 0), np.float32), "handles": []}, r"`features` must have at least one dimension"),
        ({"features": np.ma.masked_array(FEATURES, FEATURES > 0)}, r"`features` must not be a masked array"),
        ({"reach": 0}, r"`reach` must be above 0, got 0"),
        ({"reach": np.nan}, r"`reach` must be finite, got nan"),
        ({"reach": [1.0, 2.0]}, r"`reach` must have shape \(1,\), got \(2,\)"),
        ({"falloff": "cubic"}, r"`falloff` must be one of linear, smooth, sharp, root, sphere, constant, got 'cubic'"),
        ({"falloff": ["smooth", "sharp"]}, r"`falloff` must be one name or 1, got 2"),
        ({"strength": 0.5}, r"`fixed` must be given when `strength` is"),
        ({"fixed": [1], "strength": 1.5}, r"`strength` must be at most 1, got 1.5"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match="^bind: " + message):
        dfd.bind(**{"features": FEATURES, "handles": [0], **arguments})


def test_out_must_not_overlap_an_input():
    features = unit_rows(4, 4)
    with pytest.raises(ValueError, match=r"^bind: `out` must not overlap `features`"):
        dfd.bind(features, [0, 1, 2, 3], out=features)


def test_negative_indices_and_masks_count_as_in_numpy():
    features = unit_rows(50, 12)
    wanted = dfd.bind(features, [48, 3], fixed=[49])
    np.testing.assert_array_equal(dfd.bind(features, [-2, 3], fixed=[-1]), wanted)
    mask, fixed = np.zeros(50, bool), np.zeros(50, bool)
    mask[[3, 48]] = fixed[49] = True
    np.testing.assert_array_equal(dfd.bind(features, mask, fixed=fixed), wanted[:, ::-1])
    for handles in ([-51], mask[:-1], [50]):
        with pytest.raises(ValueError, match="^bind: `handles` must"):
            dfd.bind(features, handles)
    rows = torch.from_numpy(features).requires_grad_()
    (by_mask,) = torch.autograd.grad(dfd.bind(rows, mask).sum(), rows)
    (by_index,) = torch.autograd.grad(dfd.bind(rows, [3, -2]).sum(), rows)
    torch.testing.assert_close(by_mask, by_index)
