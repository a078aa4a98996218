"""Test compact features: weights within the tolerance, exactly 1 at a handle, nearly equal on all instruction sets."""

import os
import subprocess
import sys

import numpy as np
import pytest
import reference

import dfd
from dfd import _core
from dfd.pictures.colors import feature_colors


def features_of_low_rank(count=3000, dimension=96, rank=20, *, seed=0):
    """Return (count, dimension) float32 unit rows that vary mostly along a few directions, as those of a field do."""
    random = np.random.default_rng(seed)
    basis = random.standard_normal((rank, dimension)) * np.exp(-np.arange(rank) / 5)[:, None]
    rows = random.standard_normal((count, rank)) @ basis + 1.5 * random.standard_normal(dimension)
    rows += 0.01 * random.standard_normal((count, dimension))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


FEATURES = features_of_low_rank()
HANDLES = np.arange(0, 3000, 131)


@pytest.mark.parametrize(("tolerance", "precision"), [(0.05, "int8"), (0.01, None), (0.002, "float16")])
def test_weights_stay_within_the_tolerance(tolerance, precision):
    compact = dfd.compact(FEATURES, tolerance=tolerance)
    assert precision is None or compact.precision == precision
    assert compact.shape == FEATURES.shape
    assert compact.nbytes < FEATURES.nbytes / 3
    weights = dfd.bind(compact, HANDLES)
    full = reference.feature_weights(FEATURES, FEATURES[HANDLES])
    assert np.abs(weights - full).max() <= tolerance
    assert 0 < compact.error <= tolerance
    np.testing.assert_array_equal(weights[HANDLES, np.arange(len(HANDLES))], 1)


@pytest.mark.parametrize("tolerance", [0.05, 0.002])
def test_features_that_lie_far_from_0_take_no_more_memory(tolerance):
    far = dfd.compact(FEATURES + np.linspace(-50, 50, 96, dtype=np.float32), tolerance=tolerance)
    assert far.nbytes == dfd.compact(FEATURES, tolerance=tolerance).nbytes


def test_equal_features_have_the_weight_1_everywhere():
    compact = dfd.compact(np.tile(FEATURES[:1], (50, 1)))
    np.testing.assert_allclose(dfd.bind(compact, [3]), 1, atol=0.01)


def test_features_with_large_numbers_are_compact_where_8_bits_are_enough():
    clusters = np.repeat(1e6 * np.eye(4, 8, dtype=np.float32), 50, axis=0)
    compact = dfd.compact(clusters, tolerance=0.05)
    assert compact.precision == "int8"
    np.testing.assert_array_equal(dfd.bind(compact, [0])[:, 0] > 0, np.arange(200) < 50)


def test_few_formats_are_tried_for_many_dimensions(monkeypatch):
    rows = np.random.default_rng(0).standard_normal((700, 640)).astype(np.float32)  # vary along no direction more
    tried = []
    rotate = np.linalg.qr

    def counted(matrix):
        tried.append(len(matrix))
        return rotate(matrix)

    monkeypatch.setattr(np.linalg, "qr", counted)
    compact = dfd.compact(rows / np.linalg.norm(rows, axis=1, keepdims=True))
    assert len(tried) <= 2
    assert min(tried) > 200
    assert compact.error <= 0.01


@pytest.fixture(scope="module", params=["int8", "float16"])
def compact(request):
    result = dfd.compact(FEATURES, tolerance={"int8": 0.05, "float16": 0.002}[request.param])
    assert result.precision == request.param
    return result


def test_stored_rows_bind_as_the_twin_says(compact):
    everything = compact.step * compact.stored(np.arange(len(compact))).astype(np.float64)
    geodesic = np.random.default_rng(0).random((len(HANDLES), len(compact)), dtype=np.float32)
    for locality in (0.0, 1.0, 2.0, 3.0, 4.0, 0.3, 7.7):
        weights = dfd.bind(compact, HANDLES, fixed=[5, 6, 7], geodesic=geodesic, locality=locality)
        wanted = reference.feature_weights(everything, everything[HANDLES])
        wanted = reference.subtract_fixed(wanted, reference.feature_weights(everything, everything[[5, 6, 7]]))
        wanted = reference.geodesic_falloff(wanted, geodesic, locality)
        np.testing.assert_allclose(weights, wanted, rtol=0, atol=1e-5)


def test_rows_give_back_what_is_stored(compact):
    rows = compact.rows(HANDLES)
    assert rows.dtype == np.float32
    np.testing.assert_allclose(rows, FEATURES[HANDLES], rtol=0, atol=1.001 * compact.radius)
    stored, offsets = compact.project(rows)
    np.testing.assert_allclose(stored, compact.stored(HANDLES), rtol=1e-3, atol=1e-6)
    np.testing.assert_array_equal(offsets, 0)


def test_the_offset_of_an_unlike_handle_is_what_entries_cannot_express(compact):
    rows = np.random.default_rng(7).normal(size=(5, 96)).astype(np.float32)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    stored, offsets = compact.project(rows)
    missed = np.square(rows - compact.mean - compact.step * stored @ compact.basis.T).sum(axis=1)
    assert (missed > 4 * compact.radius).all()
    np.testing.assert_allclose(offsets, missed - compact.radius**2, rtol=1e-4)


