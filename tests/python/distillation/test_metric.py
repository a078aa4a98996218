"""Test the learned metric: mapped targets, files, and the fields that are distilled with it."""

from dataclasses import replace

import numpy as np
import pytest
import reference
from safetensors.numpy import save_file

import dfd
from dfd.distillation import metric as metrics
from dfd.distillation.metric import FOLDER, Kinds, Metric, find_metric
from dfd.distillation.targets import PointTargets, mean_distance, unit
from dfd.distillation.thickness import BANDS

NO_THICKNESS = np.zeros((BANDS, 3), np.float32)
BANDS_OF_500 = np.zeros((500, BANDS), np.float32)
SMALL = {"views": 4, "resolution": 64, "steps": 20, "cache": False, "progress": False, "device": "cpu"}


@pytest.fixture
def metric(encoder):
    """Return a metric that keeps the first three of sixteen numbers, and multiplies the third by four."""
    settings = encoder.settings()
    directions = np.eye(16, 3, dtype=np.float32) * np.array([1, 1, 4], np.float32)
    return Metric(directions, NO_THICKNESS, str(settings["encoder_weights"]), int(settings["encoder_block"]))


@pytest.fixture
def features():
    rows = np.random.default_rng(0).normal(size=(500, 16)) + 2
    return unit(rows.astype(np.float32))


@pytest.fixture
def kinds():
    generator = np.random.default_rng(3)
    hidden, output = generator.normal(size=(16, 8)), generator.normal(size=(8, 5))
    numbers = (hidden, generator.normal(size=8), output, generator.normal(size=5))
    return Kinds(*(each.astype(np.float32) for each in numbers))


def distance(rows):
    one, other = np.random.default_rng(1).integers(0, len(rows), (2, 20_000))
    return mean_distance(rows[one], rows[other])


def test_mapped_rows_are_unit_and_about_as_far_apart_as_before(metric, features):
    before = features.copy()
    rows = metric.mapped(features, BANDS_OF_500, np.random.default_rng(0))
    assert rows.shape == (500, 3)
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-6)
    assert distance(rows) == pytest.approx(metrics.FARTHER * distance(features), rel=0.03)
    np.testing.assert_array_equal(features, before)


def test_targets_in_principal_directions_are_mapped_as_features(metric, features):
    turned = np.linalg.qr(np.random.default_rng(2).normal(size=(16, 16)))[0].astype(np.float32)
    points = np.zeros((500, 3), np.float32)
    face = np.arange(500)
    direct = metric.of_targets(PointTargets(points, features, None, face=face), BANDS_OF_500, 5)
    through = metric.of_targets(PointTargets(points, features @ turned.T, turned), BANDS_OF_500, 5)
    assert direct.directions is None
    assert through.directions is None
    np.testing.assert_allclose(direct.targets, through.targets, atol=1e-4)
    assert through.dimension == 3
    assert direct.face is face


def test_thickness_separates_equal_features(metric, features):
    thick, twice = np.zeros((1000, BANDS), np.float32), np.concatenate([features, features])
    thick[:500, 4], thick[500:, 15] = 1, 1
    told = NO_THICKNESS.copy()
    told[4, 0], told[15, 0] = 0.5, -0.5
    before, after = (
        each.mapped(twice, thick, np.random.default_rng(0))
        for each in (metric, replace(metric, thickness_directions=told))
    )
    np.testing.assert_array_equal(before[:500], before[500:])
    assert mean_distance(after[:500], after[500:]) > distance(after)


def test_kinds_equal_those_of_the_slow_reference(kinds, features):
    before = features.copy()
    rows = kinds.root_probabilities(features, features.mean(axis=0))
    arrays = (kinds.hidden, kinds.hidden_bias, kinds.output, kinds.output_bias)
    twin = reference.kinds_of_parts(features, features.mean(axis=0, dtype=np.float64), *arrays)
    np.testing.assert_allclose(rows, twin, atol=1e-5)
    np.testing.assert_allclose(np.square(twin).sum(axis=1), 1)
    np.testing.assert_array_equal(features, before)


