"""Test the arguments of `dfd.export_rig`, and check its files with the Khronos validator."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from made_field import field_of
from mesh_files import checkered, scene_of_three, write
from scipy.spatial import KDTree

import dfd
from dfd.posing.transforms import Transform

VALIDATOR = Path(__file__).parents[2] / "validator"


@pytest.fixture(scope="module")
def validated():
    """Return the errors and warnings of the validator about a file."""
    if shutil.which("node") is None:
        pytest.skip("Node is not installed: no file was validated")
    if not (VALIDATOR / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("the validator is not installed (npm ci in tests/validator): no file was validated")

    def run(path):
        done = subprocess.run(
            ["node", VALIDATOR / "validate.mjs", path], check=True, capture_output=True, text=True, cwd=VALIDATOR
        )
        return json.loads(done.stdout)[str(path)]

    return run


def chair(folder):
    path = folder / "chair.obj"
    dfd.samples.chair(4000).mesh.save(path)
    return path


def painted_without_coordinates(folder):
    """Write a square with two materials. One has a texture, but its corners have no texture coordinates."""
    checkered(folder / "paint.png")
    write(folder / "two.mtl", "newmtl paint\nmap_Kd paint.png\nnewmtl blue\nKd 0 0 1\n")
    square = "mtllib two.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl paint\nf 1 2 3\nusemtl blue\nf 1 3 4\n"
    return write(folder / "square.obj", square)


SHAPES = {"chair": chair, "without coordinates": painted_without_coordinates, "parts": scene_of_three}


@pytest.mark.parametrize("name", SHAPES)
def test_the_khronos_validator_finds_no_error_and_no_warning(name, validated, tmp_path, make_session):
    session = make_session(dfd.load(SHAPES[name](tmp_path)))
    size = session.mesh.diagonal
    ends = session.mesh.vertices[:, 0].argmin(), session.mesh.vertices[:, 1].argmax()
    one, _ = (session.add(int(end), translation=(0, 0.1 * size, 0), counterparts="shared_pivot") for end in ends)
    session.set_symmetry("x")
    poses = [dfd.KeyPose(0), dfd.KeyPose(1, {one: Transform(rotation=(0, 90, 10), scale=(1, 2, 1))})]
    for form in ("skin", "morph"):
        dfd.export_rig(session, tmp_path / f"{form}.glb", form=form, poses=poses)
        assert validated(tmp_path / f"{form}.glb") == []
    dfd.export_rig(session, tmp_path / "all.glb", influences="all")
    assert validated(tmp_path / "all.glb") == []


@pytest.mark.parametrize("ending", ["obj", "ply", "stl", "off", "glb", "gltf"])
def test_baked_is_the_moved_shape_in_any_format(ending, session, tmp_path):
    session.add(40, translation=(0.1, 0.2, 0), rotation=(0, 60, 0))
    report = dfd.export_rig(session, tmp_path / f"moved.{ending}", form="baked")
    after = dfd.load(tmp_path / f"moved.{ending}")
    corners = after.vertices[after.faces]
    np.testing.assert_allclose(corners, session.vertices[session.mesh.faces], atol=2e-6 * session.mesh.diagonal)
    assert (report.form, report.path) == ("baked", tmp_path / f"moved.{ending}")
    assert report.largest < 1e-7
    assert str(report) == "the moved shape; no deviation from dfd.pose"


def test_nothing_that_was_given_changes(session, tmp_path):
    session.add(40, translation=(0, 0.1, 0))
    edit, vertices = session.edit, session.vertices.copy()
    hashed, steps = session.mesh.content_hash, session.can_undo
    for form in ("skin", "morph", "baked"):
        dfd.export_rig(session, tmp_path / "rig.glb", form=form)
    assert session.edit is edit
    assert session.can_undo == steps
    assert session.mesh.content_hash == hashed
    np.testing.assert_array_equal(session.vertices, vertices)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"form": "bones"}, "`form` must be one of skin, morph, baked, got 'bones'"),
        ({"influences": 0}, "`influences` must be a whole number of at least 1, got 0"),
        ({"influences": "some"}, "`influences` must be a whole number or 'all', got 'some'"),
        ({"form": "baked", "poses": [dfd.KeyPose(0)]}, "`poses` must be left out for 'baked', which does not move"),
        ({"poses": [3]}, "`poses` must be key poses, got int"),
        ({"poses": [dfd.KeyPose(1), dfd.KeyPose(1)]}, "one after the other in time, got one at 1 s after one at 1 s"),
        ({"poses": [dfd.KeyPose(0, {7: Transform()})]}, r"must use handles of the edit \(1\), got handle 7"),
        (
            {
                "poses": [
                    dfd.KeyPose(0, {1: Transform(scale=(1, 2, 3), axes=((0, 0.6, 0.8), (0, -0.8, 0.6), (1, 0, 0)))})
                ]
            },
            "must scale handle 1 along the same axes throughout",
        ),
    ],
)
def test_bad_options_are_named(options, message, session, tmp_path):
    session.add(40, scale=(1, 2, 1))
    with pytest.raises(ValueError, match=message):
        dfd.export_rig(session, tmp_path / "rig.glb", **options)
    assert list(tmp_path.iterdir()) == []


def test_bad_paths_are_named(session, tmp_path):
    session.add(40)
    with pytest.raises(ValueError, match=r"`path` must end in \.glb, \.gltf, .*got .*rig\.dae"):
        dfd.export_rig(session, tmp_path / "rig.dae")
    with pytest.raises(ValueError, match=r"`path` must end in .* for 'skin', got .*rig\.obj"):
        dfd.export_rig(session, tmp_path / "rig.obj", form="skin")
    assert dfd.export_rig(session, tmp_path / "rig.obj").form == "baked"
    with pytest.raises(OSError, match="does not exist"):
        dfd.export_rig(session, tmp_path / "missing" / "rig.glb")


@pytest.mark.parametrize("form", ["skin", "morph", "baked"])
@pytest.mark.parametrize("source", [".ply", ".glb"])
def test_a_shape_far_from_the_origin_is_exported_as_it_is(form, source, validated, tmp_path):
    chair = dfd.samples.chair(4000).mesh
    chair.save(tmp_path / f"chair{source}", chair.vertices + 5.4e6)
    mesh = dfd.load(tmp_path / f"chair{source}")
    assert np.abs(mesh.bounds - chair.bounds - 5.4e6).max() < 1e-6
    session = dfd.Deformer(mesh, field_of(mesh))
    session.add(40, translation=(0.1, 0.3, 0))
    report = dfd.export_rig(session, tmp_path / "far.glb", form=form)
    assert validated(tmp_path / "far.glb") == []
    assert report.largest <= 1e-6 * report.size
    shown = dfd.load(tmp_path / "far.glb")
    nearest = KDTree(shown.vertices - 5.4e6).query(session.vertices - 5.4e6)[0]
    assert nearest.max() < 1e-5 * report.size
