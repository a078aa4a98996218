"""Test `dfd show`."""

from pathlib import Path

import numpy as np
import pytest
from command_runs import drawn, failed, worked

import dfd
from dfd.pictures.viewpoint import ASIDE, azimuth_towards


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


def test_show_makes_a_sheet_of_handles_and_sides(run):
    handles = ("--handle", 40, "--handle", "0.1,0.2,0.3")
    arguments = ("--views", 3, "--resolution", 64, "--locality", 2, "-o", "sheet.png")
    assert worked(run("show", "MESH", "--field", "FIELD", *handles, *arguments))
    height, width, _ = drawn("sheet.png").shape
    assert width > 3 * 64
    assert height > 2 * 64


def test_a_handle_is_shown_from_its_own_side(chair):
    middle = chair.bounds.mean(axis=0)
    assert azimuth_towards(chair, [middle + [1, 5, 0]]) == pytest.approx(90 + ASIDE)
    assert azimuth_towards(chair, [middle + [0, 0, -1], middle + [1, 0, 0]]) == pytest.approx(135 + ASIDE)
    assert azimuth_towards(chair, []) == ASIDE


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--field", "FIELD", "--fix", 1), "`--handle` must be given with `--fix` and the controls"),
        (("--field", "FIELD", "--handle", 10**6), "`--handle` must lie in 0 … 2003"),
        (("--field", "FIELD", "--handle", 1, "--handle", 1), "`handles` must lie at distinct places"),
        (("--field", "FIELD", "--handle", 1, "--locality", -1), "`--locality` must be at least 0"),
        (("--views", 0), "--views"),
        (("--resolution", 1), "--resolution"),
        (("--elevation", "inf"), "'--elevation'"),
    ],
)
def test_show_names_what_is_wrong(run, tmp_path, arguments, message):
    assert failed(run("show", "MESH", "-o", "out.png", *arguments), message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["show", "export"])
def test_the_field_comes_from_the_cache(run, folder, monkeypatch, command):
    asked = []

    def distilled(mesh, encoder, **how):
        asked.append((encoder, how["preset"]))
        return dfd.Field.load(folder / "chair.field.safetensors")

    monkeypatch.setattr(dfd, "distill", distilled)
    move = ("--handle", 40, "--translate", 0, 0.2, 0, "--save-edit", "edit.json")
    assert worked(run("deform", "MESH", "--field", "FIELD", *move))
    arguments = {"show": ("--handle", 40, "--resolution", 64), "export": ("--edit", "edit.json")}[command]
    names = {"show": ("out.png", "wanted.png"), "export": ("out.glb", "wanted.glb")}[command]
    for name, field in zip(names, ((), ("--field", "FIELD")), strict=True):
        assert worked(run(command, "MESH", *arguments, *field, "-o", name))
    assert asked == [("dinov2-small-focus", "default")]
    assert Path(names[0]).read_bytes() == Path(names[1]).read_bytes()


@pytest.mark.parametrize("control", [("--reach", 0.3), ("--locality", 6), ("--mask", "x>0"), ("--fix", "900:0.3")])
def test_controls_show_in_the_heat(run, chair, control):
    top = int(chair.vertices[:, 1].argmax())
    handle = ("--handle", top, "--reach", 0.7)
    show = ("show", "MESH", "--field", "FIELD", *handle, "--azimuth", 30, "--resolution", 64, "-o")
    assert worked(run(*show, "plain.png"))
    assert worked(run(*show, "other.png", *control))
    assert np.abs(drawn("plain.png") - drawn("other.png")).max() > 20


def test_axes_zoom_and_the_scale_of_the_heat(run):
    show = ("show", "MESH", "--field", "FIELD", "--handle", 40, "--resolution", 160, "--azimuth", 0, "-o")
    assert worked(run(*show, "plain.png"))
    plain = drawn("plain.png")
    for option in (("--axes",), ("--zoom", 2)):
        assert worked(run(*show, "other.png", *option))
        assert np.abs(plain - drawn("other.png")).max() > 50
    assert worked(run(*show, "legend.png", "--legend"))
    legend = drawn("legend.png")
    np.testing.assert_array_equal(legend[:, :160], plain)
    assert legend.shape[1] > 160
    assert legend[:, 160:].std() > 10
    assert failed(run("show", "MESH", "--legend", "-o", "none.png"), "`--legend` needs `--handle`")
