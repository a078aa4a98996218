"""Compare written skins with `dfd.pose`. They are read and posed by code that is independent of the exporter."""

import numpy as np
import pytest
from gltf_reader import Glb
from mesh_files import CORNERS, CUBE, Gltf, header_and_data, scene_of_three, textured_quad, write
from scipy.spatial import cKDTree

import dfd
from dfd.posing.transforms import Transform, frame_of_normal

BEND = {"translation": (0.1, 0.2, -0.05), "rotation": (20, 70, -10), "scale": (1.5, 0.7, 1.1)}


def apart(one, other):
    """Return the largest distance from a triangle of either set to the nearest triangle of the other set."""
    one, other = one.reshape(-1, 9), other.reshape(-1, 9)
    return max(cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max())


def shown(path, animated=None):
    return Glb(path).triangles(animated)


def plain(session):
    session.add(40, **BEND)


def along_axes(session):
    session.add(40, **BEND, axes=frame_of_normal((1, 2, 3)), pivot=(0.3, 0.1, 0))


def left_handed_axes(session):
    session.add(40, **BEND, axes=((1, 0, 0), (0, 0, 1), (0, 1, 0)))


def flattened_and_mirrored(session):
    session.add(40, rotation=(0, 50, 0), scale=(0, -1, 2))


def mirrored(session):
    session.add(40, **BEND)
    session.set_symmetry("x", band=0.1)


def cut_at_a_plane(session):
    session.add(40, **BEND, axes=frame_of_normal((1, 2, 3)))
    session.set_symmetry("z", band=0)


def with_default(session):
    session.add(40, **BEND, reach=0.5)
    session.set_default(rotation=(0, 0, 30), scale=(1, 2, 1), translation=(0, 0, 1))


def weak(session):
    for vertex in (40, 300, 500):
        session.add(vertex, **BEND, counterparts="shared_pivot", strength=0.3)


EDITS = (*(plain, along_axes, left_handed_axes, flattened_and_mirrored, mirrored, cut_at_a_plane, with_default), weak)


@pytest.mark.parametrize("make", EDITS)
def test_a_skin_that_is_not_pruned_is_what_pose_makes(make, session, tmp_path):
    make(session)
    report = dfd.export_rig(session, tmp_path / "rig.glb", influences="all")
    expected = session.vertices[session.mesh.faces]
    assert np.abs(expected - session.mesh.vertices[session.mesh.faces]).max() > 0.05
    assert np.abs(shown(tmp_path / "rig.glb") - expected).max() <= 2e-6 * session.mesh.diagonal
    assert report.largest <= 2e-6 * report.size
    assert report.pruned == 0
    assert report.normalized == 0
    assert report.joints > 1
    assert "no deviation from dfd.pose" in str(report)


