"""What is learned for the package: the directions and kinds of the metric, the probe for up, and their reports."""

from __future__ import annotations

import numpy as np
import pytest

import dfd
from bench.training import learn_metric, learn_up
from bench.training.vertex_features import vertex_features
from dfd.distillation.metric import Metric
from dfd.distillation.thickness import BANDS, thickness_bands
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
@pytest.mark.filterwarnings("ignore:encode. a resolution")
@pytest.mark.parametrize("module", [learn_metric, learn_up])
def test_the_command_learns_judges_and_writes(tmp_path, tiny_encoder, monkeypatch, module):
    monkeypatch.setenv("DFD_MESHES", str(tmp_path))
    for name in ("REPORT", "CACHE", "KEPT_VIEWS"):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, tmp_path / name)
    module.main(["--encoder", str(tiny_encoder), "--output", str(tmp_path / "learned.safetensors")])
    assert (tmp_path / "learned.safetensors").stat().st_size > 0
    assert "all" in (tmp_path / "REPORT").read_text() or "Gain" in (tmp_path / "REPORT").read_text()
