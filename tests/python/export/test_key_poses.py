"""Test key poses and the files that contain them."""

import json

import pytest
from mesh_files import write

import dfd
from dfd.export.key_poses import read_key_poses
from dfd.posing.transforms import Transform


def test_a_file_of_key_poses_is_read(tmp_path):
    one = {"handle": 3, "translation": [1, 2, 3], "rotation": [0, 90, 0], "scale": [1, 1, 2], "pivot": [0, 0, 1]}
    path = write(tmp_path / "poses.json", json.dumps([{"name": "up", "seconds": 1.5, "transforms": [one]}]))
    (pose,) = read_key_poses(path)
    transform = Transform(translation=(1, 2, 3), rotation=(0, 90, 0), scale=(1, 1, 2), pivot=(0, 0, 1))
    assert pose == dfd.KeyPose(1.5, {3: transform}, "up")


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ("{", "the file: invalid json"),
        ({}, "the file: input should be a valid"),
        ([{"transforms": []}], "0.seconds: field required"),
        ([{"seconds": -1, "transforms": []}], "0.seconds: input should be greater than or equal to 0, got -1"),
        ([{"seconds": 0, "transforms": [{"handle": 1, "turn": 3}]}], "0.transforms.0.turn: unexpected keyword"),
        ([{"seconds": 0, "transforms": [{"handle": 1, "axes": [[1, 0, 0]] * 3}]}], "`axes` must be 3 unit vectors"),
    ],
)
def test_bad_files_are_named(document, message, tmp_path):
    path = write(tmp_path / "poses.json", document if isinstance(document, str) else json.dumps(document))
    with pytest.raises(ValueError, match=message):
        read_key_poses(path)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1,), "KeyPose: `seconds` must be at least 0, got -1"),
        (("soon",), "KeyPose: `seconds` must be a number"),
        ((0, [1]), "KeyPose: `transforms` must be a mapping, got list"),
        ((0, {"leg": Transform()}), "KeyPose: `transforms` must be a whole number, got 'leg'"),
        ((0, {1: (0, 1, 0)}), "KeyPose: `transforms` must hold transforms, got tuple"),
    ],
)
def test_bad_poses_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        dfd.KeyPose(*arguments)
