"""`dfd batch`: what it refuses before anything is written."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from command_runs import failed, worked

import dfd
from dfd.batch.settings import BatchSettings

BATCH = ("batch", "shapes/*.ply", "-o", "out")


@pytest.fixture
def shapes(run, chair, folder):
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
        (("batch", "list.csv", "-o", "out"), "list.csv must have a column path, got file"),
        (("batch", "twice.csv", "-o", "out"), "`name` must be distinct"),
        ((*BATCH, "--step", "dance"), "`--step` must be of inspect"),
        ((*BATCH, "--step", "inspect,edits"), "`--edit` and the step edits must be given together"),
        (
            (*BATCH, "--edit", "a.json", "--edit", "b.json", "--made-on", "far.ply"),
            "`--edit` and `--made-on` must be given equally often",
        ),
        ((*BATCH, "--edit", "none.json"), "none.json: the edit could not be read"),
        (
            (*BATCH, "--step", "edits", "--edit", "edit.json", "--made-on", "far.ply"),
            "far.field.safetensors, the field of far.ply, does not exist",
        ),
        ((*BATCH, "--distill", "views"), "`--distill` must be NAME=VALUE with one of background"),
        ((*BATCH, "--distill", "views=none"), "`views` must be a whole number"),
        ((*BATCH, "--step", "inspect", "--distill", "views=3"), "`--distill` settings need the step distill"),
        ((*BATCH, "--rank", "2", "--world-size", "2"), "`--rank` must be below `--world-size`, got 2 of 2"),
        ((*BATCH, "--workers", "2", "--ray-address", "auto"), "`--workers` is for this machine"),
        ((*BATCH, "--timeout", "0"), "`--timeout` must be"),
        ((*BATCH, "--memory", "-1"), "`--memory` must be"),
        ((*BATCH, "--memory", "1e6"), "1 tasks of 1e+06 GiB do not fit into the"),
        ((*BATCH, "--threads", "5000"), "`--threads` must be at most the"),
        ((*BATCH, "--gpus", "99"), "`--gpus` must be at most the"),
        (("batch", "shapes/*.ply", "-o", "none/out"), "the folder none does not exist"),
        (("batch", "shapes/*.ply", "-o", "shapes"), "must be a new folder or one of an earlier batch, got shapes"),
        (("batch", "shapes/*.ply", "-o", "list.csv"), "must be a folder, but list.csv is a file"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_written(shapes, chair, arguments, message):
    Path("list.csv").write_text("file\na.ply\n")
    Path("twice.csv").write_text("path,name\na.ply,x\nb.ply,x\n")
    chair.save("far.ply")
    before = sorted(Path().rglob("*"))
    assert failed(shapes(*arguments), message)
    assert sorted(Path().rglob("*")) == before


@pytest.mark.processes
@pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed: pip install 'dfd[batch]'")
@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("127.0.0.1:1", "no Ray cluster answers at 127.0.0.1:1: Connection refused"),
        ("ray://127.0.0.1:1", "no Ray cluster answers at ray://127.0.0.1:1: Connection refused"),
        ("somewhere", "`--ray-address` must be auto, HOST:PORT or ray://HOST:PORT, got 'somewhere'"),
    ],
)
def test_a_ray_cluster_that_does_not_answer_is_said(shapes, address, message):
    assert failed(shapes(*BATCH, "--ray-address", address), message)
    assert not Path("out").exists()


def test_an_edit_says_which_mesh_and_field_it_was_made_on(shapes):
    Path("shapes/chair.field.safetensors").rename("shapes/other.field.safetensors")
    moved = Path("edit.json").read_text().replace("chair.field", "other.field")
    Path("edit.json").write_text(moved)
    Path("list.csv").write_text("path,field\nshapes/chair.ply,shapes/other.field.safetensors\n")
    assert worked(shapes("batch", "list.csv", "-o", "out", "--step", "edits", "--edit", "edit.json", "--workers", 1))
    assert sorted(path.name for path in Path("out/edits").iterdir()) == [
        "edit.edit.json",
        "edit.field.safetensors",
        "edit.original.ply",
    ]


def test_what_it_does_is_written_down(shapes):
    result = shapes(*BATCH, "--step", "inspect", "--workers", 1)
    assert worked(result)
    settings = BatchSettings.model_validate_json(Path("out/batch.json").read_text())
    assert settings.steps == ("inspect",)
    assert "out: 1 done, in" in result.stderr
    assert Path("out/shapes.parquet").is_file()
    assert Path("out/index.html").is_file()
    again = shapes(*BATCH, "--step", "inspect", "--workers", 1)
    assert "1 of 1 shapes were finished before" in again.stderr
    assert failed(shapes(*BATCH, "--step", "pictures"), "was begun with other settings (steps")
