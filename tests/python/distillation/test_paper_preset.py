"""Test `preset="paper"`: the distillation follows the paper, and the field records its settings."""

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
def encoder(tmp_path):
    return save_tiny_encoder(tmp_path / "tiny")


def test_the_distillation_follows_the_settings_of_the_paper(encoder, monkeypatch):
    seen: dict[str, Any] = {"drawn": [], "rates": []}
    render, encode, at, step = algorithm.render, Encoder.encode, PixelTargets.at, Adam.step

    def rendering(mesh, **given):
        seen["views"] = render(mesh, **given)
        return seen["views"]

    def encoding(self, images, **given):
        seen["foreground_only"] = self.foreground_only
        return encode(self, images, **given)

    def choosing(self, chosen):
        seen["drawn"].append(chosen)
        return at(self, chosen)

    def stepping(self, gradients, rate, momentum):
        seen["rates"].append(rate)
        step(self, gradients, rate, momentum)

    monkeypatch.setattr(algorithm, "render", rendering)
    monkeypatch.setattr(Encoder, "encode", encoding)
    monkeypatch.setattr(PixelTargets, "at", choosing)
    monkeypatch.setattr(Adam, "step", stepping)
    mesh = dfd.samples.robot(60_000).mesh  # with several components, and with more faces than the paper renders
    # All settings except the resolution are the paper's.
    field = dfd.distill(mesh, encoder, preset="paper", resolution=34, device="cpu", progress=False, cache=False)
    wanted = DistillSettings(preset="paper", resolution=34).as_dict()
    assert field.settings["encoder_block"] == 3
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

    # 15 iterations over all pictures, two in each step
    assert len(field.settings["losses"]) == len(seen["drawn"]) == 15 * 12
    for epoch in range(15):
        batches = seen["drawn"][12 * epoch : 12 * (epoch + 1)]
        assert all(len(np.unique(views.view[batch.numpy()])) == 2 for batch in batches)
        assert torch.equal(torch.cat(batches).sort().values, torch.arange(len(views.points)))
    assert seen["rates"] == [1e-3] * 180
    assert field.settings["encoded_resolution"] == 32
    points = views.points[:50] / views.scale + views.center
    np.testing.assert_allclose(field(points), reference.field(field, points), atol=1e-5)


@pytest.fixture
def small_pictures(monkeypatch):
    """Render small pictures, whose side is no multiple of the encoder's patches, although the settings say 512."""
    render = algorithm.render
    monkeypatch.setattr(algorithm, "render", lambda mesh, **given: render(mesh, **{**given, "resolution": 34}))


@pytest.mark.usefixtures("small_pictures")
@pytest.mark.filterwarnings("error")  # also of the warnings that the settings of pytest ignore
def test_the_preset_for_both_halves_gives_no_warning(encoder, tmp_path):
    mesh = dfd.samples.chair(4000).mesh
    field = dfd.distill(mesh, encoder, preset="paper", device="cpu", progress=False, cache=False)
    field.save(tmp_path / "chair.field.safetensors")
    for each in (field, dfd.Field.load(tmp_path / "chair.field.safetensors", mesh=mesh)):
        session = dfd.Deformer(mesh, each, preset="paper")
        session.add((0.2, 0, 0.2), translation=(0, -0.1, 0))
        assert np.isfinite(session.vertices).all()


@pytest.mark.usefixtures("small_pictures")
@pytest.mark.parametrize("changed", [{"epochs": 1}, {"block": 2}])
def test_a_session_warns_of_the_settings_that_differ(encoder, changed):
    mesh, how = dfd.samples.chair(4000).mesh, {"device": "cpu", "progress": False, "cache": False}
    made = dfd.distill(mesh, encoder, preset="paper", **how, **changed)
    with pytest.warns(UserWarning, match=f"the field was distilled with other settings: {next(iter(changed))}; "):
        dfd.Deformer(mesh, made, preset="paper")


def test_a_loaded_encoder_that_contradicts_the_settings_is_refused(encoder):
    mesh, how = dfd.samples.chair(4000).mesh, {"progress": False, "cache": False, "device": "cpu"}
    loaded = load_encoder(encoder, device="cpu")
    with pytest.raises(ValueError, match="`background` must be False for this loaded encoder"):
        dfd.distill(mesh, loaded, preset="paper", **how)
    with pytest.raises(ValueError, match="`block` must be that of the loaded encoder, 3, got 2"):
        dfd.distill(mesh, loaded, block=2, **how)


def test_the_given_block_is_used(encoder):
    mesh, how = dfd.samples.chair(4000).mesh, {"progress": False, "cache": False, "device": "cpu"}
    field = dfd.distill(mesh, encoder, block=2, steps=2, batch=8, views=2, resolution=32, smoothing=0, **how)
    assert (field.settings["block"], field.settings["encoder_block"], field.settings["background"]) == (2, 2, False)
