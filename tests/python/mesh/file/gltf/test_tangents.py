"""Tangents of glTF files turn with the surface, and further attributes keep their values."""

import numpy as np
import pytest
from mesh_files import Gltf, header_and_data, ply, write
from scipy.spatial.transform import Rotation

from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.mesh import load

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
FACES = [(0, 1, 2), (0, 2, 3)]
NODES = {
    "plain": {},
    "turned": {"rotation": [0, 0, float(np.sqrt(0.5)), float(np.sqrt(0.5))]},
    "scaled": {"scale": [2, 1, 1]},
}


def square(folder, *, morphed=True, normals=True, **node):
    gltf = Gltf()
    attributes = {"TANGENT": gltf.accessor(np.tile([1.0, 0, 0, -1], (4, 1)), 5126, "VEC4")}
    if normals:
        attributes["NORMAL"] = gltf.accessor(np.tile([0.0, 0, 1], (4, 1)), 5126, "VEC3")
    mesh = gltf.mesh("square", SQUARE, FACES, attributes=attributes)
    if morphed:
        moves = {
            "POSITION": gltf.accessor(np.tile([0.0, 0, 0.5], (4, 1)), 5126, "VEC3"),
            "TANGENT": gltf.accessor(np.tile([0.0, 0.25, 0], (4, 1)), 5126, "VEC3"),
        }
        gltf.header["accessors"][moves["POSITION"]] |= {"min": [0, 0, 0.5], "max": [0, 0, 0.5]}
        gltf.header["meshes"][mesh]["primitives"][0]["targets"] = [moves]
    gltf.node(mesh=mesh, **node)
    return write(folder / "a.glb", gltf.glb())


def tangents(path):
    data = GltfData(path.read_bytes(), AssetFolder(path))
    primitive = data.header["meshes"][0]["primitives"][0]
    own = data.attribute(primitive, "TANGENT")
    targets = primitive.get("targets")
    return own, data.accessor(targets[0]["TANGENT"]) if targets else None


@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("node", NODES)
def test_tangents_turn_with_the_surface_and_so_do_those_of_morph_targets(node, normals, tmp_path):
    mesh = load(square(tmp_path, normals=normals, **NODES[node]))
    scene = mesh.scene
    turn = Rotation.from_rotvec([0, 0, np.pi / 2]) * Rotation.from_rotvec([0.4, 0, 0])
    mesh.save(tmp_path / "b.glb", turn.apply(mesh.vertices.copy()))
    own, moved = tangents(tmp_path / "b.glb")
    linear = scene.primitives[0].transform[:3, :3]
    for found, before in ((own[:, :3], (1.0, 0, 0)), (moved, (0, 0.25, 0))):
        expected = turn.apply(linear @ before)
        for each in (linear @ found.T).T:
            assert np.allclose(each / np.linalg.norm(each), expected / np.linalg.norm(expected), atol=1e-6)
    assert (own[:, 3] == -1).all()
    assert np.allclose(np.linalg.norm(own[:, :3], axis=1), 1, atol=1e-6)


def test_a_translation_keeps_tangents(tmp_path):
    mesh = load(square(tmp_path))
    mesh.save(tmp_path / "b.glb", mesh.vertices + (0.3, -2.7, 1 / 3))
    for before, after in zip(tangents(tmp_path / "a.glb"), tangents(tmp_path / "b.glb"), strict=True):
        assert np.array_equal(before, after)
    headers = [header_and_data(tmp_path / name)[0] for name in ("a.glb", "b.glb")]
    first, second = (each["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] for each in headers)
    assert first == second


def test_tangents_follow_a_shear_at_a_right_angle_to_the_normal(tmp_path):
    mesh = load(square(tmp_path, morphed=False))
    mesh.save(tmp_path / "b.glb", mesh.vertices @ np.array([(1, 1, 0), (0, 1, 0), (0, 0, 1.0)]))
    assert np.allclose(tangents(tmp_path / "b.glb")[0][:, :3], np.array([1, 1, 0]) / np.sqrt(2), atol=1e-6)


def test_tangents_of_a_flattened_part_are_removed_and_said(tmp_path):
    mesh = load(square(tmp_path, morphed=False, scale=[1, 1, 0]))
    with pytest.warns(UserWarning, match="the tangents of part 'square' are removed"):
        mesh.save(tmp_path / "b.glb", mesh.vertices + np.random.default_rng(1).normal(size=mesh.vertices.shape))
    assert b"TANGENT" not in (tmp_path / "b.glb").read_bytes()


# Further attributes


def labelled(kind, labels, folder, name="label"):
    rows = [f"{place} {label}" for place, label in zip(["0 0 0", "1 0 0", "0 1 0"], labels, strict=True)]
    return load(write(folder / "a.ply", ply([f"{kind} {name}"], rows)))


def attribute_of(path, name):
    scene = load(path).scene
    return scene.primitives[0].geometry.attributes[name].tolist()


@pytest.mark.parametrize(
    ("kind", "labels", "said"),
    [
        ("int", ["16777217", "20000001", "20000003"], "3 of 'label'"),
        ("uint", ["16777216", "16777218", "16777217"], "1 of 'label'"),
        ("int64", ["1", "2", "9007199254740991"], "1 of 'label'"),
        ("double", ["1600000000.25", "1600000000.5", "1600000000.75"], "3 of 'label'"),
        ("float", ["1", "nan", "2"], "1 of 'label'"),
    ],
)
def test_values_that_32_bit_floats_change_are_said(kind, labels, said, tmp_path):
    mesh = labelled(kind, labels, tmp_path)
    with pytest.warns(UserWarning, match=f"32-bit floats, which change values .{said}.; .ply keeps them") as found:
        mesh.save(tmp_path / "a.glb")
    assert len(found) == 1
    assert np.isfinite(attribute_of(tmp_path / "a.glb", "_LABEL")).all()


@pytest.mark.parametrize(("kind", "labels"), [("int", ["1", "-2", "16777216"]), ("double", ["0.1", "0.2", "0.3"])])
def test_other_values_keep_their_numbers(kind, labels, tmp_path):
    labelled(kind, labels, tmp_path).save(tmp_path / "a.glb")
    assert np.allclose(attribute_of(tmp_path / "a.glb", "_LABEL"), [float(each) for each in labels], rtol=1e-7)
    load(tmp_path / "a.glb").save(tmp_path / "b.ply")
    assert np.allclose(attribute_of(tmp_path / "b.ply", "_LABEL"), [float(each) for each in labels], rtol=1e-7)
