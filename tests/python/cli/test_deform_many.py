"""Test `dfd deform` with several shapes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_runs import drawn, failed, worked
from made_field import field_of

import dfd


def save(mesh: dfd.Mesh, name: str, seed: int = 1) -> None:
    mesh.save(f"{name}.ply")
    field_of(mesh, seed).save(f"{name}.field.safetensors")


@pytest.fixture
def shapes(run, chair):
    """Write first.ply with an edit, large.ply, the same shape three times as large, and both fields; return `run`."""
    save(chair, "first")
    save(dfd.Mesh(3 * chair.vertices, chair.faces), "large")
    deform = ("deform", "first.ply", "--field", "first.field.safetensors", "--handle", 40)
    assert worked(run(*deform, "--translate", 0, -0.2, 0, "--name", "leg", "--save-edit", "edit.json"))
    return run


def test_one_edit_deforms_all_shapes_that_match(shapes):
    result = shapes("deform", "*.ply", "--edit", "edit.json", "-o", "out")
    assert worked(result)
    assert "out/large.ply: confidence leg 0.95; moved" in result.stdout
    assert "2 of 2 shapes; out/sheet.png" in result.stderr
    first, large = (dfd.load(f"out/{name}.ply").vertices for name in ("first", "large"))
    np.testing.assert_allclose(large, 3 * first, atol=1e-2)
    assert np.abs(first - dfd.load("first.ply").vertices).max() > 0.15
    assert drawn("out/sheet.png").std() > 5
    assert Path("out/large.edit.json").is_file()


def test_the_shape_that_it_was_made_on_may_be_another(shapes):
    command = ("deform", "large.ply", "--edit", "edit.json", "-o", "out")
    assert worked(shapes(*command, "--made-on", "first.ply", "--picture", "sheet.png"))
    assert sorted(path.name for path in Path("out").iterdir()) == ["large.edit.json", "large.ply"]
    assert Path("sheet.png").is_file()


def test_an_edit_says_what_it_was_made_on(shapes):
    assert worked(shapes("deform", "large.ply", "large.ply", "--edit", "edit.json", "-o", "out"))
    wanted = dfd.load("out/large.ply").vertices
    assert worked(shapes("deform", "large.ply", "--made-on", "first.ply", "--edit", "edit.json", "-o", "again"))
    np.testing.assert_array_equal(dfd.load("again/large.ply").vertices, wanted)


def test_shapes_that_do_not_fit_or_cannot_be_read_are_left_out_and_named(shapes, chair):
    save(dfd.Mesh(2 * chair.vertices, chair.faces), "stranger", seed=8)
    Path("broken.ply").write_text("no mesh at all")
    result = shapes("deform", "*.ply", "--edit", "edit.json", "-o", "out", "--threshold", 0.94)
    assert result.exit_code == 1
    assert "dfd: broken.ply is left out: broken.ply " in result.stderr
    assert "dfd: stranger.ply is left out: leg may be on a wrong part of this shape: confidence 0." in result.stderr
    assert "2 of 4 shapes, 2 left out; out/sheet.png" in result.stderr
    assert sorted(path.name for path in Path("out").glob("*.ply")) == ["first.ply", "large.ply"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("none*.ply", "--edit", "edit.json", "-o", "out"), "nothing matches none*.ply"),
        (("first.ply", "none.ply", "--edit", "edit.json", "-o", "out"), "none.ply does not exist"),
        (("*.ply", "-o", "out"), "`--edit` must be given for several shapes"),
        (("*.ply", "--edit", "edit.json"), "`--output` must be given for several shapes"),
        (("*.ply", "--edit", "edit.json", "-o", "out", "--handle", "3"), "`--handle` is for one MESH"),
        (("*.ply", "--edit", "edit.json", "-o", "out", "--symmetry", "x"), "`--symmetry` is for one MESH"),
        (("*.ply", "--edit", "edit.json", "-o", "."), "`--output` must not be the input, got "),
        (("*.ply", "--edit", "edit.json", "-o", "first.ply"), "`--output` must be a folder"),
        (("*.ply", "--edit", "edit.json", "-o", "none/out"), "the folder none does not exist"),
        (("*.ply", "--edit", "edit.json", "-o", "out", "--field", "first.ply"), "`--field` must be a folder"),
        (("*.ply", "--edit", "none.json", "-o", "out"), "none.json"),
        (("*.ply", "first.obj", "--edit", "edit.json", "-o", "out"), "would have the same name in out"),
        (("large.ply", "second.ply", "--edit", "old.json", "-o", "out"), "`--made-on` must name the mesh"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_written(shapes, chair, arguments, message):
    chair.save("first.obj")
    save(dfd.Mesh(2 * chair.vertices, chair.faces), "second")
    Path("old.json").write_text(json.dumps(json.loads(Path("edit.json").read_text()) | {"made_on": None}))
    before = sorted(Path().iterdir())
    assert failed(shapes("deform", *arguments), message)
    assert sorted(Path().iterdir()) == before