def test_equal_rows_stay_finite(metric, kinds):
    for some in (metric, replace(metric, kinds=kinds)):
        rows = some.mapped(np.full((4, 16), 0.25, np.float32), BANDS_OF_500[:4], np.random.default_rng(0))
        assert np.isfinite(rows).all()


def test_a_file_keeps_the_kinds(metric, kinds, features, tmp_path):
    both = replace(metric, kinds=kinds)
    both.save(tmp_path / "metric.safetensors")
    again = Metric.load(tmp_path / "metric.safetensors")
    again.save(tmp_path / "again.safetensors")
    assert (tmp_path / "again.safetensors").read_bytes() == (tmp_path / "metric.safetensors").read_bytes()
    rows = (some.mapped(features, BANDS_OF_500, np.random.default_rng(0)) for some in (both, again))
    np.testing.assert_array_equal(*rows)


def test_damaged_metrics_are_refused(metric, tmp_path):
    path = tmp_path / "metric.safetensors"
    metric.save(path)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(ValueError, match=r"^Metric\.load: .* is not a complete \.safetensors file"):
        Metric.load(path)
    save_file({"height": np.zeros(3, np.float32)}, path)
    with pytest.raises(ValueError, match="does not hold dfd metric 3"):
        Metric.load(path)
    replace(metric, directions=np.full((16, 3), np.nan, np.float32)).save(path)
    with pytest.raises(ValueError, match=r"`directions` must be finite, got nan at .* in "):
        Metric.load(path)
    damaged = np.zeros((BANDS - 1, 3), np.float32)
    for thickness, found in (
        (damaged, rf"have shape \({BANDS}, 3\), got"),
        (np.full((BANDS, 3), np.inf), "be finite, got inf"),
    ):
        replace(metric, thickness_directions=thickness).save(path)
        with pytest.raises(ValueError, match=f"`thickness_directions` must {found}"):
            Metric.load(path)
    with pytest.raises(FileNotFoundError):
        Metric.load(tmp_path / "none.safetensors")


def test_the_packages_metrics_have_at_most_64_numbers():
    found = [Metric.load(path) for path in sorted(FOLDER.glob("*.safetensors"))]
    assert found
    for each in found:
        kinds = 0 if each.kinds is None else each.kinds.output.shape[1]
        assert each.directions.shape[1] + kinds <= 64


def test_distill_uses_the_metric_of_the_encoder(metric, encoder, tmp_path, monkeypatch, caplog):
    mesh = dfd.samples.chair(4000).mesh
    monkeypatch.setattr(metrics, "FOLDER", tmp_path)
    assert find_metric(encoder) is None
    without = dfd.distill(mesh, encoder, **SMALL)
    (said,) = (record for record in caplog.records if "no metric was learned for it" in record.message)
    assert said.levelname == "WARNING"
    assert any("no metric was learned" in each for each in without.settings["encoder_lacks"])
    caplog.clear()
    metric.save(tmp_path / "tiny.safetensors")
    learned = dfd.distill(mesh, encoder, **SMALL)
    plain = dfd.distill(mesh, encoder, metric="none", **SMALL)
    assert (learned.dimension, learned.settings["metric"]) == (3, "learned")
    assert learned.settings["metric_hash"] == metric.content_hash
    assert "metric_hash" not in plain.settings
    for field in (learned, plain):
        assert not any("metric" in each for each in field.settings.get("encoder_lacks", ()))
    assert not any("no metric" in record.message for record in caplog.records)
    assert (plain.dimension, plain.settings["metric"]) == (16, "none")
    assert without.settings["metric"] == "none"
    np.testing.assert_array_equal(without.features(mesh), plain.features(mesh))
    unsmoothed = dfd.distill(mesh, encoder, smoothing=0.0, **SMALL)
    assert (unsmoothed.dimension, unsmoothed.settings["metric"]) == (16, "none")