def test_counterparts_have_joints_of_their_own_in_their_own_frames(tmp_path, make_session):
    session = make_session(dfd.samples.quadruped(4000).mesh)
    session.bound.prepare([dfd.SymmetryPlane((1.0, 0.0, 0.0), 0.0)])
    session.add("bottom", rotation=(0, 0, 40), translation=(0.1, 0, 0), name="foot", pivot="point", reach=0.7)
    columns = session.bound.columns(session.edit)[1]
    count = len(columns)
    assert count > 1
    dfd.export_rig(session, tmp_path / "rig.glb", influences="all")
    glb = Glb(tmp_path / "rig.glb")
    assert np.abs(glb.triangles() - session.vertices[session.mesh.faces]).max() <= 2e-6 * session.mesh.diagonal
    joints = [glb.file.nodes[joint] for joint in glb.file.skins[0].joints]
    assert [joint.name for joint in joints] == ["root", "foot", *(f"foot_{n}" for n in range(1, count))]
    binds = glb.read(glb.file.skins[0].inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    for column, bind in zip(columns, binds[1:], strict=True):
        np.testing.assert_allclose(np.linalg.inv(bind)[:3, 3], column.counterpart.position, atol=1e-5)
        assert np.linalg.det(bind) == pytest.approx(1)  # right-handed, also for mirror images


def test_four_influences_are_the_heaviest_and_sum_to_one(session, tmp_path):
    session.preset = "paper"  # by default, several handles divide the surface
    for vertex in (40, 300, 500, 700, 900, 1000):
        session.add(vertex, translation=(0, 0.1, 0), reach=0.8)
    report = dfd.export_rig(session, tmp_path / "rig.glb")
    glb = Glb(tmp_path / "rig.glb")
    ((_, primitive),) = glb.primitives()
    joints, weights = glb.influences(primitive)
    assert joints.shape[1] == report.influences == 4
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-6
    assert (joints[weights == 0] == 0).all()
    used = np.where(weights > 0, joints.astype(int), -1 - np.arange(4))
    assert all(len(set(row)) == 4 for row in used.tolist())
    own = session.bound.columns(session.edit)[0].astype(float)
    whole = np.column_stack([np.maximum(1 - own.sum(axis=1), 0), own])
    whole /= whole.sum(axis=1, keepdims=True)
    heaviest = -np.sort(-whole, axis=1)[:, :4]
    np.testing.assert_allclose(weights, heaviest / heaviest.sum(axis=1, keepdims=True), atol=1e-6)
    assert report.pruned == pytest.approx((1 - heaviest.sum(axis=1)).max(), abs=1e-6)
    assert report.normalized == (own.sum(axis=1) > 1 + 1e-5).sum() > 0
    distance = np.linalg.norm(glb.shown(0, primitive, glb.world(), {}) - session.vertices, axis=1)
    assert report.largest == pytest.approx(distance.max(), rel=1e-4)
    assert report.mean == pytest.approx(distance.mean(), rel=1e-3)
    assert f"{100 * report.largest / report.size:.2g} %" in str(report)
    assert "pruned" in str(report)
    assert "normalized" in str(report)


def test_another_blend_is_named(session, tmp_path, monkeypatch):
    monkeypatch.undo()  # blend as the preset "default" does
    session.add(40, rotation=(0, 90, 0))
    report = dfd.export_rig(session, tmp_path / "rig.glb")
    assert "the edit blends as dual_quaternion, but a skin blends linearly" in str(report)
    assert report.largest > 1e-3 * report.size


def test_key_poses_become_an_animation(session, tmp_path):
    one = session.add(40, **BEND, strength=0.5)
    two = session.add(900, reach=0.5, translation=(0, 0.1, 0), strength=0.5)
    poses = [
        dfd.KeyPose(0.5, {}),
        dfd.KeyPose(1, {one: Transform(rotation=(0, 170, 0), translation=(0, 1, 0)), two: Transform(scale=(2, 1, 1))}),
        dfd.KeyPose(2.25, {one: Transform(rotation=(0, 300, 0), pivot=(1, 1, 1))}, "last"),
    ]
    report = dfd.export_rig(session, tmp_path / "rig.glb", influences="all", poses=poses)
    assert report.largest <= 5e-6 * report.size
    glb = Glb(tmp_path / "rig.glb")
    for pose in poses:
        moved = dfd.Deformer(session.mesh, session.field, features=session.features)
        moved.apply(session.edit)
        for handle in session.handles:
            transform = pose.transforms.get(handle.id, Transform())
            moved.move(handle.id, translation=transform.translation, rotation=transform.rotation, pivot="point")
            moved.move(handle.id, scale=transform.scale, pivot="point" if transform.pivot is None else transform.pivot)
        animated = glb.channels("dfd key poses", pose.seconds)
        assert animated
        assert np.abs(glb.triangles(animated) - moved.vertices[session.mesh.faces]).max() < 5e-6 * report.size
    assert np.abs(glb.triangles() - session.vertices[session.mesh.faces]).max() < 5e-6 * report.size


def test_poses_that_ease_become_a_cubic_animation(session, tmp_path):
    one = session.add(40, strength=0.5)
    up = {one: Transform(translation=(0, 1, 0), rotation=(0, 170, 0))}
    poses = [dfd.KeyPose(1, {}, ease=True), dfd.KeyPose(2, up, ease=True), dfd.KeyPose(4, {})]
    dfd.export_rig(session, tmp_path / "rig.glb", influences="all", poses=poses)
    glb = Glb(tmp_path / "rig.glb")

    def height(seconds):
        found = glb.channels("dfd key poses", seconds, "CUBICSPLINE")
        own = [value[1] for (_, path), value in found.items() if path == "translation"]
        return max(own, key=abs)

    start, top = height(1), height(2)
    part = lambda seconds: (height(seconds) - start) / (top - start)  # noqa: E731
    assert abs(part(1.5) - 0.5) < 1e-5
    assert abs(part(1.1) - (3 * 0.01 - 2 * 0.001)) < 1e-5, "the motion begins slowly"
    assert part(2.1) > 0.99, "it ends slowly at a pose that eases"
    assert 0.04 < part(3.9) < 0.09, "it does not slow down at a pose that does not"
    (turn,) = [value for (_, path), value in glb.channels("dfd key poses", 2, "CUBICSPLINE").items()
               if path == "rotation" and abs(value[1]) > 0.5]  # fmt: skip
    assert abs(abs(turn[1]) - np.sin(np.radians(85))) < 1e-5


def test_parts_stand_at_the_root_without_a_transform(tmp_path, make_session):
    """The file has a square and two instances of a cube. One instance is rotated, scaled and translated."""
    session = make_session(dfd.load(scene_of_three(tmp_path)))
    session.add(3, **BEND, counterparts="shared_pivot")
    session.add(session.mesh.part_vertices("far")[0], translation=(0, 2, 0), counterparts="shared_pivot", reach=0.7)
    dfd.export_rig(session, tmp_path / "rig.glb")
    glb = Glb(tmp_path / "rig.glb")
    assert apart(glb.triangles(), session.vertices[session.mesh.faces]) <= 5e-6 * session.mesh.diagonal
    for index, node in enumerate(glb.file.nodes):
        if node.mesh is not None:
            assert node.skin == 0
            assert index in glb.file.scenes[0].nodes
            assert (node.matrix, node.translation, node.rotation, node.scale) == (None, None, None, None)
    assert {node.name for node in glb.file.nodes} >= {"square", "near", "far", "root"}


def test_what_is_not_about_bones_stays_to_the_byte(tmp_path, make_session):
    gltf = textured_quad(tmp_path)
    gltf.header["extras"] = {"kept": [1, 2]}
    before = dfd.load(write(tmp_path / "quad.glb", gltf.glb()))
    session = make_session(before)
    session.add(0, translation=(0, 0, 1))
    dfd.export_rig(session, tmp_path / "rig.glb")
    glb, old = Glb(tmp_path / "rig.glb"), Glb(tmp_path / "quad.glb")
    ((_, new_primitive),), ((_, old_primitive),) = glb.primitives(), old.primitives()
    for name in ("POSITION", "TEXCOORD_0"):
        new, was = (getattr(each.attributes, name) for each in (new_primitive, old_primitive))
        assert np.array_equal(glb.read(new), old.read(was))
    assert glb.file.materials[0].name == "paint"
    image = glb.file.bufferViews[glb.file.images[0].bufferView]
    assert glb.blob[image.byteOffset : image.byteOffset + image.byteLength] == (tmp_path / "paint.png").read_bytes()
    assert glb.file.extras == {"kept": [1, 2]}
    after = dfd.load(tmp_path / "rig.glb")
    np.testing.assert_array_equal(after.vertex_colors(), before.vertex_colors())


def test_a_mirrored_part_keeps_its_front(tmp_path, make_session):
    gltf = Gltf()
    normals = gltf.accessor(CORNERS * 2 - 1, 5126, "VEC3")
    tangents = gltf.accessor([[1, 0, 0, 1]] * 8, 5126, "VEC4")
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE, attributes={"NORMAL": normals, "TANGENT": tangents}))
    gltf.header["nodes"][0]["scale"] = [-1, 2, 1]
    mesh = dfd.load(write(tmp_path / "cube.glb", gltf.glb()))
    session = make_session(mesh)
    session.add(0, translation=(0, 0.5, 0))
    dfd.export_rig(session, tmp_path / "rig.glb", influences="all")
    glb = Glb(tmp_path / "rig.glb")
    ((_, primitive),) = glb.primitives()
    corners = glb.read(primitive.attributes.POSITION)[glb.read(primitive.indices).reshape(-1, 3)].astype(float)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = mesh.bounds.mean(0)
    assert (np.einsum("fa,fa->f", outward, corners.mean(axis=1) - middle) > 0).all()
    turned = glb.read(primitive.attributes.NORMAL)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1, atol=1e-6)
    place = glb.read(primitive.attributes.POSITION) - middle
    assert (np.sign(turned) == np.sign(place)).all()
    np.testing.assert_array_equal(glb.read(primitive.attributes.TANGENT), [[-1, 0, 0, -1]] * 8)


