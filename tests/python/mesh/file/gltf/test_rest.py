"""The shape at rest of glTF files: skins and morph targets as three.js shows them, mirrored nodes right side out."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE, Gltf, write

from dfd.mesh.mesh import load

VALIDATOR = Path(__file__).parents[4] / "validator"


def posed(tmp_path, *, morph=True):
    """A cube that one bone lifts and one turns by 90°, under a node that a skin does not know."""
    gltf = Gltf()
    high = CORNERS[:, 2] > 0.5
    weights = np.where(high[:, None], [(1.0, 3.0, 0, 0)], [(0.5, 0, 0, 0)])  # not normalized
    weights[0] = 0
    mesh = gltf.mesh(
        "body",
        CORNERS,
        CUBE,
        attributes={
            "JOINTS_0": gltf.accessor(np.tile([0, 1, 0, 0], (8, 1)), 5121, "VEC4"),
            "WEIGHTS_0": gltf.accessor(weights, 5126, "VEC4"),
        },
    )
    if morph:
        target = {"POSITION": gltf.accessor(np.where(high[:, None], [(0, 0, 2.0)], 0.0), 5126, "VEC3")}
        gltf.header["meshes"][mesh]["primitives"][0]["targets"] = [target]
        gltf.header["meshes"][mesh]["weights"] = [0.25]
    half = float(np.sqrt(0.5))
    gltf.node(name="body", mesh=mesh, skin=0, scale=[3, 3, 3], translation=[50, 0, 0])
    gltf.node(name="low", translation=[0, 5, 0], children=[2])
    gltf.header["nodes"].append({"name": "high", "rotation": [half, 0, 0, half], "scale": [1, 2, 1]})
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[1, :3, 3] = (0, 0, -1)
    stored = gltf.accessor(binds.transpose(0, 2, 1).reshape(-1, 16), 5126, "MAT4")
    gltf.header["skins"] = [{"joints": [1, 2], "inverseBindMatrices": stored}]
    return write(tmp_path / "posed.glb", gltf.glb())


def in_three(*paths):
    """Where three.js shows the vertices of each file."""
    if shutil.which("node") is None:
        pytest.skip("Node is not installed: nothing was compared with three.js")
    if not (VALIDATOR / "node_modules" / "three").is_dir():
        pytest.skip("three.js is not installed (npm ci in tests/validator): nothing was compared with it")
    done = subprocess.run(
        ["node", VALIDATOR / "rest.mjs", *paths], check=True, capture_output=True, text=True, cwd=VALIDATOR
    )
    found = json.loads(done.stdout)
    return [np.array(found[str(path)]).reshape(-1, 3) for path in paths]


def test_a_skin_and_morph_targets_rest_as_three_shows_them(tmp_path):
    path = posed(tmp_path)
    mesh = load(path)
    mesh.save(tmp_path / "again.glb")
    moved = mesh.vertices * [1, 1.5, 1] + [0, 0, 7]
    mesh.save(tmp_path / "moved.glb", moved)
    shown, again, after = in_three(path, tmp_path / "again.glb", tmp_path / "moved.glb")
    np.testing.assert_allclose(mesh.vertices, shown, atol=1e-5)
    np.testing.assert_allclose(again, shown, atol=1e-6)
    np.testing.assert_allclose(after, moved, atol=1e-4)  # posed right again


def test_the_shape_as_it_was_bound_has_a_name(tmp_path):
    mesh = load(posed(tmp_path), pose="bind")
    np.testing.assert_allclose(mesh.vertices, CORNERS * 3 + [50, 0, 0])
    mesh.save(tmp_path / "out.glb", mesh.vertices + 1)
    np.testing.assert_allclose(load(tmp_path / "out.glb", pose="bind").vertices, mesh.vertices + 1, atol=1e-5)
    with pytest.raises(ValueError, match="load: `pose` must be one of rest, bind, got 'rested'"):
        load(tmp_path / "out.glb", pose="rested")


def test_morph_targets_count_with_their_default_weights(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh("body", CORNERS, CUBE)
    target = {"POSITION": gltf.accessor(np.tile([(0, 4.0, 0)], (8, 1)), 5126, "VEC3")}
    gltf.header["meshes"][mesh]["primitives"][0]["targets"] = [target]
    gltf.header["meshes"][mesh]["weights"] = [0.5]
    gltf.node(name="one", mesh=mesh)
    gltf.node(name="other", mesh=mesh, weights=[1.0], translation=[9, 0, 0])
    path = write(tmp_path / "morph.glb", gltf.glb())
    loaded = load(path)
    np.testing.assert_allclose(loaded.vertices[:8], CORNERS + [0, 2, 0])
    np.testing.assert_allclose(loaded.vertices[8:], CORNERS + [9, 4, 0])
    loaded.save(tmp_path / "out.glb", loaded.vertices * 2)
    np.testing.assert_allclose(load(tmp_path / "out.glb").vertices, loaded.vertices * 2, atol=1e-6)
    np.testing.assert_allclose(in_three(path)[0], loaded.vertices, atol=1e-6)


def test_a_node_scales_before_it_rotates(tmp_path):
    gltf = Gltf()
    half = float(np.sqrt(0.5))
    gltf.node(name="body", mesh=gltf.mesh("body", CORNERS, CUBE), rotation=[0, 0, half, half], scale=[1, 2, 3])
    mesh = load(write(tmp_path / "turned.glb", gltf.glb()))
    np.testing.assert_allclose(mesh.vertices, CORNERS[:, [1, 0, 2]] * [-2, 1, 3], atol=1e-6)


@pytest.mark.parametrize("ending", ["glb", "gltf", "obj", "ply", "stl", "off"])
def test_a_mirrored_node_is_right_side_out(ending, tmp_path):
    gltf = Gltf()
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE), scale=[-1, 1, 1])
    mesh = load(write(tmp_path / "mirrored.glb", gltf.glb()))
    mesh.save(tmp_path / f"out.{ending}", mesh.vertices * 2)
    for each in (mesh, load(tmp_path / f"out.{ending}")):
        a, b, c = (each.vertices[each.faces[:, corner]] for corner in range(3))
        middle = each.vertices.mean(axis=0)
        assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a - middle) > 0).all()


def test_seams_of_a_skinned_surface_stay_closed(tmp_path):
    gltf = Gltf()
    places = CORNERS[CUBE].reshape(-1, 3)
    weights = np.tile([0.5, 0.5, 0, 0], (36, 1)) + np.arange(36)[:, None] * [1e-7, 0, 0, 0]
    attributes = {
        "JOINTS_0": gltf.accessor(np.tile([0, 1, 0, 0], (36, 1)), 5121, "VEC4"),
        "WEIGHTS_0": gltf.accessor(weights, 5126, "VEC4"),
    }
    gltf.node(mesh=gltf.mesh("cube", places, np.arange(36), attributes=attributes), skin=0)
    gltf.node(name="bone", translation=[3, 0, 0])
    gltf.node(name="other", scale=[2, 2, 2])
    gltf.header["skins"] = [{"joints": [1, 2]}]
    assert len(load(write(tmp_path / "seams.glb", gltf.glb())).vertices) == 8
