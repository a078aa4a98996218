"""Test `dfd distill`."""

from unittest import mock

import pytest
from command_runs import failed, worked
from made_field import same
from tiny_encoder import save_tiny_encoder

from dfd.field.field import Field


def test_distill_hands_on_what_is_given(run, folder):
    field = Field.load(folder / "chair.field.safetensors")
    options = "--encoder dinov2-small --device cpu --no-cache --preset paper --views 6 --framing paper --no-mirrored"
    settings = "--smoothing 0.1 --batch 500 --learning-rate 0.004"
    with mock.patch("dfd.distill", return_value=field) as distill:
        result = run("distill", "MESH", "-o", "out.safetensors", *options.split(), *settings.split())
        assert worked(run("distill", "MESH", "-o", "other.safetensors"))
    assert worked(result)
    ((mesh, encoder), given), (_, plain) = distill.call_args_list
    assert (len(mesh.vertices), encoder) == (2004, "dinov2-small")
    del given["progress"], plain["progress"]
    wanted = {"device": "cpu", "cache": False, "preset": "paper", "views": 6, "framing": "paper", "mirrored": False}
    assert given == wanted | {"smoothing": 0.1, "batch": 500, "learning_rate": 0.004}
    assert plain == {"device": None, "cache": True}
    assert Field.load("out.safetensors").settings == field.settings
    assert "out.safetensors: a field of 16 dimensions" in result.stderr


def test_distill_copies_what_the_cache_has(run, tmp_path):
    save_tiny_encoder(tmp_path / "tiny")
    command = ("distill", "MESH", "--encoder", "./tiny", "--views", 2, "--resolution", 32, "--steps", 3, "-o")
    told = {name: run(*command, f"{name}.safetensors").stderr for name in ("first", "again")}
    assert {name: "from the cache" in text for name, text in told.items()} == {"first": False, "again": True}
    assert same(*(Field.load(f"{name}.safetensors") for name in told))
    assert "from the cache" not in run(*command, "anew.safetensors", "--no-cache").stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "out.safetensors", "--supervision", "all"), "`--supervision` must be one of barycentric, vertex"),
        (("-o", "out.safetensors", "--steps", 0), "`--steps` must be a whole number of at least 1, got 0"),
        (("-o", "out.safetensors", "--views", "many"), "--views"),
        (("-o", "out.field"), "`--output` must end in .safetensors, got out.field"),
        (("-o", "no/out.safetensors"), "`--output`: the folder no does not exist"),
        ((), "Missing option '--output'"),
    ],
)
def test_distill_names_what_is_wrong(run, tmp_path, arguments, message):
    assert failed(run("distill", "MESH", *arguments), message)
    assert list(tmp_path.iterdir()) == []