def test_nodes_that_a_file_animates_stay_where_they_are(tmp_path, make_session):
    gltf = Gltf()
    gltf.node(name="wheel", mesh=gltf.mesh("wheel", CORNERS, CUBE), translation=[1, 0, 0])
    times = gltf.accessor([[0.0], [1.0]], 5126, "SCALAR")
    turns = gltf.accessor([[0, 0, 0, 1], [0, 1, 0, 0]], 5126, "VEC4")
    gltf.header["accessors"][times] |= {"min": [0], "max": [1]}
    gltf.header["animations"] = [
        {
            "name": "turning",
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}],
            "samplers": [{"input": times, "output": turns}],
        }
    ]
    session = make_session(dfd.load(write(tmp_path / "wheel.glb", gltf.glb())))
    session.add(0, translation=(0, 0.5, 0))
    report = dfd.export_rig(session, tmp_path / "rig.glb", influences="all")
    assert "the file's own animations no longer move wheel" in str(report)
    glb = Glb(tmp_path / "rig.glb")
    assert apart(glb.triangles(), session.vertices[session.mesh.faces]) <= 5e-6 * session.mesh.diagonal
    assert glb.channels("turning", 1) == {(0, "rotation"): pytest.approx([0, 1, 0, 0])}
    assert glb.file.nodes[0].translation == [1, 0, 0]
    report = dfd.export_rig(session, tmp_path / "morph.glb", form="morph")
    assert report.notes == ()


