"""Test the settings of a distillation and their checks."""

import inspect
from typing import Any

import pytest
from tiny_encoder import save_tiny_encoder

import dfd
from dfd.distillation.settings import DistillSettings, source_of


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"views": 0}, "`views` must be a whole number from 1 to 32767, got 0"),
        ({"resolution": 4097}, "`resolution` must be a whole number from 1 to 4096, got 4097"),
        ({"framing": "close"}, "`framing` must be one of shape, paper, got 'close'"),
        ({"simplify_to": 3}, "`simplify_to` must be a whole number of at least 4, got 3"),
        ({"supervision": "pixel"}, "`supervision` must be one of barycentric, vertex, got 'pixel'"),
        ({"mirrored": "no"}, "`mirrored` must be True or False, got 'no'"),
        ({"background": 1}, "`background` must be True or False, got 1"),
        ({"pieces": None}, "`pieces` must be True or False, got None"),
        ({"block": 0}, "`block` must be a whole number of at least 1, got 0"),
        ({"smoothing": -0.1}, "`smoothing` must be at least 0, got -0.1"),
        ({"smoothing": 2.1}, "`smoothing` must be at most 2, got 2.1"),
        ({"metric": "mine"}, "`metric` must be one of learned, none, got 'mine'"),
        ({"octaves": 17}, "`octaves` must be a whole number from 0 to 16, got 17"),
        ({"steps": 0}, "`steps` must be a whole number of at least 1, got 0"),
        ({"steps": 5, "epochs": 2}, "exactly one of `steps` and `epochs` must be given, got 5 and 2"),
        ({"steps": None}, "exactly one of `steps` and `epochs` must be given, got None and None"),
        ({"batch": 5, "batch_views": 2}, "exactly one of `batch` and `batch_views` must be given, got 5 and 2"),
        ({"batch_views": 2}, "`batch_views` must be None with `smoothing` 0.3, .*: give `batch`, got 2"),
        ({"schedule": "cosine"}, "`schedule` must be one of one_cycle, constant, got 'cosine'"),
        ({"preset": "papers"}, "`preset` must be one of default, paper, got 'papers'"),
        ({"learning_rate": 0.0}, "`learning_rate` must be above 0, got 0"),
        ({"seed": -1}, "`seed` must be a whole number from 0 to 9223372036854775807, got -1"),
    ],
)
def test_each_one_is_named_when_it_is_out_of_range(setting, message):
    with pytest.raises(ValueError, match=f"^distill: {message}"):
        DistillSettings(**setting)


def test_the_ablation_is_never_smoothed():
    ablation = DistillSettings(supervision="vertex", smoothing=0.5)
    assert (ablation.smoothing, ablation.metric, ablation.pieces) == (0, "none", False)


def test_settings_that_the_paper_does_not_state_have_another_source():
    stated = {"views", "resolution", "simplify_to", "supervision", "mirrored", "smoothing", "metric", "pieces"}
    found = {name for name in DistillSettings.model_fields if source_of(name) == "paper"}
    assert found == stated | {"preset", "layers", "steps", "epochs"}


def test_each_one_is_described():
    assert all(
        f"    {name}\n        {field.description}" in (DistillSettings.__doc__ or "")
        for name, field in DistillSettings.model_fields.items()
    )


def test_main_settings_are_parameters_and_none_is_the_preset_s(chair_mesh, tmp_path):
    encoder = save_tiny_encoder(tmp_path / "tiny")
    given: dict[str, Any] = {"cache": False, "progress": False, "steps": 1, "resolution": 32}
    parameters = inspect.signature(dfd.distill).parameters
    main = ("preset", "views", "resolution", "up", "smoothing", "steps", "epochs", "seed")
    assert all(parameters[name].default in (None, "default") for name in main)
    assert dfd.distill(chair_mesh, encoder, views=None, seed=3, batch=64, **given).settings["seed"] == 3
    with pytest.raises(ValueError, match="distill: `views` must be a whole number from 1"):
        dfd.distill(chair_mesh, encoder, views=0, **given)
