"""Test errors of `dfd deform`, and that it then writes nothing."""

from pathlib import Path
from unittest import mock

import pytest
from command_runs import failed, worked

import dfd

DEFORM = ("deform", "MESH", "--field", "FIELD")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--fix", 3), "`--handle` or `--edit` must be given"),
        (("--fix", 3, "--translate", 0, 0, 1), "`--handle` must be given with `--translate`"),
        (("--translate", 0, 0, 1, "--handle", 1), "`--translate` must follow the `--handle` to which it belongs"),
        (("--handle", 1, "--encoder", "dinov9"), "`--encoder` must be a folder that exists, a hub name"),
        (("--handle", 1, "--band", 0.1), "`--symmetry-…` need `--symmetry`"),
        (("--handle", "seat"), "`--handle` must be a vertex index, a point x,y,z, top, bottom"),
        (("--handle", "bottum"), "got 'bottum'; did you mean bottom?"),
        (("--handle", "500,500,500"), "`--handle` must lie near the shape, but 500,500,500 is"),
        (("--handle", 1, "--rotate", "90deg"), "`--rotate` needs 3 numbers, got 90deg"),
        (("--fix", 1, "--mask-feather", 1), "`--handle` must be given with `--mask-feather`"),
        (("--handle", 1, "--translate", 0, "5cm", 0), "`--translate` needs 3 numbers, got 1: 0, and 5cm is no number"),
        (("--translate", 0, 1, "--handle", 1), "`--translate` needs 3 numbers, got 2: 0 1"),
        (("--handle", 1, "--rotate", 90), "`--rotate` needs 3 numbers, got 1: 90"),
        (
            ("--handle", 1, "--translate", 0, "-5cm", 0),
            "`--translate` needs 3 numbers, got 1: 0, and -5cm is no number",
        ),
        (("--handle", 1, "--handle", 2, "--scale", 0), "`--scale` must not be 0"),
        (("--handle", 1, "--scale", 1, 2), "`--scale` needs 1 or 3 numbers, got 2: 1 2"),
        (("--handle", 1, "--scale"), "`--scale` needs 1 or 3 numbers, got none"),
        (("--handle", 1, "--radius", "far"), "`--radius` must be a length or a percentage such as 20%, got 'far'"),
        (("--handle", 1, "--radius", 1, "--locality", 1), "`--radius` and `--locality` must not be given both"),
        (("--handle", 1, "--zoom", 0), "'--zoom'"),
        (("--handle", 1, "--symmetry", "x=50"), "`--symmetry` must cut the shape"),
        (("--handle", 1, "--symmetry", "x", "--symmetry-candidates", "axes"), "`--symmetry` is 'auto', got 'x'"),
        (("--handle", 1, "--preset", "mine"), "'mine' is not one of 'default', 'paper'"),
        (("--handel", 1), "(see dfd deform --help)"),
    ],
)
def test_deform_names_what_is_wrong_and_writes_nothing(run, tmp_path, arguments, message):
    assert failed(run(*DEFORM, *arguments, "-o", "out.obj"), message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--handle", 999999999), "`--handle` must lie in 0 … 2003, got 999999999"),
        (("--handle", 1, "--fix", 10**6), "`--fix` must lie in 0 … 2003"),
        (("--handle", 1, "--fix", "2:1.5"), "`--fix` must be at most 1, got 1.5"),
        (("--handle", 1, "--handle", 1), "`handles` must lie at distinct places"),
        (("--handle", 1, "--translate", "0,5cm,0"), "`--translate` needs numbers, got 0,5cm,0, and 5cm is no number"),
        (("--handle", 1, "--scale", "1,2"), "`--scale` must be one number or 3"),
        (("--handle", 1, "--bend", "much"), "`--bend` must be a number"),
        (("--handle", 1, "--towards", "up"), "`--bend` must be given with `--towards`"),
        (("--handle", 1, "--bend", 9, "--towards", "there"), "`--towards` must be one of up"),
        (("--handle", 1, "--rotate", 0, 9, 0, "--pivot", "there"), "`--pivot` must be auto, "),
        (("--handle", 1, "--bend", 9, "--joint", "there"), "`--joint` must be spread, auto, here or"),
        (("--handle", 1, "--bend", 9, "--joint", 2), "`--joint` must be at most 1"),
        (("--handle", 1, "--locality", -1), "`--locality` must be at least 0"),
        (("--handle", 1, "--mask", "x>99"), "`--mask`"),
        (("--handle", 1, "--symmetry", "w"), "`--symmetry` must have the form x"),
        (("--handle", 1, "--symmetry", "auto", "--band", -1), "`--band` must be at least 0"),
        (("--handle", 1, "--symmetry", "auto", "--symmetry-candidates", "some"), "`--symmetry-candidates` must be one"),
        (("--handle", 1, "--symmetry", "auto", "--symmetry-threshold", -1), "`--symmetry-threshold` must be above 0"),
        (("--edit", "none.json"), "none.json does not exist"),
    ],
)
def test_what_needs_no_field_is_checked_before_one_is_distilled(run, tmp_path, monkeypatch, arguments, message):
    monkeypatch.setattr(dfd, "distill", mock.Mock(side_effect=AssertionError("distilled")))
    assert failed(run("deform", "MESH", *arguments, "-o", "out.obj"), message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "command", [("deform", "--handle", 1, "-o", "out.obj"), ("show", "-o", "out.png"), ("inspect",), ("parts",)]
)
def test_folders_and_formats_of_other_programs_get_advice(run, chair, command):
    chair.save("one.ply")
    Path("shape.FBX").write_bytes(b"Kaydara FBX Binary")
    name, *rest = command
    assert failed(
        run(name, ".", *rest), "`MESH` must be a file, but . is a folder: name one mesh in it, such as one.ply"
    )
    assert failed(run(name, "shape.FBX", *rest), "got shape.FBX: convert it to GLB, for example in Blender")


