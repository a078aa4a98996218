"""Test `dfd batch`: its errors before it writes a file, and its messages."""

import sys
from pathlib import Path

import numpy as np
import pytest
from command_runs import failed, worked
from fake_ray import FakeRay
from made_field import field_of

import dfd
from dfd.batch.settings import BatchSettings
from dfd.common.distribution import pip_install
from dfd.distillation.settings import DistillSettings

BATCH = ("batch", "shapes/*.ply", "-o", "out")


@pytest.fixture
def shapes(run, chair, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", FakeRay())
    Path("shapes").mkdir()
    chair.save("shapes/chair.ply")
    Path("shapes/chair.field.safetensors").write_bytes((folder / "chair.field.safetensors").read_bytes())
    session = dfd.Deformer("shapes/chair.ply", dfd.Field.load("shapes/chair.field.safetensors"))
    session.add(40, translation=(0, -0.2, 0))
    session.save("edit.json")
    return run


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("batch", "none/*.ply", "-o", "out"), "nothing matches none/*.ply"),
        ((*BATCH, "--step", "dance"), "`--step` must be one of inspect"),
        ((*BATCH, "--step", "inspect,edits"), '`--edit` and the step "edits" must be given together'),
        (
            (*BATCH, "--edit", "edit.json", "--edit", "edit.json", "--made-on", "far.ply"),
            "`--edit` and `--made-on` must be given equally often",
        ),
        ((*BATCH, "--edit", "none.json"), "`--edit`: none.json does not exist"),
        (
            (*BATCH, "--step", "edits", "--edit", "edit.json", "--made-on", "far.ply"),
            "far.field.safetensors, the field of far.ply, does not exist",
        ),
        ((*BATCH, "--distill", "views"), "`--distill` must be NAME=VALUE with one of background"),
        ((*BATCH, "--distill", "views=none"), "`views` must be a whole number"),
        ((*BATCH, "--step", "inspect", "--distill", "views=3"), "`--distill` settings need the step distill"),
        ((*BATCH, "--workers", "2", "--address", "auto"), "`--workers` must not be given with `--address`"),
        ((*BATCH, "--timeout", "0"), "`--timeout` must be"),
        (("batch", "shapes/*.ply", "-o", "none/out"), "none/out: No such file or directory"),
        (("batch", "shapes/*.ply", "-o", "shapes"), "must be a new folder or one of an earlier batch, got shapes"),
        (("batch", "shapes/*.ply", "-o", "far.ply"), "far.ply: File exists"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_written(shapes, chair, arguments, message):
    chair.save("far.ply")
    before = sorted(Path().rglob("*"))
    assert failed(shapes(*arguments), message)
    assert sorted(Path().rglob("*")) == before


def test_without_ray_the_shapes_are_processed_here_unless_an_option_needs_it(shapes, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    assert failed(shapes(*BATCH, "--step", "inspect", "--timeout", 9), f"need Ray: {pip_install('batch')}")
    assert not Path("out").exists()
    result = shapes(*BATCH, "--step", "inspect")
    assert worked(result)
    assert "out: 1 done, in" in result.stderr


def test_one_edit_deforms_the_shapes_that_match_and_the_others_are_named(shapes, chair):
    for name, factor, seed in (("large", 3, 0), ("stranger", 2, 8)):
        mesh = dfd.Mesh(factor * chair.vertices, chair.faces)
        mesh.save(f"shapes/{name}.obj")
        field_of(mesh, seed).save(f"shapes/{name}.field.safetensors")
    edit = ("--edit", "edit.json", "--made-on", "shapes/chair.ply", "--step", "edits,exports", "--threshold", 0.92)
    result = shapes("batch", "shapes/*.*", "-o", "out", *edit, "--export", "same")
    assert worked(result)
    assert "large.obj: edit: confidence 0.93" in result.stderr
    assert "stranger.obj: edit: handle 1 may be on a wrong part of this shape: confidence 0." in result.stderr
    assert not list(Path("out/shapes/stranger.obj").glob("edit.*"))
    chair_now, large_now = (dfd.load(f"out/shapes/{name}/edit.{name[-3:]}") for name in ("chair.ply", "large.obj"))
    np.testing.assert_allclose(large_now.vertices, 3 * chair_now.vertices, atol=1e-2)
    assert np.abs(chair_now.vertices - dfd.load("shapes/chair.ply").vertices).max() > 0.15
    page = Path("out/index.html").read_text()
    assert "edit: confidence 0.93" in page
    assert failed(shapes("deform", "shapes/*.obj", "--edit", "edit.json", "-o", "moved"), "`dfd batch --edit` deforms")


def test_with_an_edit_the_default_steps_include_edits_and_exports(shapes, monkeypatch):
    monkeypatch.setattr("dfd.batch.run.run_batch", lambda *_, **__: [])
    assert worked(shapes(*BATCH, "--edit", "edit.json", "--made-on", "shapes/chair.ply"))
    settings = BatchSettings.model_validate_json(Path("out/batch.json").read_bytes())
    assert settings.steps == ("inspect", "distill", "pictures", "edits", "exports")
    assert settings.exports == ("same",)


def test_more_than_ray_has_is_refused(shapes):
    result = shapes(*BATCH, "--step", "inspect", "--gpus", 1)
    assert result.exit_code == 2
    assert result.stderr.endswith("`--threads` and `--gpus` must not be above the resources of Ray: 2 CPU, 0 GPU\n")


def test_an_edit_says_which_mesh_and_field_it_was_made_on(shapes):
    Path("shapes/chair.field.safetensors").rename("shapes/other.field.safetensors")
    moved = Path("edit.json").read_text().replace("chair.field", "other.field")
    Path("edit.json").write_text(moved)
    Path("list.csv").write_text("path,field\nshapes/chair.ply,shapes/other.field.safetensors\n")
    assert worked(shapes("batch", "list.csv", "-o", "out", "--step", "edits", "--edit", "edit.json"))
    assert Path("out/shapes/chair.ply/edit.edit.json").is_file()


def test_what_it_does_is_written_down(shapes):
    result = shapes(*BATCH, "--step", "inspect")
    assert worked(result)
    settings = BatchSettings.model_validate_json(Path("out/batch.json").read_text())
    assert settings.steps == ("inspect",)
    assert "out: 1 done, in" in result.stderr
    assert Path("out/shapes.jsonl").is_file()
    assert Path("out/index.html").is_file()
    assert failed(shapes(*BATCH, "--step", "pictures"), "was begun with other settings (steps")


def test_a_failed_shape_is_named_and_sets_the_exit_code(shapes):
    Path("shapes/\x1b[31m.ply").write_text("no mesh")
    result = shapes(*BATCH, "--step", "inspect")
    assert result.exit_code == 1
    assert "failed: bad input: " in result.stderr
    assert "1 done, 1 failed: bad input" in result.stderr
    assert "\x1b[31m" not in result.stderr


@pytest.mark.parametrize("given", [("--preset", "paper"), ("--edit", "paper.json", "--made-on", "shapes/chair.ply")])
def test_the_preset_or_that_of_the_edits_is_that_of_the_fields(shapes, given, monkeypatch):
    session = dfd.Deformer("shapes/chair.ply", dfd.Field.load("shapes/chair.field.safetensors"), preset="paper")
    session.add(40, translation=(0, -0.2, 0))
    session.save("paper.json")
    monkeypatch.setattr("dfd.batch.run.run_batch", lambda *_, **__: [])
    steps = "distill,edits" if "--edit" in given else "distill"
    assert worked(shapes(*BATCH, "--step", steps, *given))
    settings = BatchSettings.model_validate_json(Path("out/batch.json").read_bytes())
    assert settings.distill == DistillSettings(preset="paper").model_dump(mode="json")
    assert settings.preset == ("paper" if "--preset" in given else None)
