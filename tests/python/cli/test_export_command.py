"""Test `dfd export`."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_runs import failed, worked

import dfd

EXPORT = ("export", "MESH", "--field", "FIELD", "--edit", "edit.json")


@pytest.fixture
def edited(run):
    deform = ("deform", "MESH", "--field", "FIELD", "--handle", 40, "--translate", 0, 0.2, 0, "--name", "leg")
    assert worked(run(*deform, "--counterparts", "shared_pivot", "--save-edit", "edit.json"))


@pytest.mark.usefixtures("edited")
def test_a_rig_and_weights_are_written(run, folder):
    result = run(*EXPORT, "-o", "rig.glb", "--weights", "weights.npz")
    assert worked(result)
    assert "rig.glb: 2 joints, up to 2 for a vertex; no deviation from dfd.pose" in result.stderr
    assert "weights.npz: weights of 1 handle\n" in result.stderr
    with np.load("weights.npz") as file:
        assert file["weights"].shape[1] == 1
    assert dfd.load("rig.glb").faces.shape == dfd.load(folder / "chair.obj").faces.shape


@pytest.mark.usefixtures("edited")
def test_a_preset_takes_the_place_of_what_the_edit_says(run, folder, chair):
    assert worked(run(*EXPORT, "--weights", "edit.npz"))
    assert worked(run(*EXPORT, "--weights", "paper.npz", "--preset", "paper"))
    features = dfd.Field.load(folder / "chair.field.safetensors").features(chair)
    with np.load("edit.npz") as edit, np.load("paper.npz") as paper:
        np.testing.assert_allclose(paper["weights"], dfd.bind(features, [40]), atol=1e-6)
        assert np.abs(edit["weights"] - paper["weights"]).max() > 0.05
    assert failed(run(*EXPORT, "-o", "rig.glb", "--preset", "papers"), "'papers' is not one of 'default', 'paper'")


@pytest.mark.usefixtures("edited")
def test_forms_influences_and_poses(run, tmp_path):
    pose = {"seconds": 1, "transforms": [{"handle": 1, "rotation": [0, 90, 0]}]}
    edit = json.loads((tmp_path / "edit.json").read_text())
    (tmp_path / "poses.json").write_text(json.dumps(edit | {"poses": [{"seconds": 0, "transforms": []}, pose]}))
    result = run(*EXPORT, "-o", "morph.glb", "--as", "morph", "--poses", "poses.json")
    assert worked(result)
    assert "4 morph targets" in result.stderr
    own = [*EXPORT[:-1], "poses.json"]
    assert "4 morph targets" in run(*own, "-o", "own.glb", "--as", "morph").stderr
    assert worked(run(*own, "-o", "still.obj", "--as", "baked")), "a shape that does not move leaves the poses out"
    assert worked(run(*EXPORT, "-o", "moved.off", "--as", "baked"))
    result = run(*EXPORT, "-o", "rig.glb", "--influences", "1")
    assert worked(result)
    assert "up to 1 for a vertex; maximum deviation from dfd.pose:" in result.stderr


@pytest.mark.usefixtures("edited")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "`--output` or `--weights` must be given: otherwise nothing is kept"),
        (("-o", "rig.dae"), "`--output` must end in .glb, .gltf"),
        (("-o", "rig.obj"), "`--output` must end in .glb, .gltf"),
        (("-o", "rig.glb", "--as", "bones"), "'bones' is not one of 'skin', 'morph', 'baked'"),
        (("-o", "rig.glb", "--influences", "0"), "`--influences` must be a whole number of at least 1, or all, got 0"),
        (("-o", "missing/rig.glb"), "`--output`: the folder missing does not exist"),
        (("--weights", "weights.csv"), "`--weights` must end in .npz, .safetensors"),
    ],
)
def test_mistakes_are_one_line(arguments, message, run):
    assert failed(run(*EXPORT, *arguments), message)


@pytest.mark.usefixtures("edited")
def test_a_folder_keeps_the_name_and_messages_name_the_options(run, folder):
    Path("out").mkdir()
    assert worked(run(*EXPORT, "-o", "out"))
    assert dfd.load("out/chair.glb").faces.shape == dfd.load(folder / "chair.obj").faces.shape
    edit = json.loads(Path("edit.json").read_text())
    Path("poses.json").write_text(json.dumps(edit | {"poses": [{"seconds": 1, "transforms": []}]}))
    baked = run(*EXPORT, "-o", "moved.obj", "--as", "baked", "--poses", "poses.json")
    assert failed(baked, "dfd: `--poses` must be left out for 'baked', which does not move")
