"""Test the poses between key poses: files and the timeline of the app show the same motion."""

import json
from pathlib import Path

import numpy as np
import pytest
from gltf_reader import Glb
from scipy.spatial.transform import Rotation, Slerp

import dfd
from dfd.export.key_poses import MOST_STEPS, STEP, Step, between, with_steps
from dfd.posing.transforms import Transform

MOMENTS = Path(__file__).parents[3] / "python/dfd/app/client/tests/unit/moments.json"  # a test of the page reads it


def test_poses_between_are_those_of_the_timeline():
    shared = json.loads(MOMENTS.read_text("utf-8"))
    poses = [
        dfd.KeyPose(
            each["seconds"],
            {one.pop("handle"): Transform(**one) for one in each["transforms"]},
            each["name"],
            each.get("ease", False),
        )
        for each in shared["poses"]
    ]
    written = list(with_steps(poses))
    assert [each for each in written if not isinstance(each, Step)] == poses
    for moment in shared["moments"]:
        (found,) = (each for each in written if abs(each.seconds - moment["seconds"]) < 1e-9)
        for handle, wanted in moment["transforms"].items():
            one, other = found.transforms[int(handle)], Transform(**wanted)
            for name in ("translation", "rotation", "scale", "bend", "twist", "pivot"):
                np.testing.assert_allclose(getattr(one, name) or 0, getattr(other, name) or 0, atol=1e-9)
            assert (one.axes, one.pivot_at, one.joint) == (other.axes, other.pivot_at, other.joint)


def test_small_and_huge_rotations_need_few_poses():
    def count(*degrees):
        return len(list(with_steps([dfd.KeyPose(0), dfd.KeyPose(1, {1: Transform(rotation=degrees)})])))

    near = [dfd.KeyPose(1000), dfd.KeyPose(1000.0002, {1: Transform(rotation=(0, 350, 0))})]
    assert (np.diff(np.array([each.seconds for each in with_steps(near)], np.float32)) > 0).all()
    assert [count(60, 0, 0), count(61, 0, 0), count(0, 270, 0), count(0, 0, 1e9)] == [2, 3, 6, MOST_STEPS + 1]


def test_a_viewer_turns_between_poses_of_a_file_as_the_timeline_does():
    random = np.random.default_rng(0)
    for _ in range(200):
        one, change = random.uniform(-300, 300, 3), random.normal(size=3)
        ends = [Transform(rotation=one), Transform(rotation=one + STEP * change / np.linalg.norm(change))]
        turns = Slerp([0, 1], Rotation.from_rotvec([each.rotation for each in ends], degrees=True))
        middle = Rotation.from_rotvec(between(*ends, 0.5).rotation, degrees=True)
        assert np.degrees((turns(0.5).inv() * middle).magnitude()) < 3


@pytest.mark.parametrize("ease", [False, True])
def test_a_key_of_270_degrees_turns_by_270_degrees(session, tmp_path, ease):
    handle = session.add(40)
    poses = [dfd.KeyPose(0, ease=ease), dfd.KeyPose(6, {handle: Transform(rotation=(0, 270, 0))}, ease=ease)]
    dfd.export_rig(session, tmp_path / "rig.glb", influences="all", poses=poses)
    glb, angles = Glb(tmp_path / "rig.glb"), []
    for channel in glb.file.animations[0].channels:
        sampler = glb.file.animations[0].samplers[channel.sampler]
        if channel.target.path == "rotation":
            keys = Rotation.from_quat(glb.read(sampler.output).reshape(6, -1, 4)[:, int(ease)])
            angles.append((keys[:-1].inv() * keys[1:]).as_rotvec(degrees=True).sum(axis=0))
    assert np.abs(np.linalg.norm(angles, axis=1) - 270).max() < 1e-3
