"""Test what Blender shows of the files, if DFD_BLENDER_PYTHON names a Python that has bpy (`make test-blender`)."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from mesh_files import scene_of_three
from scipy.spatial import cKDTree

import dfd
from dfd.export.rig import rig_of
from dfd.posing.transforms import Transform, frame_of_normal

PYTHON = os.environ.get("DFD_BLENDER_PYTHON")
SHOWN = Path(__file__).parents[2] / "blender" / "shown.py"
pytestmark = pytest.mark.skipif(PYTHON is None, reason="DFD_BLENDER_PYTHON is not set (make test-blender sets it)")


def blender(path, frame=0):
    out = path.with_suffix(".npz")
    done = subprocess.run([PYTHON, SHOWN, path, out, str(frame)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    with np.load(out) as file:
        return dict(file)


def apart(one, other):
    one, other = one.reshape(-1, 9), other.reshape(-1, 9)
    return max(cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max())


def turned(session):
    session.add("bottom", translation=(0.1, -0.2, 0), rotation=(0, 20, 70), name="leg")


def scaled_along_a_normal(session):
    session.add("bottom", rotation=(30, 20, 0), scale=(1, 1, 2), axes=frame_of_normal((1, 1, 0)), pivot=(0, 0.2, 0))


def mirrored(session):
    session.add("bottom", translation=(0.1, -0.2, 0), rotation=(0, 20, 40), name="leg")
    session.set_symmetry("x", band=0.1)
    session.set_default(translation=(0, 0, 0.3), rotation=(0, 10, 0))


def several(session):
    for place in ("bottom", "top", "left", "front", 900, 40):
        given = {"translation": (0.1, 0.1, 0), "rotation": (20, 0, 0), "counterparts": "shared_pivot"}
        session.add(place, reach=2.0, strength=0.15, **given)


@pytest.mark.parametrize("edit", [turned, scaled_along_a_normal, mirrored, several])
def test_what_is_not_pruned_is_where_pose_puts_it(edit, session, tmp_path):
    edit(session)
    report = dfd.export_rig(session, tmp_path / "rig.glb", influences="all")
    found = blender(tmp_path / "rig.glb")
    faces, size = session.mesh.faces, session.mesh.diagonal
    assert np.abs(found["triangles"] - session.vertices[faces]).max() < 1e-4 * size
    assert np.abs(found["rest"] - session.mesh.vertices[faces]).max() < 1e-6 * size
    assert len(found["bones"]) == report.joints
    assert set(found["groups"]) <= set(found["bones"])
    assert "root" in found["bones"]


def test_parts_of_a_scene_follow_one_armature(tmp_path, make_session):
    session = make_session(dfd.load(scene_of_three(tmp_path)))
    session.add(3, translation=(0, 0.1, 0), rotation=(0, 40, 0), counterparts="shared_pivot")
    dfd.export_rig(session, tmp_path / "rig.glb")
    found = blender(tmp_path / "rig.glb")
    assert apart(found["triangles"], session.vertices[session.mesh.faces]) < 1e-4 * session.mesh.diagonal
    assert sorted(found["bones"]) == ["handle 1", "root"]


def test_morph_targets_are_shape_keys(session, tmp_path):
    turned(session)
    session.add("top", translation=(0, 0.3, 0), name="back", counterparts="shared_pivot")
    dfd.export_rig(session, tmp_path / "morph.glb", form="morph")
    found = blender(tmp_path / "morph.glb")
    assert np.abs(found["triangles"] - session.vertices[session.mesh.faces]).max() < 1e-4 * session.mesh.diagonal
    assert sorted(found["keys"]) == ["Basis", "back", "leg"]


def test_key_poses_are_an_action(session, tmp_path):
    turned(session)
    poses = [dfd.KeyPose(0), dfd.KeyPose(1, {1: Transform(rotation=(0, 100, 0), translation=(0, 0.3, 0))})]
    dfd.export_rig(session, tmp_path / "rig.glb", influences="all", poses=poses)
    found = blender(tmp_path / "rig.glb", frame=24)  # Blender shows 24 frames per second
    assert len(found["actions"]) == 1
    rig = rig_of(session, poses)  # its blend bands are those that all poses need
    *_, (_, edit) = rig.moments()
    assert np.abs(found["triangles"] - rig.posed(edit)[session.mesh.faces]).max() < 1e-4 * session.mesh.diagonal
