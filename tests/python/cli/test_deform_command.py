"""Test the output of `dfd deform`."""

import json
import re
import warnings
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from command_runs import drawn, failed, worked
from made_field import field_of

import dfd
from dfd.distillation.settings import DistillSettings
from dfd.editing.controls import controls_of
from dfd.editing.edit_file import read_edit
from dfd.field.field import Field

DEFORM = ("deform", "MESH", "--field", "FIELD")


def test_deform_writes_what_the_session_says(run, folder, chair):
    change = ("--translate", 0, -0.2, 0.1, "--rotate", 0, 30, 0, "--scale", 1.5, "--pivot", 0, 0, 0)
    rest = ("--fix", 900, "--fix", "0.1,0.2,0.3", "--symmetry", "x", "--band", 0.02)
    assert worked(run(*DEFORM, "--handle", 40, *change, *rest, "-o", "out.obj"))
    deformer = dfd.Deformer(chair, Field.load(folder / "chair.field.safetensors"))
    deformer.add(40, translation=(0, -0.2, 0.1), rotation=(0, 30, 0), scale=1.5, pivot=(0, 0, 0))
    deformer.fix(900)
    deformer.fix("0.1,0.2,0.3")
    deformer.set_symmetry("x", band=0.02)
    np.testing.assert_allclose(dfd.load("out.obj").vertices, deformer.vertices, atol=1e-5)
    assert np.abs(deformer.vertices - chair.vertices).max() > 0.05


@pytest.mark.parametrize(
    ("scale", "factors"),
    [
        (("--scale", "2"), (2, 2, 2)),
        (("--scale", "1", "2", "0.5"), (1, 2, 0.5)),
        (("--scale", "-1", "1", "1"), (-1, 1, 1)),
        (("--scale", "1,2,3"), (1, 2, 3)),
        (("--scale=1,2,3",), (1, 2, 3)),
    ],
)
def test_scale_takes_one_number_or_three(run, chair, scale, factors):
    assert worked(run(*DEFORM, "--handle", 40, *scale, "--save-edit", "edit.json"))
    (handle,) = read_edit("edit.json", chair).handles
    assert handle.transform.scale == factors


def test_an_edit_holds_several_handles_and_options_add_to_it(run, chair):
    assert worked(run(*DEFORM, "--handle", 40, "--scale", 2, "--fix", 3, "--save-edit", "one.json"))
    assert worked(run(*DEFORM, "--edit", "one.json", "--handle", 900, "--symmetry", "z", "--save-edit", "two.json"))
    edit = read_edit("two.json", chair)
    assert [handle.place.vertex for handle in edit.handles] == [40, 900]
    assert [fixed.place.vertex for fixed in edit.fixed] == [3]
    assert edit.symmetry.normal == (0, 0, 1)
    assert worked(run(*DEFORM, "--edit", "two.json", "-o", "out.stl"))
    assert Path("out.stl").stat().st_size > 0


def test_every_handle_has_the_options_that_follow_it(run, chair):
    first = ("--handle", 40, "--translate", 0, 1, 0, "--reach", "part", "--falloff=smooth", "--name", "foot")
    second = ("--handle=top", "--rotate", 0, 0, 90, "--locality", 2, "--counterparts", "own_pivot")
    second += ("--excluded-counterpart", 7, "--excluded-counterpart=0.1,0.2,0.3")
    third = ("--handle", 900, "--radius", "20%", "--strength", 0.5, "--mask", "y>0", "--axes", "normal")
    assert worked(run(*DEFORM, *first, *second, "--fix", "1000:0.25", *third, "--save-edit", "edit.json"))
    edit = read_edit("edit.json", chair)
    one, two, three = edit.handles
    assert (one.place.vertex, one.name, one.transform.translation) == (40, "foot", (0, 1, 0))
    assert (one.controls.reach, one.controls.falloff) == ("part", "smooth")
    assert two.place.vertex == chair.vertices[:, 1].argmax()
    assert two.transform.translation == (0, 0, 0)
    assert (two.controls.locality, two.controls.counterparts) == (2, "own_pivot")
    off = [place.vertex for place in two.controls.excluded_counterparts]
    assert off == [7, np.linalg.norm(chair.vertices - (0.1, 0.2, 0.3), axis=1).argmin()]
    assert one.controls.excluded_counterparts == three.controls.excluded_counterparts == ()
    assert three.controls.radius == pytest.approx(0.2 * chair.diagonal)
    assert (three.controls.strength, str(three.controls.mask)) == (0.5, "the side (0, 1, 0) · p ≥ 0")
    assert three.transform.axes is not None
    assert [(fixed.place.vertex, fixed.strength) for fixed in edit.fixed] == [(1000, 0.25)]


