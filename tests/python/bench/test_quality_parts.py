"""The quality bench's parts, from the names and the weights in a skinned file."""

from __future__ import annotations

import numpy as np
import pytest
from skinned_figure import skinned_figure

from bench.quality.__main__ import settings_of
from bench.quality.parts import label_vertices, merged, only, sides_as_one
from bench.quality.report import as_csv, as_markdown
from bench.quality.shapes import characters
from bench.quality.studies import Row
from dfd import Mesh
from dfd.mesh.appearance import Appearance, Material


@pytest.mark.parametrize(
    ("joint", "kind"),
    [
        ("upperarm.l", "upperarm"),
        ("UpperArm_R", "upperarm"),
        ("LeftUpperArm", "upperarm"),
        ("mixamorig:RightHand", "mixamorig:hand"),
        ("UpperArmL", "upperarm"),
        ("lThigh", "thigh"),
        ("L_Thigh", "thigh"),
        ("finger_02_l", "finger"),
        ("hand.l.001", "hand"),
        ("Spine2", "spine"),
        ("lowerleg", "lowerleg"),
        ("pelvis", "pelvis"),
    ],
)
def test_a_joint_has_neither_side_nor_number(joint, kind):
    assert sides_as_one(joint) == kind


@pytest.mark.parametrize(
    ("joint", "part"),
    [
        ("Head", "head"),
        ("handslot.l", "hand"),
        ("lowerarm.r", "arm"),
        ("LeftForeArm", "arm"),
        ("control-toe-roll.l", "foot"),
        ("upperleg.l", "leg"),
        ("hips", "torso"),
        ("antenna", None),
    ],
)
def test_joints_fall_into_the_parts_of_a_character(joint, part):
    assert merged(joint) == part


def test_vertices_are_of_the_kind_of_their_joint_and_others_of_none():
    labels, parts = label_vertices(["hand.l", None, "foot.l", "antenna"], merged)
    assert parts == ("foot", "hand")
    assert labels.tolist() == [1, -1, 0, -1]


def test_a_part_of_a_mesh_keeps_its_looks():
    corners = np.arange(6, dtype=np.int32) % 4
    looks = Appearance(
        corners=corners,
        corner_faces=np.array([(0, 1, 2), (3, 4, 5)], np.int32),
        face_material=np.array([0, 1], np.int32),
        materials=(Material(), Material((1.0, 0.0, 0.0, 1.0))),
    )
    vertices = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)])
    mesh = Mesh(vertices, np.array([(0, 1, 2), (3, 0, 1)]), appearance=looks)
    part, old = only(mesh, np.array([True, True, False, True]))
    assert old.tolist() == [0, 1, 3]
    assert part.vertices.tolist() == vertices[[0, 1, 3]].tolist()
    assert part.faces.tolist() == [[2, 0, 1]]
    assert part.appearance is not None
    assert part.appearance.corners.tolist() == [-1, -1, -1, 2, 0, 1]
    red = part.appearance.albedo(np.array([0]), np.array([(1, 0, 0)]))
    assert red.tolist() == [[1, 0, 0, 1]]


def test_a_skinned_file_is_read_whole_and_without_what_only_hangs_on_a_bone(tmp_path):
    (tmp_path / "figure.glb").write_bytes(skinned_figure())
    told = []
    found = list(characters(tmp_path, told.append))
    assert told == []
    assert [shape.name for shape in found] == [
        "figure, merged names",
        "figure without accessories, merged names",
        "figure, rig names",
        "figure without accessories, rig names",
    ]
    whole, bare, rig, _ = found
    assert whole.parts == ("arm", "head")
    assert rig.parts == ("head", "upperarm")
    # the skin is moved by its node to x = 5; the fourth weight of its second vertex sits in another set of joints
    by_place = {tuple(place): label for place, label in zip(whole.mesh.vertices.tolist(), whole.labels, strict=True)}
    assert by_place == {
        (5.0, 0.0, 0.0): 0,
        (6.0, 0.0, 0.0): 1,
        (5.0, 1.0, 0.0): 0,
        (0.0, 0.0, 3.0): -1,
        (1.0, 0.0, 3.0): -1,
        (0.0, 1.0, 3.0): -1,
    }
    assert sorted(map(tuple, bare.mesh.vertices.tolist())) == [(5, 0, 0), (5, 1, 0), (6, 0, 0)]
    assert (bare.labels >= 0).all()


def test_a_damaged_skin_is_told_and_left_out(tmp_path):
    (tmp_path / "figure.glb").write_bytes(skinned_figure(weights=b""))
    told = []
    assert list(characters(tmp_path, told.append)) == []
    (line,) = told
    assert line.startswith("figure.glb: load:")
    assert line.endswith("accessor 3 has 3 items up to byte 48 of 0")


def test_settings_are_read_from_words():
    assert settings_of(["steps=300 framing=paper", "simplify_to=None"]) == {
        "steps": 300,
        "framing": "paper",
        "simplify_to": None,
    }
    with pytest.raises(ValueError, match="name=value, got 'steps'"):
        settings_of(["steps"])
    with pytest.raises(ValueError, match="there is no setting 'stepps'"):
        settings_of(["stepps=3"])


def test_tables_hold_every_row_and_leave_empty_what_does_not_apply():
    rows = [
        Row("methods", "chair", "dfd", {"precision": 0.75, "moving": 0.5}),
        Row("methods", "chair", "peer", note="takes | long"),
        Row("seeds", "spot", "seed 1", {"symmetry error": 0.125}),
    ]
    assert as_csv(rows).splitlines() == [
        "study,shape,setting,precision,precision ±,ratio,moving,symmetry error,Dirichlet energy,off the first,note",
        "methods,chair,dfd,0.75,,,0.5,,,,",
        "methods,chair,peer,,,,,,,,takes | long",
        "seeds,spot,seed 1,,,,,0.125,,,",
    ]
    page = as_markdown(rows, "Settings.")
    assert "| shape | setting | precision | moving | note |" in page
    assert "| chair | peer |  |  | takes / long |" in page
    assert "| spot | seed 1 | 0.125 |" in page
