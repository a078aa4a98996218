"""Test `preset="paper"`: the distillation follows the paper, and the field records its settings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reference
import torch
from tiny_encoder import save_tiny_encoder

import dfd
import dfd.distillation.algorithm as algorithm
from dfd.distillation.fit import Adam
from dfd.distillation.settings import DistillSettings
from dfd.distillation.targets import PixelTargets
from dfd.encoders.encode import Encoder, load_encoder
from dfd.field.architecture import Architecture

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def encoder(tmp_path: Path) -> Path:
    return save_tiny_encoder(tmp_path / "tiny")


def test_the_distillation_follows_the_settings_of_the_paper(encoder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, Any] = {"drawn": [], "rates": []}
    render, encode, at, step = algorithm.render, Encoder.encode, PixelTargets.at, Adam.step

    def rendering(mesh: dfd.Mesh, **given: Any) -> Any:
        seen["views"] = render(mesh, **given)
        return seen["views"]

    def encoding(self: Encoder, images: Any, **given: Any) -> Any:
        seen["foreground_only"] = self.foreground_only
        return encode(self, images, **given)

    def choosing(self: PixelTargets, chosen: torch.Tensor) -> Any:
        seen["drawn"].append(chosen)
        return at(self, chosen)

    def stepping(self: Adam, gradients: Any, rate: float, momentum: float) -> None:
        seen["rates"].append(rate)
        step(self, gradients, rate, momentum)

    monkeypatch.setattr(algorithm, "render", rendering)
    monkeypatch.setattr(Encoder, "encode", encoding)
    monkeypatch.setattr(PixelTargets, "at", choosing)
    monkeypatch.setattr(Adam, "step", stepping)
    mesh = dfd.samples.robot(60_000).mesh  # with several components, and with more faces than the paper renders
    # All settings except the resolution and the batch are the paper's.
    field = dfd.distill(
        mesh, encoder, preset="paper", resolution=32, batch=1000, device="cpu", progress=False, cache=False
    )
    wanted = DistillSettings(preset="paper", resolution=32, batch=1000).as_dict()
    block = wanted.pop("block")
    assert block is None
    assert field.settings["block"] == field.settings["encoder_block"] == 3
    assert {name: field.settings[name] for name in wanted} == wanted

    views = seen["views"]
    assert len(views.images) == 24
    assert len(views.faces) <= 50_000 < len(mesh.faces)
    np.testing.assert_allclose([np.linalg.norm(camera.position) for camera in views.cameras], 2.8, rtol=1e-6)
    assert len({tuple(np.round(np.abs(camera.position), 4)) for camera in views.cameras}) == 24  # no mirror images
    assert len(views.points) == np.count_nonzero(views.covered)
    assert not seen["foreground_only"]
    assert field.settings["up_source"] == "said"
    np.testing.assert_array_equal(field.settings["up_direction"], [0, 1, 0])
    assert field.architecture == Architecture(16, 256, 4, 0)
    assert field.residuals is None

    steps = 15 * math.ceil(len(views.points) / 1000)
    assert len(field.settings["losses"]) == len(seen["drawn"]) == steps
    for epoch in range(15):
        drawn = torch.cat(seen["drawn"][epoch * steps // 15 : (epoch + 1) * steps // 15])
        assert torch.equal(drawn.sort().values, torch.arange(len(views.points)))
    assert seen["rates"] == [1e-3] * steps
    points = views.points[:50] / views.scale + views.center
    np.testing.assert_allclose(field(points), reference.field(field, points), atol=1e-5)


def test_a_loaded_encoder_that_contradicts_the_settings_is_refused(encoder: Path) -> None:
    mesh, how = dfd.samples.chair(4000).mesh, {"progress": False, "cache": False, "device": "cpu"}
    loaded = load_encoder(encoder, device="cpu")
    with pytest.raises(ValueError, match="`background` must be False for this loaded encoder"):
        dfd.distill(mesh, loaded, preset="paper", **how)
    with pytest.raises(ValueError, match="`block` must be that of the loaded encoder, 3, got 2"):
        dfd.distill(mesh, loaded, block=2, **how)


def test_the_given_block_is_used(encoder: Path) -> None:
    mesh, how = dfd.samples.chair(4000).mesh, {"progress": False, "cache": False, "device": "cpu"}
    field = dfd.distill(mesh, encoder, block=2, steps=2, batch=8, views=2, resolution=32, smoothing=0, **how)
    assert (field.settings["block"], field.settings["encoder_block"], field.settings["background"]) == (2, 2, False)
