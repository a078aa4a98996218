"""What was done, as Python and as a command: both make the same shape."""

from __future__ import annotations

import json
import shlex
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from app_page import Shape
from made_field import made_field
from skinned_figure import skinned_figure

import dfd
from dfd.app.options import Source
from dfd.app.protocol.parts import KeyPose, PoseTransform
from dfd.app.session.exports import Kind, export, file_stem
from dfd.app.session.script import as_command, as_python
from dfd.cli import main
from dfd.editing.deformer import Deformer


def one_handle(deformer: Deformer) -> None:
    deformer.add(5, translation=(0, -0.3, 0.1), rotation=(0, 20, 0), scale=(1, 2, 1), pivot=(0, 0.5, 0), locality=2.0)
    deformer.fix(900)


def several(deformer: Deformer) -> None:
    one_handle(deformer)
    deformer.fix((-0.1, 0.5, 0.0))
    deformer.add((-0.2, 0.9, 0.1), scale=1.5, name='the "back"')
    deformer.set_symmetry("x")
    deformer.set_default(rotation=(0, 5, 0))


def nothing(deformer: Deformer) -> None:
    pass


def negative(deformer: Deformer) -> None:
    deformer.add((-0.2, 0.9, 0.1), translation=(-0.1, -0.2, -1e-7))


def controls(deformer: Deformer) -> None:
    deformer.add(5, translation=(0, -0.3, 0), reach=0.6, falloff="smooth", strength=0.5, radius="50%")
    deformer.fix(900, strength=0.25)
    deformer.overlap = "normalize"


def regions(deformer: Deformer) -> None:
    deformer.add(np.arange(50), translation=(0, -0.3, 0))
    deformer.fix(np.arange(300, 350))


def paper(deformer: Deformer) -> None:
    deformer.preset = "paper"
    one_handle(deformer)


def paper_with_more(deformer: Deformer) -> None:
    paper(deformer)
    deformer.add(600, reach=0.6, translation=(0, 0.1, 0))
    deformer.reach_targets = True
    deformer.set_symmetry("x")


EDITS = [controls, regions, one_handle, several, nothing, negative, paper, paper_with_more]