def test_deform_wants_something_to_write(run):
    assert failed(run(*DEFORM, "--handle", 1), "`--output`, `--picture` or `--save-edit` must be given")


@pytest.mark.parametrize(
    ("option", "path", "message"),
    [
        ("-o", "no/such/out.obj", "`--output`: the folder no/such does not exist"),
        ("-o", "out.dae", "`--output` must end in .obj, .ply, .stl, .off, .glb, .gltf, got out.dae"),
        ("--picture", "out.jpg", "`--picture` must end in .png, got out.jpg"),
        ("--picture", "no/out.png", "`--picture`: the folder no does not exist"),
        ("--save-edit", "no/edit.json", "`--save-edit`: the folder no does not exist"),
    ],
)
def test_outputs_are_checked_before_the_work(run, option, path, message, tmp_path):
    (tmp_path / "folder.obj").mkdir()
    # The mesh does not exist. The message names the output, so the output is checked first.
    result = run("deform", "none.obj", "--handle", 1, option, path)
    assert failed(result, message)


def test_a_folder_that_cannot_be_written_is_noticed_before_the_work(run, monkeypatch):
    def read_only(*_, **__):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("tempfile.TemporaryFile", read_only)
    result = run("deform", "none.obj", "--handle", 1, "-o", "out.obj")
    assert failed(result, "`--output`: out.obj cannot be written: Read-only file system")


@pytest.mark.parametrize("command", ["deform", "show"])
def test_a_field_of_a_shape_in_other_units_is_named(run, chair, command):
    chair.save("metres.obj", 0.01 * chair.vertices)
    rest = ("--handle", 1, "-o", "out.obj" if command == "deform" else "out.png")
    moves = ("--scale", 2) if command == "deform" else ()
    result = run(command, "metres.obj", "--field", "FIELD", *rest)
    sides = "a longest side of 0.9897 around (0, 0.526, -0.007948), and this mesh has a longest side of 0.009897 around"
    assert failed(result, sides)
    assert result.stderr.endswith("; `--force` accepts it anyway\n")
    assert [path.name for path in Path().iterdir()] == ["metres.obj"]
    assert worked(run(command, "metres.obj", "--field", "FIELD", *rest, *moves, "--force"))


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
