"""Test key poses, which are part of an edit and of its file."""

import json

import pytest

import dfd
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit, Handle
from dfd.editing.edit_file import from_document, read_edit, to_document, write_edit
from dfd.editing.points import place_on
from dfd.posing.transforms import Transform


@pytest.fixture
def edit(mesh):
    turned = Transform(rotation=(0, 90, 0), pivot=(0, 0, 1), pivot_at="base", bend=(0, 0, 5), joint=0.5)
    poses = (dfd.KeyPose(0, {1: Transform((0, 1, 0))}, "up", ease=True), dfd.KeyPose(1.5, {1: Transform(), 3: turned}))
    return Edit((Handle(1, place_on(mesh, 4)), Handle(3, place_on(mesh, 2))), poses=poses)


def test_one_file_holds_handles_and_key_poses(edit, mesh, tmp_path):
    write_edit(tmp_path / "edit.json", edit, mesh)
    assert read_edit(tmp_path / "edit.json", mesh) == edit
    assert hash(read_edit(tmp_path / "edit.json", mesh)) == hash(edit)


def test_a_pose_by_hand_is_short(edit, mesh):
    document = to_document(edit, mesh) | {"poses": [{"seconds": 1, "transforms": [{"handle": 3, "scale": 2}]}]}
    assert from_document(document, mesh).poses == (dfd.KeyPose(1, {3: Transform(scale=(2, 2, 2))}),)


def set_at(path, value):
    def change(document):
        *steps, last = path
        for step in steps:
            document = document[step]
        document[last] = value

    return change


OWN = ["poses", 0, "transforms", 0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_at(["poses", 0, "seconds"], -1), r"`poses\[0\].seconds` must be at least 0, got -1"),
        (set_at([*OWN, "handle"], 9), r"`poses\[0\].transforms` must use handles of the edit \(1, 3\), got handle 9"),
        (set_at([*OWN, "axes"], [[1, 0, 0]] * 3), r"`poses\[0\].transforms\[0\].axes` must be 3 unit vectors"),
        (lambda document: document["poses"][0]["transforms"][0].pop("handle"), r"transforms\[0\].handle` is missing"),
        (
            lambda document: document["poses"][0]["transforms"].extend([{"handle": 3}] * 2),
            r"`poses\[0\].transforms` must have each handle once, got handle 3 twice",
        ),
    ],
)
def test_bad_poses_in_a_file_are_named(change, message, edit, mesh):
    document = json.loads(json.dumps(to_document(edit, mesh)))
    change(document)
    with pytest.raises(ValueError, match=message):
        from_document(document, mesh)


def test_a_removed_handle_leaves_the_poses_and_undo_brings_it_back(edit, mesh, field):
    session = Deformer(mesh, field)
    session.apply(edit)
    session.remove(3)
    assert [list(pose.transforms) for pose in session.edit.poses] == [[1], [1]]
    session.undo()
    assert session.edit == edit
    session.set_poses(edit.poses[:1])
    assert session.edit.poses == edit.poses[:1]
    assert session.undo()
    with pytest.raises(
        ValueError, match=r"`poses\[0\].transforms` must use handles of the edit \(1, 3\), got handle 7"
    ):
        session.set_poses([dfd.KeyPose(0, {7: Transform()})])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1,), "KeyPose: `seconds` must be at least 0, got -1"),
        ((0, [1]), "KeyPose: `transforms` must be a mapping, got list"),
        ((0, {"leg": Transform()}), "KeyPose: `transforms` must be a whole number, got 'leg'"),
        ((0, {1: (0, 1, 0)}), r"KeyPose: `transforms` must hold transforms or matrices \(3, 4\), got tuple"),
        ((0, {0: Transform()}), "KeyPose: `transforms` must be a whole number of at least 1, got 0"),
        ((0, {}, "\ud800"), "KeyPose: `name` must be text that can be written to a file"),
    ],
)
def test_bad_poses_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        dfd.KeyPose(*arguments)


def test_a_pose_eases_or_not():
    assert dfd.KeyPose(1, ease=True) != dfd.KeyPose(1)
    assert dfd.KeyPose(1, {1: Transform()}, ease=True).without(1) == dfd.KeyPose(1, ease=True)
    with pytest.raises(ValueError, match="KeyPose: `ease` must be True or False, got 'in'"):
        dfd.KeyPose(1, ease="in")
