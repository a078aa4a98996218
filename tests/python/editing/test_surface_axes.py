"""Axes along the limb or the normal: those of the handle, and of every instance its own."""

import json

import numpy as np
import pytest

import dfd
from dfd import Mesh
from dfd.editing.edit import Edit, Handle
from dfd.editing.edit_file import from_document, to_document
from dfd.editing.influence.distances import Distances
from dfd.editing.influence.instances import Instance, SurfaceAxes
from dfd.editing.points import place_on
from dfd.posing.transforms import Transform

DIRECTIONS = np.array([[0, 1, 0], [0.6, 0.8, 0], [1, 0, 0], [0, -1, 0], [0.48, 0.64, 0.6]])


@pytest.fixture(scope="module")
def fingers():
    """Tubes that begin near the origin, one in each direction; the first vertex of each is at its far end."""
    around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 13)[:-1], np.linspace(3, 1, 21), indexing="ij")
    number = np.arange(12 * 21).reshape(12, 21)
    a, b = number, np.roll(number, -1, axis=0)
    quads = np.stack([a[:, :-1], b[:, :-1], b[:, 1:], a[:, 1:]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    vertices = []
    for direction in DIRECTIONS:
        across = np.linalg.svd(direction[None])[2][1:]
        rings = np.stack([0.1 * np.cos(around), 0.1 * np.sin(around)], axis=-1).reshape(-1, 2) @ across
        vertices.append(rings + along.reshape(-1, 1) * direction)
    count = len(vertices[0])
    return Mesh(np.concatenate(vertices), np.concatenate([faces + i * count for i in range(len(DIRECTIONS))]))


def tip(finger):
    return finger * 12 * 21


def held(mesh, axes, along, at=0):
    return Handle(1, place_on(mesh, at), Transform(scale=(2.0, 2.0, 1.0), axes=axes, along=along))


def instances_at(mesh, vertices, frame=None):
    frame = np.eye(3) if frame is None else frame
    return [Instance(v, tuple(mesh.vertices[v]), frame, 1.0, None) for v in vertices]


def test_every_finger_grows_thicker_along_itself(fingers):
    axes = SurfaceAxes(fingers, Distances(fingers))
    own = axes.at(tip(0), "limb")
    np.testing.assert_allclose(own[2], DIRECTIONS[0], atol=0.12)
    handle = held(fingers, own, "limb")
    before = instances_at(fingers, [tip(i) for i in range(len(DIRECTIONS))])
    found = axes.turned(handle, tip(0), before)
    assert found[0] is before[0]
    for one, direction in zip(found, DIRECTIONS, strict=True):
        assert np.linalg.det(one.frame) == pytest.approx(1)
        np.testing.assert_allclose(one.frame @ own[2], direction, atol=0.12)
        linear = one.transform(handle.matrix, handle.place.position)[:, :3]
        np.testing.assert_allclose(np.linalg.svd(linear)[1], [2, 2, 1], atol=1e-9)
        assert np.linalg.norm(linear @ direction) == pytest.approx(1, abs=0.1)
        np.testing.assert_array_equal(before[0].frame, np.eye(3))


def test_a_mirrored_instance_stays_mirrored(fingers):
    axes = SurfaceAxes(fingers, Distances(fingers))
    handle = held(fingers, axes.at(tip(1), "limb"), "limb", tip(1))
    mirror = np.diag([-1.0, 1.0, 1.0])
    _, other = axes.turned(handle, tip(1), instances_at(fingers, [tip(1), tip(0)], mirror))
    assert np.linalg.det(other.frame) == pytest.approx(-1)
    np.testing.assert_allclose(other.frame @ handle.transform.axes[2], DIRECTIONS[0], atol=0.12)


def test_in_the_middle_of_limbs_the_nearer_way_is_taken(fingers):
    axes = SurfaceAxes(fingers, Distances(fingers))
    handle = held(fingers, axes.at(10, "limb"), "limb", 10)
    _, other = axes.turned(handle, 10, instances_at(fingers, [10, tip(1) + 10]))
    assert other.frame @ handle.transform.axes[2] @ np.asarray(handle.transform.axes[2]) > 0


def test_axes_that_are_numbers_turn_with_the_frame_alone(fingers):
    axes = SurfaceAxes(fingers, Distances(fingers))
    before = instances_at(fingers, [tip(0), tip(1)])
    found = axes.turned(held(fingers, axes.at(tip(0), "limb"), None), tip(0), before)
    assert list(found) == before


def test_normals_are_each_instance_s_own(fingers):
    axes = SurfaceAxes(fingers, Distances(fingers))
    handle = held(fingers, axes.at(5, "normal"), "normal", 5)
    np.testing.assert_allclose(handle.transform.axes[2], fingers.normals[5], atol=1e-9)
    _, other = axes.turned(handle, 5, instances_at(fingers, [5, tip(2) + 5]))
    np.testing.assert_allclose(other.frame @ handle.transform.axes[2], fingers.normals[tip(2) + 5], atol=1e-9)


def test_where_there_is_no_limb_the_frame_stays():
    import trimesh

    ball = trimesh.creation.icosphere(3)
    mesh = Mesh(ball.vertices, ball.faces)
    axes = SurfaceAxes(mesh, Distances(mesh))
    assert axes.at(0, "limb") is None
    before = instances_at(mesh, [0, 7])
    found = axes.turned(held(mesh, np.eye(3), "limb"), 0, before)
    assert list(found) == before


def test_what_is_hardly_alike_keeps_its_frame(fingers):
    axes = SurfaceAxes(fingers, Distances(fingers))
    before = [*instances_at(fingers, [tip(0)]), Instance(tip(1), tuple(fingers.vertices[tip(1)]), np.eye(3), 0.1, None)]
    assert list(axes.turned(held(fingers, axes.at(tip(0), "limb"), "limb"), tip(0), before)) == before


def test_a_session_s_instances_scale_along_their_own_limbs(session_of_feet):
    session, foot = session_of_feet
    handle = session.add(foot, scale=(1.5, 1.5, 1.0), axes="limb", reach=0.7)
    transform = session.handle(handle).transform
    assert transform.along == "limb"
    frames = [column.instance.frame for column in session.bound.columns(session.edit)[1]]
    session.move(handle, axes=np.asarray(transform.axes))  # the same numbers: they still run along the limb
    assert session.handle(handle).transform.along == "limb"
    first = session.vertices
    session.move(handle, axes=np.eye(3))
    assert session.handle(handle).transform.along is None
    assert (session.vertices != first).any()
    plain = [column.instance.frame for column in session.bound.columns(session.edit)[1]]
    assert any((one != other).any() for one, other in zip(frames, plain, strict=True))
    session.undo()
    np.testing.assert_array_equal(session.vertices, first)
    other = next(one for one, _ in session.instances(handle)[1:]).vertex
    session.change(handle, at=other)
    np.testing.assert_allclose(
        session.handle(handle).transform.axes, session.bound.axes(place_on(session.mesh, other), "limb")
    )


def test_the_document_says_what_axes_run_along(session_of_feet):
    session, foot = session_of_feet
    session.add(foot, scale=(1.5, 1.5, 1.0), axes="limb")
    document = json.loads(json.dumps(to_document(session.edit, session.mesh)))
    assert document["handles"][0]["along"] == "limb"
    assert from_document(document, session.mesh) == session.edit
    del document["handles"][0]["along"]
    assert from_document(document, session.mesh).handles[0].transform.along is None


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("along", "bone", r"`handles\[0\].along` must be 'normal' or 'limb', got \"bone\""),
        ("axes", None, r"`handles\[0\].axes` must be given when `along` is"),
    ],
)
def test_what_axes_cannot_run_along_is_refused(session_of_feet, key, value, message):
    session, foot = session_of_feet
    session.add(foot, axes="limb")
    document = to_document(session.edit, session.mesh)
    document["handles"][0][key] = value
    with pytest.raises(ValueError, match=message):
        from_document(document, session.mesh)


@pytest.fixture
def session_of_feet(mesh, field, features):
    session = dfd.Deformer(mesh, field, features=features)
    session.apply(Edit())
    return session, int((mesh.vertices @ (1, -3, 1)).argmax())