def test_the_paper_is_one_word_beside_which_anything_can_be_said(run, chair):
    move = ("--handle", 40, "--translate", 0, -0.2, 0, "--handle", 900, "--reach", 0.6, "--symmetry", "x")
    assert worked(run(*DEFORM, "--preset", "paper", *move, "--save-edit", "edit.json"))
    edit = read_edit("edit.json", chair)
    one, two = (handle.controls for handle in edit.handles)
    assert one == controls_of("paper")
    assert (two.reach, two.falloff) == (0.6, "linear")
    assert (edit.preset, edit.symmetry.band) == ("paper", 0)
    # An edit keeps its preset unless `--preset` gives another one.
    for preset, options in (("paper", ()), ("default", ("--preset", "default"))):
        assert worked(run(*DEFORM, "--edit", "edit.json", *options, "--save-edit", "again.json"))
        assert read_edit("again.json", chair).preset == preset
    assert read_edit("again.json", chair).handles[0].controls == controls_of("default")


@pytest.mark.parametrize("preset", [None, "paper"])
def test_without_a_field_one_is_distilled_by_the_preset(run, folder, monkeypatch, preset):
    asked = []

    def distilled(mesh, encoder, **how):
        asked.append((encoder, how.get("preset")))
        return Field.load(folder / "chair.field.safetensors")

    monkeypatch.setattr(dfd, "distill", distilled)
    words = () if preset is None else ("--preset", preset)
    moved = ("--handle", 40, "--translate", 0, -0.2, 0)
    assert worked(run("deform", "MESH", "--encoder", "dinov2-small", *words, *moved, "-o", "out.ply"))
    assert worked(run(*DEFORM, *words, *moved, "-o", "wanted.ply"))
    assert asked == [("dinov2-small", preset or "default")]
    np.testing.assert_array_equal(dfd.load("out.ply").vertices, dfd.load("wanted.ply").vertices)


def test_what_auto_looks_at_can_be_said(run, monkeypatch):
    asked = []

    def none(field, mesh, **how):
        asked.append(how)
        return []

    monkeypatch.setattr("dfd.editing.edit.symmetry_planes", none)
    auto = (*DEFORM, "--handle", 40, "--save-edit", "edit.json", "--symmetry", "auto")
    for words in ((), ("--symmetry-candidates", "axes", "--symmetry-threshold", 0.2), ("--preset", "paper"),
                  ("--preset", "paper", "--symmetry-threshold", "relative")):  # fmt: skip
        assert failed(run(*auto, *words), "no plane has two sides that look alike")
    assert [(how["candidates"], how["threshold"]) for how in asked] == [
        ("any", "relative"), ("axes", 0.2), ("axes", 0.1), ("axes", "relative")
    ]  # fmt: skip


def test_a_point_is_taken_to_the_surface_and_what_it_means_is_said(run, chair):
    result = run(*DEFORM, "--handle", "0.2,0.9,-0.2", "--scale", 2, "--fix", "bottom", "--save-edit", "edit.json")
    assert worked(result)
    apart = np.linalg.norm(chair.vertices - [0.2, 0.9, -0.2], axis=1)
    (handle,) = read_edit("edit.json", chair).handles
    assert handle.place.vertex == apart.argmin()
    assert f"--handle 0.2,0.9,-0.2 is vertex {apart.argmin()}, {apart.min():.3g} away" in result.stderr
    assert f"--fix bottom is vertex {chair.vertices[:, 1].argmin()}" in result.stderr


def test_what_happened_is_said(run):
    moved = run(*DEFORM, "--handle", 40, "--translate", 0, 0.5, 0, "-o", "out.obj")
    assert worked(moved)
    assert re.search(
        r"out.obj: moved \d+ % of the vertices, up to 0.5, and stretched edges up to [\d.]+ times; handle 1 arrived",
        moved.stderr,
    )
    rested = run(*DEFORM, "--handle", 40, "-o", "again.obj")
    assert rested.exit_code == 1
    assert "dfd: nothing moved: no handle is moved, turned or scaled, so nothing is written" in rested.stderr
    assert not Path("again.obj").exists()


def test_a_picture_is_taken_from_where_it_is_told(run):
    small = (*DEFORM, "--handle", 40, "--translate", 0, 0.3, 0)
    with mock.patch("dfd.pictures.sheet.BEFORE_AFTER_RESOLUTION", 64):
        assert worked(run(*small, "--picture", "own.png"))
        assert worked(run(*small, "--picture", "other.png", "--azimuth", 200, "--elevation", 60, "--zoom", 2))
    own, other = drawn("own.png"), drawn("other.png")
    assert own.shape == other.shape
    assert np.abs(own - other).max() > 30


