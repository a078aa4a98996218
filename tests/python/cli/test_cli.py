"""The command line: what each command writes, and how it fails."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from inspect import signature
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import torch
from made_field import made_field
from mesh_files import CORNERS, CUBE
from PIL import Image
from tiny_encoder import save_tiny_encoder
from typer.testing import CliRunner

import dfd
from dfd import Mesh
from dfd.cli import app
from dfd.distillation.settings import DistillSettings
from dfd.editing.edit_file import read_edit
from dfd.field.field import Field

DISTILL = sys.modules["dfd.cli.distill"]  # by its own name there is the command


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with chair.obj and chair.field.safetensors, a field that has learnt nothing."""
    path = tmp_path_factory.mktemp("cli")
    mesh = dfd.samples.chair(4000).mesh
    mesh.save(path / "chair.obj")
    with torch.random.fork_rng():
        torch.manual_seed(1)
        field = made_field(16, width=32, layers=2, center=mesh.bounds.mean(0), scale=2 / max(mesh.extents))
    field.settings = {"encoder": "none", "seed": 3, "losses": [1.0, 0.5, 0.4]}
    field.save(path / "chair.field.safetensors")
    return path


@pytest.fixture
def chair(folder):
    return dfd.load(folder / "chair.obj")


@pytest.fixture
def run(folder, tmp_path, monkeypatch):
    """Run dfd in an empty folder with an empty cache; MESH and FIELD stand for the chair's files."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    names = {"MESH": str(folder / "chair.obj"), "FIELD": str(folder / "chair.field.safetensors")}

    def invoke(*arguments):
        return CliRunner().invoke(app, [names.get(argument, str(argument)) for argument in arguments], prog_name="dfd")

    return invoke


def failed(result, message, code=2):
    """Assert that a run ended with one line on standard error that holds `message`."""
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    lines = [line for line in result.stderr.splitlines() if "━" not in line]  # less the bars of finished stages
    assert len(lines) == 1, lines
    assert lines[0].startswith("dfd: ")
    assert message in lines[0]
    return True


def worked(result):
    assert result.exit_code == 0, (result.output, result.exception)
    return True


# --- deform


DEFORM = ("deform", "MESH", "--field", "FIELD")


def test_deform_writes_what_the_session_says(run, folder, chair):
    change = ("--translate", 0, -0.2, 0.1, "--rotate", 0, 30, 0, "--scale", 1.5, "--pivot", 0, 0, 0)
    rest = ("--fix", 900, "--fix", "0.1,0.2,0.3", "--symmetry", "x", "--band", 0.02)
    assert worked(run(*DEFORM, "--handle", 40, *change, *rest, "-o", "out.obj"))
    deformer = dfd.Deformer(chair, Field.load(folder / "chair.field.safetensors"))
    deformer.add(40, translation=(0, -0.2, 0.1), rotation=(0, 30, 0), scale=1.5, pivot=(0, 0, 0))
    deformer.fix(900)
    deformer.fix((0.1, 0.2, 0.3))
    deformer.set_symmetry("x", band=0.02)
    np.testing.assert_allclose(dfd.load("out.obj").vertices, deformer.vertices, atol=1e-5)
    assert np.abs(deformer.vertices - chair.vertices).max() > 0.05


def test_locality_keeps_a_deformation_near(run, chair):
    move = ("--handle", 40, "--translate", 0, 0.5, 0)
    assert worked(run(*DEFORM, *move, "-o", "wide.ply"))
    assert worked(run(*DEFORM, *move, "--locality", 4, "-o", "near.ply"))
    wide, near = (np.abs(dfd.load(name).vertices - chair.vertices).sum() for name in ("wide.ply", "near.ply"))
    assert 0 < near < 0.8 * wide


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
    assert worked(run(*DEFORM, "--handle", "0.1,-0.2,0.3", *scale, "--save-edit", "edit.json"))
    (handle,) = read_edit("edit.json", chair).handles
    assert handle.transform.scale == factors
    assert handle.place.position == (0.1, -0.2, 0.3)


def test_an_edit_holds_several_handles_and_options_add_to_it(run, chair):
    assert worked(run(*DEFORM, "--handle", 40, "--scale", 2, "--fix", 3, "--save-edit", "one.json"))
    assert worked(run(*DEFORM, "--edit", "one.json", "--handle", 900, "--symmetry", "z", "--save-edit", "two.json"))
    edit = read_edit("two.json", chair)
    assert [handle.place.vertex for handle in edit.handles] == [40, 900]
    assert [place.vertex for place in edit.fixed] == [3]
    assert edit.symmetry.normal == (0, 0, 1)
    assert worked(run(*DEFORM, "--edit", "two.json", "-o", "out.stl"))
    assert Path("out.stl").stat().st_size > 0


def test_a_picture_shows_before_and_after(run):
    assert worked(run(*DEFORM, "--handle", 40, "--translate", 0, 1, 0, "--picture", "out.png"))
    with Image.open("out.png") as image:
        assert image.width > 2 * image.height
        assert np.asarray(image).std() > 10


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "`--handle` or `--edit` must be given"),
        (("--fix", 3), "`--handle` or `--edit` must be given"),
        (
            ("--edit", "none.json", "--translate", 0, 0, 1),
            "`--handle` must be given: it is what the translation is for",
        ),
        (("--handle", 1, "--band", 0.1), "`--symmetry` must be given"),
        (("--handle", "seat"), "`--handle` must be a vertex index or a point x,y,z, got 'seat'"),
        (("--handle", "1,2"), "`--handle` must be 3 numbers, got shape (2,)"),
        (("--handle", "1,2,nan"), "`--handle` must be finite, got nan"),
        (("--handle", 10**6), "`--handle` must lie in 0 … 2003, got 1000000"),
        (("--handle", -1), "`--handle` must lie in 0 … 2003, got -1"),
        (("--handle", 1, "--fix", 99999), "`--fix` must lie in 0 … 2003, got 99999"),
        (("--handle", 1, "--fix", 1), "`fixed` must be free places, but 1 is handle 1 already"),
        (("--handle", 1, "--fix", 2, "--fix", 2), "`fixed` must be free places, but 2 is fixed already"),
        (("--handle", 1, "--translate", 0, "nan", 0), "`translation` must be finite, got nan"),
        (("--handle", 1, "--translate", 0, "up", 0), "--translate"),
        (("--handle", 1, "--translate", 0, 1), "--translate"),
        (("--handle", 1, "--scale", "big"), "`--scale` must be one number or three, got 'big'"),
        (("--handle", 1, "--scale", 1, 2), "unexpected extra argument"),
        (("--handle", 1, "--scale", "inf"), "`scale` must be finite, got inf"),
        (("--handle", 1, "--locality", -1), "`locality` must be at least 0, got -1"),
        (("--handle", 1, "--locality", "nan"), "`locality` must be finite, got nan"),
        (("--handle", 1, "--symmetry", "w"), "`plane` must be x, y, z or a SymmetryPlane, got 'w'"),
        (("--handle", 1, "--symmetry", "x", "--band", -1), "`band` must be at least 0, got -1"),
        (("--edit", "none.json"), "none.json: the edit could not be read: No such file or directory"),
        (("--handel", 1), "No such option: --handel"),
    ],
)
def test_deform_names_what_is_wrong_and_writes_nothing(run, tmp_path, arguments, message):
    assert failed(run(*DEFORM, *arguments, "-o", "out.obj"), message)
    assert list(tmp_path.iterdir()) == []


def test_deform_wants_something_to_write(run):
    assert failed(run(*DEFORM, "--handle", 1), "`--output`, `--picture` or `--save-edit` must be given")


@pytest.mark.parametrize(
    ("option", "path", "message"),
    [
        ("-o", "no/such/out.obj", "`--output`: the folder no/such does not exist"),
        ("-o", "out.fbx", "`--output` must end in .obj, .ply, .stl, .off, .glb, .gltf, got out.fbx"),
        ("-o", "folder.obj", "`--output`: folder.obj is a folder, not a file"),
        ("--picture", "out.jpg", "`--picture` must end in .png, got out.jpg"),
        ("--picture", "no/out.png", "`--picture`: the folder no does not exist"),
        ("--save-edit", "no/edit.json", "`--save-edit`: the folder no does not exist"),
    ],
)
def test_outputs_are_checked_before_the_work(run, option, path, message, tmp_path):
    (tmp_path / "folder.obj").mkdir()
    # Neither mesh nor field exist: were they read first, the message would be about them.
    result = run("deform", "none.obj", "--field", "none", "--handle", 1, option, path)
    assert failed(result, message)


def test_a_folder_that_cannot_be_written_is_noticed_before_the_work(run, monkeypatch):
    def read_only(*_, **__):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("tempfile.TemporaryFile", read_only)
    result = run("deform", "none.obj", "--field", "none", "--handle", 1, "-o", "out.obj")
    assert failed(result, "`--output`: out.obj cannot be written: Read-only file system")


def test_a_disk_that_fills_up_leaves_the_old_file_whole(run, monkeypatch, tmp_path):
    (tmp_path / "out.ply").write_text("precious")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert failed(run(*DEFORM, "--handle", 1, "-o", "out.ply"), "No space left on device")
    assert (tmp_path / "out.ply").read_text() == "precious"
    assert list(tmp_path.iterdir()) == [tmp_path / "out.ply"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not an edit"),
        ('{"format": "dfd-edit", "version": 2}', "`version` must be 1, got 2"),
        ('{"format": "dfd-edit", "version": 1, "handels": []}', "`handels` is an unknown key"),
        ('{"format": "dfd-edit", "version": 1, "handles": [{"vertex": 1', "no whole JSON document"),
        ('{"format": "dfd-edit", "version": 1, "handles": [{"vertex": 123456}]}', "`handles[0].vertex` must lie in"),
    ],
)
def test_an_odd_edit_is_named(run, tmp_path, content, message):
    (tmp_path / "edit.json").write_text(content)
    message = message.replace("not an edit", "edit.json: no whole JSON document")
    assert failed(run(*DEFORM, "--edit", "edit.json", "-o", "out.obj"), message)


@pytest.mark.parametrize("command", ["deform", "show"])
def test_a_field_of_a_shape_in_other_units_is_named(run, chair, command):
    chair.save("metres.obj", 0.01 * chair.vertices)
    rest = ("--handle", 1, "-o", "out.obj" if command == "deform" else "out.png")
    result = run(command, "metres.obj", "--field", "FIELD", *rest)
    assert failed(result, "a longest side of 0.9897 around (0, 0.526, -0.007948), and this mesh has one of 0.009897")
    assert [path.name for path in Path().iterdir()] == ["metres.obj"]


# --- files that are none


@pytest.mark.parametrize("command", ["deform", "show", "inspect"])
def test_a_mesh_or_a_field_that_is_none_is_named(run, folder, tmp_path, command):
    (tmp_path / "empty.obj").write_text("")
    (tmp_path / "text.field").write_text("no field")
    whole = (folder / "chair.field.safetensors").read_bytes()
    (tmp_path / "cut.field").write_bytes(whole[: len(whole) // 2])
    rest = {"deform": ("--handle", 1, "-o", "out.obj"), "show": ("-o", "out.png"), "inspect": ()}[command]
    for mesh, field, message in [
        ("none.obj", "FIELD", "none.obj"),
        ("empty.obj", "FIELD", "empty.obj"),
        ("MESH", "none.field", "none.field"),
        ("MESH", "text.field", "text.field"),
        ("MESH", "cut.field", "cut.field"),
    ]:
        assert failed(run(command, mesh, "--field", field, *rest), message)


# --- show


def drawn(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def test_show_draws_the_mesh_its_features_or_weights(run):
    small = ("--resolution", 64, "-o")
    assert worked(run("show", "MESH", *small, "plain.png"))
    assert worked(run("show", "MESH", "--field", "FIELD", *small, "features.png"))
    assert worked(run("show", "MESH", "--field", "FIELD", "--handle", 40, *small, "heat.png"))
    assert worked(run("show", "MESH", "--field", "FIELD", "--handle", 40, "--fix", 41, *small, "held.png"))
    pictures = [drawn(name) for name in ("plain.png", "features.png", "heat.png", "held.png")]
    assert all(picture.shape == (64, 64, 3) for picture in pictures)
    for i, one in enumerate(pictures):
        for other in pictures[:i]:
            assert np.abs(one - other).max() > 30


def test_many_vertices_are_shown_and_deformed_from_compact_features(run, chair):
    show = ("show", "MESH", "--field", "FIELD", "--resolution", 64, "-o")
    move = ("--handle", 40, "--translate", 0, 0.2, 0, "-o")
    results = []
    for most_exact in (10_000, 100):
        with mock.patch("dfd.editing.handle_weights.MOST_EXACT", most_exact):
            assert worked(run(*show, "features.png"))
            assert worked(run(*show, "heat.png", "--handle", 40))
            assert worked(run(*DEFORM, *move, "out.ply"))
        results.append((drawn("features.png"), drawn("heat.png"), dfd.load("out.ply").vertices))
    (features, heat, vertices), (compact_features, compact_heat, compact_vertices) = results
    assert np.abs(features - compact_features).max() < 10
    assert np.abs(heat - compact_heat).max() < 10
    assert 0 < np.abs(vertices - compact_vertices).max() <= 0.01 * 0.2


def test_show_makes_a_sheet_of_handles_and_sides(run):
    handles = ("--handle", 40, "--handle", "0.1,0.2,0.3")
    arguments = ("--views", 3, "--resolution", 64, "--locality", 2, "-o", "sheet.png")
    assert worked(run("show", "MESH", "--field", "FIELD", *handles, *arguments))
    height, width, _ = drawn("sheet.png").shape
    assert width > 3 * 64
    assert height > 2 * 64


def test_a_handle_is_shown_from_its_own_side(run, chair):
    from dfd.pictures.before_after import ASIDE, azimuth_towards

    middle = chair.bounds.mean(axis=0)
    assert azimuth_towards(chair, [middle + [1, 5, 0]]) == pytest.approx(90 + ASIDE)
    assert azimuth_towards(chair, [middle + [0, 0, -1], middle + [1, 0, 0]]) == pytest.approx(135 + ASIDE)
    assert azimuth_towards(chair, []) == ASIDE
    small = ("--field", "FIELD", "--handle", int(chair.vertices[:, 2].argmin()), "--resolution", 64, "-o")
    assert worked(run("show", "MESH", *small, "own.png"))
    assert worked(run("show", "MESH", *small, "front.png", "--azimuth", 0))
    assert np.abs(drawn("own.png") - drawn("front.png")).max() > 30


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--handle", 1), "`--field` must be given: weights come from it"),
        (("--field", "FIELD", "--fix", 1), "`--handle` must be given: fixed points hold back"),
        (("--field", "FIELD", "--handle", 10**6), "`--handle` must lie in 0 … 2003"),
        (("--field", "FIELD", "--handle", 1, "--handle", 1), "`handles` must lie at distinct places"),
        (("--field", "FIELD", "--handle", 1, "--locality", -1), "`locality` must be at least 0"),
        (("--views", 0), "--views"),
        (("--resolution", 1), "--resolution"),
        (("--azimuth", "nan"), "`--azimuth` must be finite, got nan"),
        (("--elevation", "inf"), "`--elevation` must be finite, got inf"),
    ],
)
def test_show_names_what_is_wrong(run, tmp_path, arguments, message):
    assert failed(run("show", "MESH", "-o", "out.png", *arguments), message)
    assert list(tmp_path.iterdir()) == []


# --- inspect


def test_inspect_prints_a_table(run):
    result = run("inspect", "MESH")
    assert worked(result)
    assert result.stderr == ""
    lines = [line.split() for line in result.stdout.splitlines()]
    assert ["vertex", "count", "2,004"] in lines
    assert ["face", "count", "4,008"] in lines
    assert ["boundary", "edges", "0"] in lines
    assert ["unseen", "nothing,", "in", "24", "views"] in lines
    assert "symmetry" not in result.stdout


@pytest.mark.parametrize(
    ("vertices", "faces", "line"),
    [
        (
            np.vstack([CORNERS, CORNERS / 2 + 0.25]),
            np.vstack([CUBE, CUBE + 8]),
            "unseen 20.0% of the surface, 1 of 2 components wholly, in 24 views: it takes the nearest seen features",
        ),
        (
            np.vstack([CORNERS, CORNERS + [0, 0, 1]]),
            np.vstack([CUBE, CUBE + 8]),
            "unseen 16.7% of the surface, in 24 views: it takes the nearest seen features",
        ),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], "unseen all of it, for no face has an area"),
    ],
)
def test_inspect_says_what_no_camera_sees(run, vertices, faces, line):
    Mesh(vertices, faces).save("shape.obj")
    result = run("inspect", "shape.obj")
    assert worked(result)
    assert line in " ".join(result.stdout.split())


def test_inspect_prints_json_with_the_planes_of_a_field(run, folder):
    with mock.patch(
        "dfd.symmetry.search.RELATIVE_THRESHOLD", 10.0
    ):  # every plane will do for a field that learnt nothing
        result = run("inspect", "MESH", "--field", "FIELD", "--json")
        table = run("inspect", "MESH", "--field", "FIELD")
    assert worked(result)
    report = json.loads(result.stdout)
    assert report["file"] == str(folder / "chair.obj")
    assert report["vertex_count"] == 2004
    assert report["components"] == 1
    assert report["unseen"] == {"views": 24, "area": 0, "components": 0, "component_count": 1}
    assert report["field"]["dimension"] == 16
    assert report["field"]["settings"] == {"encoder": "none", "seed": 3}
    assert [1, 0, 0] in [plane["normal"] for plane in report["symmetry_planes"]]
    assert worked(table)
    assert "x=0 (score" in table.stdout
    assert "16 dimensions" in table.stdout


def test_inspect_says_when_there_is_no_plane(run):
    with mock.patch("dfd.symmetry.search.RELATIVE_THRESHOLD", 0.0), mock.patch("dfd.symmetry_planes", return_value=[]):
        result = run("inspect", "MESH", "--field", "FIELD")
    assert ["symmetry", "planes", "none"] in [line.split() for line in result.stdout.splitlines()]


# --- distill


def test_distill_hands_everything_on(run, folder):
    field = Field.load(folder / "chair.field.safetensors")
    options = ("--encoder", "clip", "--views", 6, "--resolution", 224, "--framing", "paper", "--simplify-to", 500)
    more = ("--supervision", "vertex", "--steps", 7, "--seed", 11, "--device", "cpu", "--loss-curve", "loss.png")
    more += ("--octaves", 3, "--batch", 99, "--learning-rate", 0.004)
    np.save("rows.npy", np.eye(3))
    more += ("--features", "rows.npy", "--no-cache", "--not-mirrored", "--smoothing", 0.1)
    with mock.patch.object(DISTILL, "distilling", return_value=nullcontext(field)) as distill:
        result = run("distill", "MESH", "-o", "out.safetensors", *options, *more)
    assert worked(result)
    (mesh, encoder, settings), given = distill.call_args
    assert len(mesh.vertices) == 2004
    assert encoder == "clip"
    del given["stages"]
    np.testing.assert_array_equal(given.pop("features"), np.eye(3))
    assert given == {"device": "cpu", "cache": False, "checkpoint": Path("out.safetensors.partial")}
    assert settings == DistillSettings(
        views=6,
        resolution=224,
        framing="paper",
        simplify_to=500,
        supervision="vertex",
        mirrored=False,
        smoothing=0.1,
        octaves=3,
        batch=99,
        learning_rate=0.004,
        steps=7,
        seed=11,
    )
    assert Field.load("out.safetensors").settings == field.settings
    assert drawn("loss.png").std() > 5
    assert "out.safetensors: a field of 16 dimensions" in result.stderr


def test_distill_leaves_defaults_to_the_function(run, folder):
    field = Field.load(folder / "chair.field.safetensors")
    with mock.patch.object(DISTILL, "distilling", return_value=nullcontext(field)) as distill:
        assert worked(run("distill", "MESH", "-o", "out.safetensors"))
    (_, encoder, settings), given = distill.call_args
    parameters = signature(dfd.distill).parameters
    assert encoder == parameters["encoder"].default
    assert settings == DistillSettings()
    assert all(given[name] == parameters[name].default for name in ("features", "device", "cache"))


def worked_from_cache(result):
    assert worked(result)
    return "from the cache" in result.stderr


def test_distill_copies_what_the_cache_has(run, tmp_path):
    save_tiny_encoder(tmp_path / "tiny")
    command = ("distill", "MESH", "--encoder", "./tiny", "--views", 2, "--resolution", 32, "--steps", 3)
    assert not worked_from_cache(run(*command, "-o", "first.safetensors"))
    made_before = AssertionError("it was made before")
    with (
        mock.patch.object(DISTILL, "distilling", side_effect=made_before),
        mock.patch("dfd.load", side_effect=made_before),
    ):
        again = run(*command, "-o", "again.safetensors", "--loss-curve", "loss.png")
    assert worked(again)
    assert "again.safetensors: a field of 16 dimensions, from the cache (" in again.stderr
    assert drawn("loss.png").std() > 5
    one, two = (Field.load(f"{name}.safetensors") for name in ("first", "again"))
    assert one.settings == two.settings
    assert all(torch.equal(value, two.state_dict()[name]) for name, value in one.state_dict().items())

    assert not worked_from_cache(run(*command, "-o", "anew.safetensors", "--no-cache"))
    (tmp_path / "cache" / "meshes.json").unlink()
    assert worked_from_cache(run(*command, "-o", "again.safetensors"))
    (entry,) = (tmp_path / "cache" / "fields").iterdir()
    entry.write_bytes(entry.read_bytes()[:-1])
    with mock.patch.object(DISTILL, "distilling", return_value=nullcontext(one)) as distill:
        third = run(*command, "-o", "third.safetensors")
    assert not worked_from_cache(third)
    assert distill.called
    Field.load("third.safetensors")


def test_distill_interrupted_says_how_to_go_on(run):
    def interrupted(*_, checkpoint, **__):
        checkpoint.mkdir()
        raise KeyboardInterrupt

    with mock.patch.object(DISTILL, "distilling", interrupted):
        result = run("distill", "MESH", "-o", "out.safetensors")
    message = "interrupted: the same command goes on from here; what is done is in out.safetensors.partial"
    assert failed(result, message, code=130)


def test_distill_that_cannot_write_its_field_keeps_what_is_done(run, tmp_path):
    save_tiny_encoder(tmp_path / "tiny")
    command = ("distill", "MESH", "--encoder", "./tiny", "--views", 2, "--resolution", 32, "--steps", 3, "--no-cache")
    full = OSError(errno.ENOSPC, "No space left on device")
    with mock.patch.object(Field, "save", side_effect=full):
        assert failed(run(*command, "-o", "out.safetensors"), "No space left on device")
    assert any(Path("out.safetensors.partial").glob("tokens-*"))
    with mock.patch("dfd.encoders.encode.Encoder._forward", side_effect=AssertionError("it was encoded before")):
        assert worked(run(*command, "-o", "out.safetensors"))
    assert not Path("out.safetensors.partial").exists()
    Field.load("out.safetensors")


def test_features_that_are_no_array_are_refused(run):
    Path("rows.npy").write_text("1 2 3")
    assert failed(
        run("distill", "MESH", "-o", "out.safetensors", "--features", "rows.npy"), "`--features` must be an .npy file"
    )
    np.save("rows.npy", np.array([{}], dtype=object))
    assert failed(run("distill", "MESH", "-o", "out.safetensors", "--features", "rows.npy"), "rows.npy is not: Object")
    assert failed(run("distill", "MESH", "-o", "out.safetensors", "--features", "none.npy"), "none.npy: No such file")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "out.safetensors", "--supervision", "all"), "`supervision` must be one of barycentric, vertex"),
        (("-o", "out.safetensors", "--steps", 0), "`steps` must be a whole number of at least 1, got 0"),
        (("-o", "out.safetensors", "--views", "many"), "--views"),
        (("-o", "out.field"), "`--output` must end in .safetensors, got out.field"),
        (("-o", "no/out.safetensors"), "`--output`: the folder no does not exist"),
        (("-o", "out.safetensors", "--loss-curve", "loss.svg"), "`--loss-curve` must end in .png"),
        ((), "Missing option '--output'"),
    ],
)
def test_distill_names_what_is_wrong(run, tmp_path, arguments, message):
    assert failed(run("distill", "MESH", *arguments), message)
    assert list(tmp_path.iterdir()) == []


# --- demo, and dfd itself


def test_demo_writes_where_it_is_told(run):
    with mock.patch("dfd.demo.run") as demo:
        assert worked(run("demo", "-o", "story"))
        demo.assert_called_once_with(Path("story"))


@pytest.mark.parametrize(
    ("error", "message", "code"),
    [
        (ValueError("bind: `features` must be\nfinite"), "dfd: bind: `features` must be finite", 2),
        (OSError(28, "No space left on device"), "dfd: No space left on device", 2),
        (FileNotFoundError(2, "No such file or directory", "a.obj"), "dfd: a.obj: No such file or directory", 2),
        (PermissionError("the cache is locked"), "dfd: the cache is locked", 2),
        (MemoryError(), "dfd: out of memory", 2),
        (MemoryError("distill: lower `views`"), "dfd: out of memory: distill: lower `views`", 2),
        (KeyboardInterrupt(), "dfd: interrupted", 130),
    ],
)
def test_whatever_goes_wrong_is_one_line_and_a_code(run, error, message, code):
    with mock.patch("dfd.demo.run", side_effect=error):
        assert failed(run("demo"), message, code)


def test_a_mistake_of_ours_is_not_hidden(run):
    with mock.patch("dfd.demo.run", side_effect=ZeroDivisionError):
        assert isinstance(run("demo").exception, ZeroDivisionError)


def test_a_warning_is_one_line(run, folder):
    def warns(*_):
        import warnings

        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("the texture cannot be read:\nit is shown grey", UserWarning, stacklevel=1)
            warnings.warn("old", DeprecationWarning, stacklevel=1)

    with mock.patch("dfd.demo.run", warns):
        result = run("demo")
    assert worked(result)
    assert result.stderr == "dfd: the texture cannot be read: it is shown grey\n"


def test_help_lists_every_command_and_option(run):
    result = run("--help")
    assert worked(result)
    for command in ("demo", "distill", "deform", "show", "inspect"):
        assert command in result.stdout
        assert worked(run(command, "--help"))


def test_unknown_commands_are_refused(run):
    assert failed(run("deforme"), "No such command 'deforme'")


def dfd_process(*arguments, **options):
    return subprocess.Popen(
        [sys.executable, "-m", "dfd", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
        **options,
    )


def test_python_m_dfd_is_the_command(tmp_path):
    with dfd_process("--version") as process:
        output, error = process.communicate(timeout=60)
    assert process.returncode == 0, error
    assert output.startswith("dfd ")
    with dfd_process("show", tmp_path / "none.obj", "-o", tmp_path / "out.png", "--handle", 1) as process:
        output, error = process.communicate(timeout=60)
    assert process.returncode == 2
    assert output == ""
    assert error == "dfd: `--field` must be given: weights come from it\n"


def test_help_and_version_need_nothing_heavy():
    code = (
        "import sys; from dfd.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print([name for name in ('torch', 'trimesh', 'transformers', 'scipy', 'PIL') if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert result.stdout.splitlines()[-1] == "[]"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs a pipe with a name")
def test_control_c_is_one_line_and_code_130(folder, tmp_path):
    # A pipe that nothing is written to: the command waits for it, in the middle of its work, until it is interrupted.
    pipe = tmp_path / "endless.json"
    os.mkfifo(pipe)
    files = (folder / "chair.obj", "--field", folder / "chair.field.safetensors")
    with dfd_process("deform", *files, "--edit", pipe, "-o", tmp_path / "out.obj") as process:
        writer = None
        while writer is None:
            assert process.poll() is None, process.stderr.read()
            try:
                writer = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)  # refused until the command has opened it
            except OSError:
                time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        output, error = process.communicate(timeout=60)
        os.close(writer)
    assert process.returncode == 130
    assert error.splitlines()[-1] == "dfd: interrupted"
    assert "Traceback" not in error
    assert output == ""
    assert list(tmp_path.iterdir()) == [pipe]