def skinned_cube(tmp_path):
    gltf = Gltf()
    joints = gltf.accessor([[0, 0, 0, 0]] * 8, 5121, "VEC4")
    weights = gltf.accessor([[1, 0, 0, 0]] * 8, 5126, "VEC4")
    cube = gltf.mesh("cube", CORNERS, CUBE, attributes={"JOINTS_0": joints, "WEIGHTS_0": weights})
    gltf.node(name="body", mesh=cube, skin=0)
    gltf.node(name="bone")
    gltf.header["skins"] = [{"joints": [1]}]
    return write(tmp_path / "skinned.glb", gltf.glb())


def test_a_second_skin_is_refused_and_the_first_kept_by_the_other_forms(tmp_path, make_session):
    session = make_session(dfd.load(skinned_cube(tmp_path)))
    session.add(0, translation=(0, 0.5, 0))
    with pytest.raises(
        ValueError, match="`form` must be 'morph' or 'baked' for a mesh with a skin: part 'body' has its own"
    ):
        dfd.export_rig(session, tmp_path / "rig.glb", form="skin")
    assert not (tmp_path / "rig.glb").exists()
    report = dfd.export_rig(session, tmp_path / "rig.glb")
    assert (report.form, report.targets) == ("morph", 1)
    assert str(report).endswith("part 'body' keeps its own skin, so the edit is written as morph targets")
    for form in ("morph", "baked"):
        dfd.export_rig(session, tmp_path / f"{form}.glb", form=form)
        glb = Glb(tmp_path / f"{form}.glb")
        assert glb.file.nodes[0].skin == 0
        moved = dfd.load(tmp_path / "baked.glb").vertices if form == "baked" else None
        assert moved is None or np.allclose(moved, session.vertices, atol=1e-6)


@pytest.mark.parametrize("form", ["skin", "morph"])
@pytest.mark.parametrize("lines_first", [False, True])
def test_lines_that_share_positions_with_faces_move_with_them(lines_first, form, make_session, tmp_path):
    gltf = Gltf()
    primitives = gltf.header["meshes"][gltf.mesh("cube", CORNERS, CUBE)]["primitives"]
    primitives.insert(0 if lines_first else 1, {"attributes": {"POSITION": 0}, "mode": 1})
    gltf.node(name="box", mesh=0)
    session = make_session(dfd.load(write(tmp_path / "box.glb", gltf.glb())))
    session.add(7, translation=(0.2, 0.5, 0.1))
    dfd.export_rig(session, tmp_path / "out.glb", form=form, influences="all" if form == "skin" else None)
    again = dfd.load(tmp_path / "out.glb")
    assert np.allclose(again.vertices, session.vertices, atol=1e-5)
    assert np.ptp(session.vertices - session.mesh.vertices, axis=0).max() > 0.1
    (strand,) = again.scene.strands
    assert np.allclose(strand.to_scene(strand.vertices), session.vertices, atol=1e-5)
    if form == "morph":
        header = header_and_data(tmp_path / "out.glb")[0]
        bounds = [
            header["accessors"][each["targets"][0]["POSITION"]]["max"] for each in header["meshes"][0]["primitives"]
        ]
        assert bounds[0] == bounds[1] != [0, 0, 0]


def test_morph_targets_move_a_flattened_part_and_leave_the_normals_of_a_translation(make_session, tmp_path):
    gltf = Gltf()
    up = gltf.accessor(np.tile([0.0, 1.0, 0.0], (8, 1)), 5126, "VEC3")
    cube = gltf.mesh("cube", CORNERS, CUBE, attributes={"NORMAL": up})
    gltf.node(name="shadow", mesh=cube, scale=[1, 0, 1])
    gltf.node(name="body", mesh=cube, translation=[0, 1, 0])
    session = make_session(dfd.load(write(tmp_path / "flat.glb", gltf.glb())))
    session.set_default(translation=(0.1, 0.7, 0.2))
    dfd.export_rig(session, tmp_path / "out.glb", form="morph")
    again = dfd.load(tmp_path / "out.glb")
    assert np.allclose(again.bounds, session.mesh.bounds + [0.1, 0.7, 0.2], atol=1e-5)
    header = header_and_data(tmp_path / "out.glb")[0]
    assert not any(
        "NORMAL" in target for mesh in header["meshes"] for each in mesh["primitives"] for target in each["targets"]
    )