def test_a_folder_gets_a_mesh_of_the_same_name(run, folder):
    Path("out").mkdir()
    assert worked(run("deform", "MESH", "--field", "FIELD", "--handle", 40, "--translate", 0, 0.2, 0, "-o", "out"))
    assert Path("out/chair.obj").is_file()
    same = run("deform", "MESH", "--field", "FIELD", "--handle", 40, "--translate", 0, 0.2, 0, "-o", folder)
    assert failed(same, "chair.obj: give another file or folder, or `--force` to replace the input")


def test_the_input_is_replaced_only_by_force(run, chair):
    chair.save("own.obj")
    before = Path("own.obj").read_bytes()
    move = ("deform", "own.obj", "--field", "FIELD", "--handle", 40, "--translate", 0, 0.2, 0, "-o", "own.obj")
    assert failed(run(*move), "`--output` must not be the input, got own.obj")
    assert Path("own.obj").read_bytes() == before
    result = run(*move, "--force")
    assert worked(result)
    assert result.stderr.endswith("; the input was replaced\n")
    assert Path("own.obj").read_bytes() != before


def test_a_motion_of_many_diagonals_warns(run, chair):
    for length, warns in ((9 * chair.diagonal, False), (11 * chair.diagonal, True)):
        result = run(*DEFORM, "--handle", 40, "--translate", 0, length, 0, "-o", "out.obj")
        assert worked(result)
        assert ("11 times its diagonal: motions are in the units of the mesh" in result.stderr) == warns


def test_the_help_groups_the_options(run):
    text = run("deform", "--help").output
    for heading, option in (
        ("Handle", "--handle"), ("Motion of a handle", "--translate"), ("Controls of a handle", "--reach"),
        ("Symmetry", "--symmetry"), ("Output", "--output"),
    ):  # fmt: skip
        assert option in text.partition(f"─ {heading} ─")[2].partition("╰")[0], heading
    assert "─ Output ─" not in run("show", "--help").output


@pytest.mark.parametrize(
    ("given", "wanted"), [((), "paper"), (("--preset", "default"), "default"), (("--preset", "paper"), "paper")]
)
def test_a_field_is_distilled_by_the_preset_of_the_edit(run, chair, monkeypatch, given, wanted):
    def distill(mesh, *_, preset, **__):
        asked.append(preset)
        field = field_of(mesh)
        field.settings = DistillSettings(preset=preset).as_dict()
        return field

    asked: list[str] = []
    monkeypatch.setattr(dfd, "distill", distill)
    move = ("--handle", 40, "--translate", 0, 0.1, 0)
    assert worked(run("deform", "MESH", "--field", "FIELD", "--preset", "paper", *move, "--save-edit", "edit.json"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert worked(run("deform", "MESH", "--edit", "edit.json", *given, "-o", "out.obj", "--save-edit", "out.json"))
    assert asked == [wanted]
    assert read_edit("out.json", chair).preset == wanted


@pytest.mark.parametrize("motion", [(), ("--fit-motion", "affine")])
def test_fit_moves_handles_to_targets(run, folder, chair, motion):
    marks = [40, 41, 60, 300, 700, 900]
    wanted = chair.vertices[marks] + (0, 0.1, 0)
    targets = {str(vertex): position.tolist() for vertex, position in zip(marks, wanted, strict=True)}
    Path("marks.json").write_text(json.dumps(targets))
    options = ("--handle", 40, "--reach", 2.5, "--falloff", "constant", "--fit", "marks.json", *motion)
    result = run(*DEFORM, *options, "-o", "out.obj")
    assert worked(result)
    assert "dfd: fitted to marks.json: mean distance" in result.stderr
    np.testing.assert_allclose(dfd.load("out.obj").vertices[marks], wanted, atol=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "must be an object of places and positions"),
        ("{}", "must be an object of places and positions"),
        ('{"top": [0, 1]}', "must be an object of places and positions"),
        ("{", "is no JSON file"),
        ('{"nowhere": [0, 1, 2]}', "must be a vertex index"),
    ],
)
def test_targets_that_cannot_be_read(run, text, message):
    Path("marks.json").write_text(text)
    Path("out.obj").unlink(missing_ok=True)
    assert failed(run(*DEFORM, "--handle", 40, "--fit", "marks.json", "-o", "out.obj"), message)
    assert not Path("out.obj").exists()
