"""Test the commands that learn the metric, the up probe and the constants of agreement, and their reports."""

import numpy as np
import pytest
from made_rig import two_legs

import dfd
from bench.training import learn_agreement, learn_metric, learn_up
from bench.training.vertex_features import vertex_features
from dfd.distillation.metric import Metric
from dfd.distillation.thickness import BANDS, thickness_bands
from dfd.editing.agreement import AREA_SLOPE, DISTANCE_SLOPE, INTERCEPT
from dfd.encoders.encode import load_encoder
from dfd.encoders.learned_file import encoder_identity


def test_what_is_learned_from_is_what_distillation_maps(tmp_path, tiny_encoder, chair_mesh, monkeypatch):
    encoder = load_encoder(tiny_encoder, device="cpu", precision="float32")
    maps = np.eye(encoder.dimension, 3, dtype=np.float32), np.ones((BANDS, 3), np.float32)
    Metric(*maps, *encoder_identity(encoder)).save(tmp_path / "tiny.safetensors")
    monkeypatch.setattr("dfd.distillation.metric.FOLDER", tmp_path)
    measured = []

    def recorded(views, targets):
        bands = thickness_bands(views, targets)
        measured.append((targets.features, bands))
        return bands

    monkeypatch.setattr("dfd.distillation.algorithm.thickness_bands", recorded)
    monkeypatch.setattr("bench.training.vertex_features.thickness_bands", recorded)
    vertex_features(chair_mesh, encoder, views=4, resolution=64)
    dfd.distill(chair_mesh, encoder, views=4, resolution=64, steps=2, up="file", cache=False, progress=False)
    for one, other in zip(*measured, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
@pytest.mark.parametrize("module", [learn_metric, learn_up])
def test_the_command_learns_judges_and_writes(tmp_path, tiny_encoder, monkeypatch, module):
    monkeypatch.setenv("DFD_MESHES", str(tmp_path))
    for name in ("REPORT", "CACHE", "VIEWS_CACHE"):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, tmp_path / name)
    module.main(["--encoder", str(tiny_encoder), "--output", str(tmp_path / "learned.safetensors")])
    assert (tmp_path / "learned.safetensors").stat().st_size > 0
    assert "all" in (tmp_path / "REPORT").read_text() or "Gain" in (tmp_path / "REPORT").read_text()


def test_the_constants_of_agreement_are_those_that_odds_were_drawn_by():
    generator = np.random.default_rng(0)
    rows = np.abs(generator.normal(size=(20_000, 2))) * (1.0, 0.2)
    odds = INTERCEPT - rows @ (AREA_SLOPE, DISTANCE_SLOPE)
    right = generator.random(len(rows)) < 1 / (1 + np.exp(-odds))
    found = learn_agreement.fitted(rows, right, np.ones(len(rows)))
    np.testing.assert_allclose(found, (INTERCEPT, AREA_SLOPE, DISTANCE_SLOPE), rtol=0.1)


def test_an_edit_that_is_carried_to_a_twin_is_right():
    shape = two_legs()
    field = dfd.VertexField(shape.mesh, np.eye(3, dtype=np.float32)[np.array([0, 1, 2, 1, 2])[shape.of_vertex]])
    shapes = [(shape, dfd.Deformer(shape.mesh, field)), (two_legs(), dfd.Deformer(two_legs().mesh, field))]
    found = list(learn_agreement.transferred(shapes))
    assert len(found) >= 4  # handles whose part is what a joint moves, transferred from either shape to the other
    for _, difference, right in found:
        np.testing.assert_allclose(difference, 0, atol=1e-6)
        assert right