@pytest.fixture
def beside(shape: Shape, deformer: Deformer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as a person would have it, and the process in it."""
    (tmp_path / "chair.glb").write_bytes(shape.mesh.read_bytes())
    (tmp_path / "chair.field.safetensors").write_bytes(shape.field.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("edit", EDITS)
def test_the_python_makes_the_same_shape(edit: Callable[[Deformer], None], deformer: Deformer, beside: Path) -> None:
    edit(deformer)
    deformer.save(beside / "chair_edit.json")
    exec(as_python(deformer, "chair.glb"), {})
    made = dfd.load(beside / "chair_edited.glb")
    np.testing.assert_allclose(made.vertices, deformer.vertices, atol=2e-6)


@pytest.mark.parametrize("edit", EDITS)
def test_the_command_makes_the_same_shape(edit: Callable[[Deformer], None], deformer: Deformer, beside: Path) -> None:
    edit(deformer)
    deformer.save(beside / "chair_edit.json")
    program, *arguments = shlex.split(as_command(deformer, "chair.glb"))
    assert program == "dfd"
    with pytest.raises(SystemExit) as done:
        main(arguments)
    assert done.value.code == (1 if edit is nothing else 0)  # what moves nothing is written, and said
    made = dfd.load(beside / "chair_edited.glb")
    np.testing.assert_allclose(made.vertices, deformer.vertices, atol=2e-6)


def test_one_handle_needs_no_file(deformer: Deformer) -> None:
    one_handle(deformer)
    assert "--edit" not in as_command(deformer, "chair.glb")
    deformer.preset = "paper"
    assert "--preset paper --handle=5" in as_command(deformer, "chair.glb")
    assert "Deformer(mesh, field, preset='paper')" in as_python(deformer, "chair.glb")


def test_a_name_with_quotes_stays_one_word(deformer: Deformer) -> None:
    name = "my \"chair\"; rm -rf '$HOME'.glb"
    deformer.add(5, name='"); import os; ("')
    assert shlex.split(as_command(deformer, name))[2] == name
    compile(as_python(deformer, name), "script", "exec")
    assert file_stem(name) == "my_chair_rm_-rf_HOME"


@pytest.mark.parametrize("kind", ["glb", "obj", "ply", "stl"])
def test_an_export_is_the_kernels_shape(kind: Kind, deformer: Deformer, tmp_path: Path) -> None:
    several(deformer)
    folder = tmp_path / ("0" * 32)
    url, name, _ = export(deformer, kind, "chair.glb", folder)
    assert name == f"chair_edited.{kind}"
    (file,) = (folder / "exports" / url.rsplit("/", 1)[1]).iterdir()
    made = dfd.load(file)
    atol = 1e-5 if kind == "stl" else 2e-6
    np.testing.assert_allclose(made.vertices[made.faces], deformer.vertices[deformer.mesh.faces], atol=atol)


def test_rigs_targets_and_weights_are_written_beside_the_shapes(deformer: Deformer, tmp_path: Path) -> None:
    deformer.add(5, translation=(0, -0.3, 0.1), bend=30)
    kinds: tuple[Kind, ...] = ("rig", "morph", "weights")
    headers = []
    for kind, ending in zip(kinds, ("_rig.glb", "_morph.glb", "_weights.npz"), strict=True):
        url, name, said = export(deformer, kind, "chair.glb", tmp_path / ("0" * 32))
        assert ("bent or twisted is not in a skin" in said) == (kind == "rig")
        assert name == f"chair{ending}"
        file = tmp_path / ("0" * 32) / "exports" / url.rsplit("/", 1)[1] / name
        headers.append(file.read_bytes())
    assert b'"skins"' in headers[0]
    assert b'"targets"' in headers[1]
    file.write_bytes(headers[2])
    with np.load(file) as arrays:
        assert arrays["weights"].shape[0] == len(deformer.mesh.vertices)


def test_the_files_of_a_command_are_all_that_it_needs(
    deformer: Deformer, shape: Shape, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    regions(deformer)
    source = Source(name="chair.glb", path=shape.mesh)
    url, name, _ = export(deformer, "files", "chair.glb", tmp_path / ("0" * 32), source=source)
    assert name == "chair_files.zip"
    with zipfile.ZipFile(tmp_path / ("0" * 32) / "exports" / url.rsplit("/", 1)[1] / name) as archive:
        archive.extractall(tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as done:
        main(shlex.split(as_command(deformer, "chair.glb"))[1:])
    assert done.value.code == 0
    np.testing.assert_allclose(dfd.load("chair_edited.glb").vertices, deformer.vertices, atol=2e-6)


def test_edit_and_field_can_be_taken_along(deformer: Deformer, tmp_path: Path) -> None:
    several(deformer)
    folder = tmp_path / ("0" * 32)
    for kind, ending in (("edit", "_edit.json"), ("field", ".field.safetensors")):
        url, name, _ = export(deformer, kind, "../../chair.glb", folder)
        assert name == f"chair{ending}"
        (file,) = (folder / "exports" / url.rsplit("/", 1)[1]).iterdir()
        if kind == "edit":
            assert Deformer.load(file, deformer.mesh, deformer.field).edit == deformer.edit
        else:
            np.testing.assert_array_equal(dfd.Field.load(file)([[0, 0, 0]]), deformer.field([[0, 0, 0]]))


def test_key_poses_become_an_animation(deformer: Deformer, tmp_path: Path) -> None:
    handle = deformer.add(5)
    deformer.add(40, translation=(0.1, 0, 0))
    rest, up = (
        PoseTransform(handle=handle, translation=(0, y, 0), rotation=(0, 0, 0), scale=(1, 1, 1)) for y in (0.0, 0.5)
    )
    gone = PoseTransform(handle=99, translation=(9, 9, 9), rotation=(0, 0, 0), scale=(1, 1, 1))
    poses = [KeyPose(name="a", seconds=0, transforms=(rest, gone)), KeyPose(name="b", seconds=2, transforms=(up,))]
    url, name, _ = export(deformer, "animation", "chair.glb", tmp_path / "session", poses)
    assert name == "chair_poses.glb"
    (file,) = (tmp_path / "session" / "exports" / url.rsplit("/", 1)[1]).iterdir()
    data = file.read_bytes()
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    inputs = {sampler["input"] for sampler in header["animations"][0]["samplers"]}
    assert [header["accessors"][each]["max"] for each in inputs] == [[2.0]]


def test_a_shape_on_joints_of_its_own_moves_by_morph_targets(tmp_path: Path) -> None:
    (tmp_path / "figure.glb").write_bytes(skinned_figure())
    mesh = dfd.load(tmp_path / "figure.glb")
    deformer = Deformer(mesh, made_field(8, center=mesh.bounds.mean(axis=0), scale=2 / max(mesh.extents)))
    handle = deformer.add(0)
    poses = [
        KeyPose(
            name=f"{seconds}",
            seconds=seconds,
            transforms=(
                PoseTransform(handle=handle, translation=(0, seconds / 4, 0), rotation=(0, 0, 0), scale=(1, 1, 1)),
            ),
        )
        for seconds in (0, 1)
    ]
    url, _, said = export(deformer, "animation", "figure.glb", tmp_path / "session", poses)
    (file,) = (tmp_path / "session" / "exports" / url.rsplit("/", 1)[1]).iterdir()
    data = file.read_bytes()
    header = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert {each["target"]["path"] for each in header["animations"][-1]["channels"]} == {"weights"}
    moved = any("targets" in primitive for each in header["meshes"] for primitive in each["primitives"])
    assert moved, "the shape moves by targets, and keeps its joints"
    assert "skins" in header
    assert said.startswith("3 morph targets")


def test_an_animation_needs_two_poses_at_two_moments(deformer: Deformer, tmp_path: Path) -> None:
    deformer.add(5)
    pose = KeyPose(name="a", seconds=1, transforms=())
    with pytest.raises(ValueError, match="^Store at least two poses on the timeline"):
        export(deformer, "animation", "chair.glb", tmp_path / "session", [pose])
    with pytest.raises(ValueError, match="must come one after the other in time"):
        export(deformer, "animation", "chair.glb", tmp_path / "session", [pose, pose])
    assert list((tmp_path / "session" / "exports").iterdir()) == []
