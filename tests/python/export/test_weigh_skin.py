"""`dfd.weigh_skin`: a bar with two bones, weighted badly, and what becomes of it."""

import numpy as np
import pytest
from gltf_reader import Glb
from mesh_files import Gltf, write

import dfd
from dfd.export.bone_weights import BoneDistances, straight_weights
from dfd.export.bones import bones_of
from dfd.export.weigh_skin import bleed


def bar(count=21):
    """A square bar along x from 0 to 2, (4 · count) vertices."""
    x = np.linspace(0, 2, count)
    ring = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.1
    vertices = np.array([(each, y, z) for each in x for y, z in ring])
    faces = []
    for n in range(count - 1):
        for k in range(4):
            a, b, c, d = 4 * n + k, 4 * n + (k + 1) % 4, 4 * n + 4 + k, 4 * n + 4 + (k + 1) % 4
            faces += [(a, b, d), (a, d, c)]
    faces += [(0, 2, 1), (0, 3, 2)]
    return vertices, np.array(faces)


def character(path, *, weights=None, joints=(2, 3, 4), skin=None, node=None, binds=None, beam=False):
    """The bar with joints at x = 0, 1 and 2, weighted the wrong way round; `beam`: inside it one without the skin."""
    vertices, faces = bar()
    gltf = Gltf()
    if weights is None:
        weights = np.zeros((len(vertices), 4))
        weights[np.arange(len(vertices)), np.where(vertices[:, 0] < 1, 1, 0)] = 1
    attributes = {
        "JOINTS_0": gltf.accessor([[0, 1, 2, 0]] * len(vertices), 5121, "VEC4"),
        "WEIGHTS_0": gltf.accessor(weights, 5126, "VEC4"),
    }
    gltf.node(name="body", mesh=gltf.mesh("bar", vertices, faces, attributes=attributes), skin=0, **(node or {}))
    gltf.node(name="armature", children=[2])
    gltf.header["scenes"][0]["nodes"] = [0, 1]
    nodes = gltf.header["nodes"]
    beam_mesh = gltf.mesh("beam", vertices * (1, 0.9, 0.9), faces) if beam else None
    nodes += [{"name": "upper", "children": [3]}, {"name": "lower", "translation": [1, 0, 0], "children": [4]}]
    nodes += [{"name": "tip", "translation": [1, 0, 0]}]
    if beam:
        gltf.node(name="beam", mesh=beam_mesh)
        gltf.header["scenes"][0]["nodes"] += [5]
    if binds is None:
        binds = np.tile(np.eye(4), (3, 1, 1))
        binds[:, 0, 3] = (0, -1, -2)
    stored = gltf.accessor(np.asarray(binds).transpose(0, 2, 1).reshape(-1, 16), 5126, "MAT4")
    gltf.header["skins"] = [{"joints": list(joints), "inverseBindMatrices": stored, **(skin or {})}]
    return write(path, gltf.glb())


@pytest.fixture
def weighed(tmp_path, make_session):
    mesh = dfd.load(character(tmp_path / "bar.glb"))
    field = make_session(mesh).field
    return mesh, field, dfd.weigh_skin(mesh, field, tmp_path / "weighted.glb"), tmp_path


def matrix(path):
    """(V, J) weights as a file has them."""
    glb = Glb(path)
    ((_, primitive),) = glb.primitives()
    joints, weights = glb.influences(primitive)
    result = np.zeros((len(joints), 3))
    np.add.at(result, (np.arange(len(joints))[:, None], joints.astype(int)), weights)
    return result, glb.read(primitive.attributes.POSITION), joints, weights


def test_vertices_follow_their_own_bones(weighed):
    mesh, _, report, folder = weighed
    weights, places, joints, single = matrix(folder / "weighted.glb")
    assert (weights[places[:, 0] < 0.7].argmax(axis=1) == 0).all()
    assert (weights[places[:, 0] > 1.3].argmax(axis=1) == 1).all()
    assert np.abs(single.sum(axis=1) - 1).max() < 1e-6
    assert (joints[single == 0] == 0).all()
    assert weights[:, 2].max() == 0  # no vertex of the file follows it
    assert report.joints == 2
    assert report.before.far > 0.5
    assert report.after.far < 0.1 * report.before.far
    assert report.before.unweighted == report.after.unweighted == 0
    assert report.changed > 0.5
    assert "2 joints; before: " in str(report)
    again = dfd.load(folder / "weighted.glb")
    np.testing.assert_array_equal(again.vertices, mesh.vertices)


def test_all_else_stays(weighed):
    _, _, _, folder = weighed
    before, after = Glb(folder / "bar.glb"), Glb(folder / "weighted.glb")
    assert [node.name for node in after.file.nodes] == [node.name for node in before.file.nodes]
    assert after.file.skins == before.file.skins
    binds = after.file.skins[0].inverseBindMatrices
    np.testing.assert_array_equal(after.read(binds), before.read(binds))


def test_a_character_without_weights_gets_some_of_all_joints(tmp_path, make_session):
    mesh = dfd.load(character(tmp_path / "bar.glb", weights=np.zeros((84, 4))))
    report = dfd.weigh_skin(mesh, make_session(mesh).field, tmp_path / "weighted.glb")
    assert (report.before.unweighted, report.after.unweighted, report.joints) == (84, 0, 3)
    assert "84 vertices without weight" in str(report)