def test_principal_coordinates_are_those_of_the_full_features(compact):
    centered = FEATURES.astype(np.float64) - FEATURES.mean(axis=0)
    directions = np.linalg.eigh(centered.T @ centered)[1][:, ::-1][:, :3]
    directions *= np.sign(directions[np.abs(directions).argmax(axis=0), np.arange(3)])
    coordinates = compact.principal(3)
    assert coordinates.dtype == np.float32
    np.testing.assert_allclose(coordinates, centered @ directions, rtol=0, atol=0.05 * centered.std() * 96**0.5)
    assert np.corrcoef(coordinates[:, 2], centered @ directions[:, 2])[0, 1] > 0.999
    assert np.abs(feature_colors(coordinates) - feature_colors(FEATURES)).max() < 0.1
    assert compact.principal(200).shape == (len(FEATURES), compact.dimensions)


def test_a_handle_weighs_the_same_alone_and_among_others(compact):
    together = dfd.bind(compact, HANDLES, fixed=[3])
    for j in (0, 7, len(HANDLES) - 1):
        np.testing.assert_array_equal(dfd.bind(compact, HANDLES[[j]], fixed=[3])[:, 0], together[:, j])
    columns = np.empty((len(HANDLES), len(compact)), np.float32)
    dfd.bind(compact, HANDLES, fixed=[3], out=columns.T)
    np.testing.assert_array_equal(columns.T, together)


def test_a_field_is_asked_in_parts():
    points = np.random.default_rng(0).standard_normal((70_000, 3))
    lift = np.random.default_rng(1).standard_normal((3, 24)).astype(np.float32)
    largest = 0

    def field(places):
        nonlocal largest
        largest = max(largest, len(places))
        rows = np.tanh(places @ lift) + 1
        return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)

    done = []
    compact = dfd.compact(field, points, progress=done.append)
    assert largest <= 40_000
    assert sum(done) == len(points)
    full = reference.feature_weights(field(points), field(points[[1, 2]]))
    assert np.abs(dfd.bind(compact, [1, 2]) - full).max() <= 0.01


@pytest.mark.parametrize("count", [3000, 20_000])
@pytest.mark.parametrize("tolerance", [0.05, 0.002])
def test_a_row_out_of_all_proportion_is_refused_and_not_called_exact(count, tolerance):
    features = features_of_low_rank(count)
    sample = np.random.default_rng(0).choice(count, min(count, 16_384), replace=False)
    others = np.setdiff1d(np.arange(count), sample)  # vertices outside the first sample
    features[others[0] if len(others) else 7] *= 1e18
    with pytest.raises(ValueError, match=r"^compact: (`tolerance` must be larger|`features` have a row (so|too) far)"):
        dfd.compact(features, tolerance=tolerance)


def test_every_instruction_set_binds_and_poses_alike(tmp_path):
    code = """
import sys, numpy as np, dfd
import dfd._core as _core
random = np.random.default_rng(0)
features = np.load(sys.argv[1])
results = {"name": np.array(_core.instruction_set())}
handles = np.arange(0, 3000, 131)
geodesic = random.random((len(handles), 3000), dtype=np.float32)
for kind, source in (("rows", features), ("int8", dfd.compact(features, tolerance=0.05)),
                     ("float16", dfd.compact(features, tolerance=0.002))):
    results[kind] = dfd.bind(source, handles, fixed=[2], geodesic=geodesic, locality=[1.7] * len(handles))
    results[kind + "1"] = dfd.bind(source, handles)
plane = dfd.SymmetryPlane((0.6, 0.0, 0.8), 0.1, band=0.3)
transforms = np.eye(3, 4) + 0.1 * random.standard_normal((len(handles), 3, 4))
for dtype in ("float32", "float64"):
    vertices = random.standard_normal((3000, 3)).astype(dtype)
    for kind, normals in (("posed", None), ("turned", vertices / np.linalg.norm(vertices, axis=1, keepdims=True))):
        results[kind + dtype] = np.concatenate(np.atleast_3d(dfd.pose(
            vertices, results["rows"], transforms, symmetry=plane, handles=vertices[:len(handles)], normals=normals)))
np.savez(sys.argv[2], **results)
"""
    np.save(tmp_path / "features.npy", FEATURES)
    results = []
    for name in _core.instruction_sets():
        out = tmp_path / f"{name}.npz"
        done = subprocess.run(
            [sys.executable, "-c", code, tmp_path / "features.npy", out],
            env={**os.environ, "DFD_ISA": name},
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        results.append(dict(np.load(out)))
        assert results[-1].pop("name") == name
    for other in results[1:]:
        np.testing.assert_array_equal(other["int81"], results[0]["int81"])  # exact, because entries are whole numbers
        for kind, wanted in results[0].items():
            np.testing.assert_allclose(other[kind], wanted, rtol=1e-5, atol=2e-5, err_msg=kind)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"features": FEATURES, "tolerance": 0}, "`tolerance` must be above 0"),
        ({"features": FEATURES, "tolerance": 1e-9}, "`tolerance` must be larger, because 16 bits are too few"),
        ({"features": FEATURES[0]}, r"`features` must have shape \(V, D\)"),
        ({"features": np.where(np.arange(96) == 7, np.nan, FEATURES)}, "`features` must be finite"),
        ({"features": FEATURES, "points": np.zeros((3, 3))}, "`points` must not be given if `features` are rows"),
        ({"features": lambda points: points}, "`points` must be given for a field"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match="^compact: " + message):
        dfd.compact(**arguments)


@pytest.mark.parametrize(
    ("handles", "message"),
    [
        ([3000], r"`handles` must lie in 0 … 2999, got 3000"),
        ([1, 1], r"`handles` names vertex 1 more than once"),
        (FEATURES[:2, :5], r"`handles` must have shape \(N, 96\), got \(2, 5\)"),
    ],
)
def test_bad_handles(compact, handles, message):
    with pytest.raises(ValueError, match="^bind: " + message):
        dfd.bind(compact, handles)
