"""Compare written morph targets with `dfd.pose`. They are read by code that is independent of the exporter."""

import numpy as np
import pytest
from gltf_reader import Glb
from mesh_files import Gltf, scene_of_three, textured_quad, write

import dfd
from dfd.posing.transforms import Transform


def test_a_target_for_each_handle_adds_up_to_the_edit(session, tmp_path):
    session.add(40, translation=(0.1, 0.2, 0), rotation=(0, 60, 0), name="leg")
    session.add(500, scale=2, counterparts="shared_pivot")
    session.add(900, counterparts="shared_pivot", translation=(0, 0, 0))  # rests
    session.set_default(translation=(0, 0, 0.1))
    report = dfd.export_rig(session, tmp_path / "morph.glb", form="morph")
    assert (report.targets, report.joints, report.form) == (3, 0, "morph")
    glb = Glb(tmp_path / "morph.glb")
    assert np.abs(glb.triangles() - session.vertices[session.mesh.faces]).max() < 2e-6 * session.mesh.diagonal
    (content,) = glb.file.meshes
    assert content.weights == [1, 1, 1]
    assert content.extras["targetNames"] == ["leg", "handle 2", "default"]
    assert report.largest <= 2e-6 * report.size
    alone = dfd.Deformer(session.mesh, session.field, features=session.features)
    alone.add(40, translation=(0.1, 0.2, 0), rotation=(0, 60, 0), name="leg")
    half = glb.triangles({(0, "weights"): [0.5, 0, 0], (1, "weights"): [0.5, 0, 0]})
    between = (session.mesh.vertices + alone.vertices) / 2
    assert np.abs(half - between[session.mesh.faces]).max() < 2e-6 * session.mesh.diagonal


def test_key_poses_are_targets_of_an_animation(session, tmp_path):
    one = session.add(40, rotation=(0, 160, 0))  # far, so the blend band is as wide as in the key pose
    poses = [dfd.KeyPose(0, {}), dfd.KeyPose(1.5, {one: Transform(rotation=(0, 200, 0))}, "turned")]
    report = dfd.export_rig(session, tmp_path / "morph.glb", form="morph", poses=poses)
    assert report.targets == 6
    glb = Glb(tmp_path / "morph.glb")
    assert glb.file.meshes[0].extras["targetNames"] == [
        "the edit",
        "key pose 1",
        "turned, 1 of 4",
        "turned, 2 of 4",
        "turned, 3 of 4",
        "turned",
    ]
    faces, tolerance = session.mesh.faces, 2e-6 * session.mesh.diagonal
    assert np.abs(glb.triangles() - session.vertices[faces]).max() < tolerance
    rest = glb.triangles(glb.channels("dfd key poses", 0))
    assert np.abs(rest - session.mesh.vertices[faces]).max() < tolerance
    session.move(one, translation=(0, 0, 0), rotation=(0, 200, 0), pivot="point")
    turned = glb.triangles(glb.channels("dfd key poses", 1.5))
    assert np.abs(turned - session.vertices[faces]).max() < tolerance


def test_parts_stay_under_their_nodes_and_where_nothing_moves_costs_nothing(tmp_path, make_session):
    session = make_session(dfd.load(scene_of_three(tmp_path)))
    within = session.mesh.part_vertices("far")
    session.add(within[0], translation=(0, 2, 0), rotation=(0, 30, 20), counterparts="shared_pivot", mask=within)
    dfd.export_rig(session, tmp_path / "morph.glb", form="morph")
    glb, before = Glb(tmp_path / "morph.glb"), Glb(tmp_path / "three.glb")
    assert np.abs(glb.triangles() - session.vertices[session.mesh.faces]).max() < 2e-6 * session.mesh.diagonal
    assert [node.translation for node in glb.file.nodes] == [node.translation for node in before.file.nodes]
    for node, primitive in glb.primitives():
        accessor = glb.file.accessors[primitive.targets[0]["POSITION"]]
        assert (accessor.bufferView is None) == (glb.file.nodes[node].name != "far")


def test_targets_that_are_there_are_refused(tmp_path, make_session):
    gltf: Gltf = textured_quad(tmp_path)
    moved = gltf.accessor([(0, 0, 1)] * 4, 5126, "VEC3")
    gltf.header["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": moved}]
    session = make_session(dfd.load(write(tmp_path / "quad.glb", gltf.glb())))
    session.add(0, translation=(0, 0, 1))
    with pytest.raises(
        ValueError, match="`form` must be 'skin' or 'baked' for a mesh with morph targets: part 'square'"
    ):
        dfd.export_rig(session, tmp_path / "morph.glb", form="morph")
    dfd.export_rig(session, tmp_path / "skin.glb")
    ((_, primitive),) = Glb(tmp_path / "skin.glb").primitives()
    np.testing.assert_array_equal(Glb(tmp_path / "skin.glb").read(primitive.targets[0]["POSITION"]), [(0, 0, 1)] * 4)


def test_nothing_moved_is_refused(session, tmp_path):
    session.add(40)
    with pytest.raises(ValueError, match="`session` must have a handle that moves, because morph targets"):
        dfd.export_rig(session, tmp_path / "morph.glb", form="morph")
    assert list(tmp_path.iterdir()) == []