def test_bones_stand_where_the_mesh_is_shown(tmp_path):
    """The node turns and doubles the mesh, as files of some tools do; bones are carried along."""
    half = float(np.sqrt(0.5))
    node = {"rotation": [0, 0, half, half], "scale": [2, 2, 2], "translation": [0, 5, 0]}
    path = character(tmp_path / "bar.glb", node=node)
    bones = bones_of(dfd.load(path, pose="bind"))
    np.testing.assert_allclose(bones.starts, [(0, 5, 0), (0, 7, 0), (0, 9, 0)], atol=1e-6)
    np.testing.assert_allclose(bones.ends, [(0, 7, 0), (0, 9, 0), (0, 10, 0)], atol=1e-6)
    assert bones.joint.tolist() == [0, 1, 2]
    at_rest = bones_of(dfd.load(path))  # which the skin places elsewhere: bones are measured as they were bound
    np.testing.assert_allclose(at_rest.starts, bones.starts)
    np.testing.assert_allclose(at_rest.mesh.vertices, bones.mesh.vertices, atol=1e-6)
    assert bones.names == ("upper", "lower", "tip")


def test_distances_are_those_to_lines_and_along_the_surface(tmp_path):
    mesh = dfd.load(character(tmp_path / "bar.glb"))
    bones = bones_of(mesh)
    distances = BoneDistances(bones)
    x = mesh.vertices[:, 0]
    radius = np.sqrt(0.02)
    expected = np.hypot(np.maximum(x - 1, 0), radius) / mesh.diagonal
    np.testing.assert_allclose(distances.straight[:, 0], expected, rtol=1e-6)
    assert (distances.along[distances.surface[0], 0] == 0).all()
    far = x == 2
    assert distances.along[far, 0].min() * mesh.diagonal >= 0.99
    both = straight_weights(distances, np.array([0, 1]))
    np.testing.assert_allclose(both.sum(axis=1), 1)
    assert both[:, 2].max() == 0


def test_bleed_is_what_lies_farther_along_the_surface_than_the_nearest_bone():
    weights = np.array([(0.5, 0.5), (0.25, 0.75), (1.0, 0.0), (0.0, 0.0)])
    along = np.array([(0.0, 0.5), (0.2, 0.25), (0.8, 0.9), (0.5, 0.5)])
    found = bleed(weights, along)
    assert found.far == pytest.approx(0.5 / 3)
    assert found.unweighted == 1


def test_what_is_held_is_no_way_between_bones_and_around_none(tmp_path):
    """A beam without the skin lies all along the bar, and the bones run inside it."""
    mesh = dfd.load(character(tmp_path / "bar.glb", beam=True))
    bones = bones_of(mesh)
    assert bones.skinned.sum() == 84 < len(mesh.vertices)
    with_beam = BoneDistances(bones)
    bare = dfd.load(character(tmp_path / "bare.glb"))
    alone = BoneDistances(bones_of(bare))
    np.testing.assert_allclose(with_beam.along[bones.skinned], alone.along, atol=1e-6)
    for around, wanted in zip(with_beam.surface, alone.surface, strict=True):
        np.testing.assert_allclose(mesh.vertices[around], bare.vertices[wanted], atol=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joints": (2, 3, 9)}, "has a skin whose joints are not in its file"),
        ({"joints": (2, 3, 4, 1)}, "cannot be read: a skin has 3 inverse bind matrices for 4 joints"),
        ({"binds": np.zeros((3, 4, 4))}, "an inverse bind that cannot be inverted"),
        (
            {"binds": np.tile(np.eye(4), (3, 1, 1)) + np.eye(4)[0][:, None] * np.eye(4)[3] * 90},
            "all of them far outside",
        ),
    ],
)
def test_broken_skins_are_named(options, message, tmp_path, make_session):
    mesh = dfd.load(character(tmp_path / "bar.glb", **options), pose="bind")
    with pytest.raises(ValueError, match=f"weigh_skin: `mesh` .*{message}"):
        dfd.weigh_skin(mesh, make_session(mesh).field, tmp_path / "weighted.glb")
    assert not (tmp_path / "weighted.glb").exists()


def test_what_has_no_skin_is_named(mesh, field, tmp_path):
    with pytest.raises(ValueError, match="must be from a glTF file with a skin, got one of another kind"):
        dfd.weigh_skin(mesh, field, tmp_path / "weighted.glb")
    mesh.save(tmp_path / "chair.glb")
    with pytest.raises(ValueError, match="must have a skin, got none in its file"):
        dfd.weigh_skin(dfd.load(tmp_path / "chair.glb"), field, tmp_path / "weighted.glb")
    with pytest.raises(ValueError, match=r"`path` must end in \.glb, \.gltf, got .*weighted\.obj"):
        dfd.weigh_skin(mesh, field, tmp_path / "weighted.obj")
    with pytest.raises(ValueError, match="`influences` must be a whole number of at least 1, got 0"):
        dfd.weigh_skin(mesh, field, tmp_path / "weighted.glb", influences=0)


def test_the_command(weighed, monkeypatch):
    from typer.testing import CliRunner

    from dfd.cli import app

    mesh, field, report, folder = weighed
    monkeypatch.chdir(folder)
    field.save("bar.field.safetensors")
    result = CliRunner().invoke(app, ["rig", "bar.glb", "--field", "bar.field.safetensors", "-o", "again.glb"])
    assert result.exit_code == 0, result.output
    assert f"again.glb: {report}" in result.stderr
    np.testing.assert_array_equal(matrix(folder / "again.glb")[0], matrix(folder / "weighted.glb")[0])
    assert len(mesh.vertices) == len(dfd.load("again.glb").vertices)
