"""Test that pieces of a mesh that touch each other stay together, unless a handle detaches them."""

import numpy as np
import pytest
from made_field import field_of
from made_tube import straight, tube

import dfd
from dfd.editing.weights.contacts import contacts_of, with_hanging
from dfd.editing.weights.fill import band_for, filled, whole
from dfd.editing.weights.held_part import hold
from dfd.geometry.coarse import nodes_of
from dfd.posing.transforms import rotation_matrix


def box(center, size, cells=4):
    """Return a closed box with a grid of `cells`² squares on each side."""
    at = np.linspace(-0.5, 0.5, cells + 1)
    one, other = (each.ravel() for each in np.meshgrid(at, at, indexing="ij"))
    points, faces = [], []
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    a, b, c, d = (each.ravel() for each in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    for axis in range(3):
        for end in (-0.5, 0.5):
            side = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3) + len(points) * len(one)
            faces.append(side if (end > 0) else side[:, ::-1])
            points.append(np.roll(np.stack([np.full(len(one), end), one, other], axis=1), axis, axis=1))
    vertices, index = np.unique(np.concatenate(points).round(9), axis=0, return_inverse=True)
    return dfd.Mesh(vertices * size + center, index.ravel()[np.concatenate(faces)].astype(np.int32))


def joined(*meshes):
    offsets = np.cumsum([0, *(len(each.vertices) for each in meshes)])
    faces = [each.faces + offset for each, offset in zip(meshes, offsets, strict=False)]
    piece = np.repeat(np.arange(len(meshes)), [len(each.vertices) for each in meshes])
    return dfd.Mesh(np.concatenate([each.vertices for each in meshes]), np.concatenate(faces)), piece


def session_of(mesh, labels):
    """Return a session in which the features of a vertex depend only on its label."""
    return dfd.Deformer(mesh, field_of(mesh), features=np.eye(16, dtype=np.float32)[labels])


def held_weights(mesh, component, vertex, translation):
    """Return the weights (V,) of a handle at a vertex that moves the part `component` (N,)."""
    [held] = hold(mesh, component, vertex, mesh.vertices[vertex]).components
    column = whole(0, held)
    affine = np.column_stack([np.eye(3), translation])
    return filled([column], [band_for(column, affine, np.eye(3, 4), mesh)], mesh)[:, 0]


FEET = np.array([(x, 0.0, z) for x in (-0.4, 0.4) for z in (-0.4, 0.4)])


@pytest.fixture(scope="module", params=[4, 1], ids=["fine", "coarse"])
def table(request):
    """Return a session with a table of five pieces, and the piece of each vertex: four legs, and the top."""
    legs = [box(foot + (0, 0.4, 0), (0.12, 0.84, 0.12), request.param) for foot in FEET]
    mesh, piece = joined(*legs, box((0, 0.85, 0), (1, 0.1, 1), request.param))
    return session_of(mesh, (piece == 4).astype(int)), piece


def edited(table, *at, **how):
    session, piece = table
    while session.undo():
        pass
    vertex = int(np.linalg.norm(session.mesh.vertices - at, axis=1).argmin())
    session.add(vertex, **how)
    return session, piece, session.vertices - session.mesh.vertices, vertex


@pytest.mark.parametrize("pull", [(0, -0.3, 0), (0.2, 0, 0.1), (0.05, 0.1, 0)])
def test_a_pulled_leg_stretches_and_stays_at_the_top(table, pull):
    session, piece, moved, foot = edited(table, 0.46, -0.02, 0.46, translation=pull)
    np.testing.assert_allclose(moved[foot], pull, atol=1e-6)
    heights = session.mesh.vertices[:, 1]
    np.testing.assert_array_equal(moved[piece == 4], 0)
    np.testing.assert_allclose(moved[(piece < 4) & (heights > 0.8)], 0, atol=1e-6)
    told = session.report()
    assert (told.loose, told.handles[0].arrived) == (0, True)
    assert told.stretch > 1.02 or pull[1] > 0


def test_detached_legs_come_loose_and_the_report_says_so(table):
    session, piece, moved, _ = edited(table, 0.46, -0.02, 0.46, translation=(0, -0.3, 0), detach=True)
    np.testing.assert_allclose(moved[piece < 4], np.tile((0, -0.3, 0), (np.sum(piece < 4), 1)), atol=1e-6)
    told = session.report()
    assert told.loose == 4
    assert told.gap == pytest.approx(0.3 - 0.02, abs=0.03)
    assert f"; 4 pairs of touching pieces came apart by up to {told.gap:.3g}" in str(told)
    session.change(session.handles[0].id, detach=False)
    assert session.report().loose == 0


def test_if_the_top_is_pulled_the_legs_stretch(table):
    session, piece, moved, _ = edited(table, 0.5, 0.9, 0.5, translation=(0.1, 0.3, 0))
    np.testing.assert_allclose(moved[piece == 4], np.tile((0.1, 0.3, 0), (np.sum(piece == 4), 1)), atol=1e-6)
    np.testing.assert_array_equal(moved[(piece < 4) & (session.mesh.vertices[:, 1] < 0.0)], 0)
    assert session.report().loose == 0


@pytest.mark.parametrize("motion", [{"translation": (0.2, 0.1, 0)}, {"rotation": (0, 0, 15)}])
def test_a_rung_between_stretched_legs_moves_as_they_do(motion):
    """The rung is as high as the middle of the legs. A long beam below the feet touches them, and stays."""
    legs = [box(foot + (0, 0.4, 0), (0.12, 0.84, 0.12), 6) for foot in FEET]
    rung, beam = box((-0.4, 0.55, 0), (0.06, 0.06, 0.68)), box((0, -0.1, 0), (4, 0.16, 4))
    mesh, piece = joined(*legs, box((0, 0.85, 0), (1, 0.1, 1), 6), rung, beam)
    session = session_of(mesh, (piece == 4).astype(int))
    session.add(int(np.linalg.norm(mesh.vertices - (0.5, 0.9, 0.5), axis=1).argmin()), **motion)
    assert session.report().loose == 0
    weights = session.following[:, 0]
    leg = weights[(piece == 0) & (np.abs(mesh.vertices[:, 1] - 0.55) < 0.08)]
    assert leg.min() - 0.01 <= weights[piece == 5].min() <= weights[piece == 5].max() <= leg.max() + 0.01
    assert 0.2 < weights[piece == 5].mean() < 1
    np.testing.assert_array_equal(session.vertices[piece == 6], mesh.vertices[piece == 6])


def test_a_rung_moves_as_the_stretched_part_of_the_leg_that_it_touches():
    """It touches a leg between the foot, which moves fully, and the top, which stays. The leg is the handle's part."""
    leg, post = (box((x, 0.4, 0), (0.12, 0.84, 0.12), 12) for x in (0, 0.8))
    mesh, piece = joined(leg, box((0.4, 0.6, 0), (0.68, 0.06, 0.06)), post, box((0.4, 0.9, 0), (2, 0.2, 2)))
    session = session_of(mesh, (piece > 0).astype(int))
    foot = int(np.where(piece == 0, mesh.vertices[:, 1], 9).argmin())
    session.add(foot, translation=(0, -0.4, 0), follow="none")
    weights, x = session.following[:, 0], mesh.vertices[:, 0]
    leg_here = weights[(piece == 0) & (np.abs(mesh.vertices[:, 1] - 0.6) < 0.08) & (x > 0.05)]
    assert 0.02 < leg_here.min() < leg_here.max() < 0.8
    end = weights[(piece == 1) & (x < 0.07)]
    assert leg_here.min() - 0.02 <= end.min() <= end.max() <= leg_here.max() + 0.02
    assert session.report().gap < 0.03


def test_a_slat_as_large_as_the_pulled_one_follows_the_post_that_both_touch():
    posts = [box((x, 0.5, 0), (0.1, 1.0, 0.1), 8) for x in (-0.5, 0.5)]
    slats = [box((0, height, 0), (0.94, 0.06, 0.06)) for height in (0.75, 0.9)]
    mesh, piece = joined(*posts, *slats, box((0, -0.2, 0), (3, 0.4, 3)))
    end = int(np.where(piece == 2, -mesh.vertices[:, 0], -9).argmax())
    weights = held_weights(mesh, np.where(piece == 2, 0, -1), end, (0, 0, 0.2))
    assert weights[(piece == 3) & (mesh.vertices[:, 0] < -0.4)].min() > 0.5
    np.testing.assert_array_equal(weights[piece == 4], 0)


def test_surface_at_a_handle_on_a_contact_follows(table):
    """Without this, the leg would come loose, because its handle moves fully."""
    session, piece, moved, at = edited(table, 0.46, 0.82, 0.46, translation=(0, -0.2, 0), follow="none")
    assert piece[at] < 4
    np.testing.assert_allclose(moved[at], (0, -0.2, 0), atol=1e-6)
    assert session.report().loose == 0
    assert np.abs(moved[piece == 4]).max() > 0.05


def test_a_rotation_about_the_base_keeps_the_contact(table):
    session, piece, moved, _ = edited(table, 0.46, -0.02, 0.46, rotation=(0, 0, 30))
    assert session.handles[0].transform.pivot_at == "base"
    assert session.handles[0].pivot[1] > 0.7
    assert np.linalg.norm(moved, axis=1).max() > 0.2
    np.testing.assert_array_equal(moved[piece == 4], 0)
    assert session.report().loose == 0


def test_a_drag_does_not_jump_where_a_contact_begins_to_open(table):
    session, _, before, _ = edited(table, 0.46, -0.02, 0.46)
    steps = []
    for pull in np.linspace(0, 0.02, 81)[1:]:
        session.move(session.handles[0].id, translation=(0, -pull, 0), merge=True)
        moved = session.vertices - session.mesh.vertices
        steps.append(np.linalg.norm(moved - before, axis=1).max())
        before = moved
    assert max(steps) <= 5 * np.median(steps)
    assert session.report().loose == 0


def wheel(turns=24):
    """Return a wheel on a fixed axle along x, in a frame, and the piece of each vertex: 0 is the wheel."""
    axle = tube(np.stack([np.linspace(-1.0, 0.02, 12), np.zeros(12), np.zeros(12)], axis=1), 0.08)
    disk = tube(np.stack([np.linspace(-0.1, 0.1, 5), np.zeros(5), np.zeros(5)], axis=1), 0.5)
    return joined(disk, axle, box((-1.2, 0, 0), (0.5, 2, 2)))


def test_a_wheel_turns_on_its_axle():
    mesh, piece = wheel()
    session = session_of(mesh, piece)
    rim = int(np.where(piece == 0, mesh.vertices[:, 1], -9).argmax())
    for degrees in (20, 170):
        handle = session.add(rim, rotation=(degrees, 0, 0), pivot=(0, 0.004, 0))
        turn = rotation_matrix((degrees, 0, 0))
        pivot = np.array([0, 0.004, 0])
        np.testing.assert_allclose(
            session.vertices[piece == 0], (mesh.vertices[piece == 0] - pivot) @ turn.T + pivot, atol=1e-6
        )
        np.testing.assert_array_equal(session.vertices[piece > 0], mesh.vertices[piece > 0])
        session.remove(handle)


def test_a_pulled_wheel_draws_its_axle():
    mesh, piece = wheel()
    session = session_of(mesh, piece)
    session.add(int(np.where(piece == 0, mesh.vertices[:, 1], -9).argmax()), translation=(0.3, 0, 0))
    moved = session.vertices - mesh.vertices
    np.testing.assert_allclose(moved[piece == 0], np.tile((0.3, 0, 0), (np.sum(piece == 0), 1)), atol=1e-6)
    assert session.report().loose == 0
    np.testing.assert_array_equal(moved[piece == 2], 0)


def test_what_touches_only_the_moved_part_moves_with_it():
    """A nail touches only the tip of a finger, and a plate as large as the finger's half lies at its base."""
    finger, nail, plate = straight(2.0, 41, 0.1), box((0.1, 1.9, 0), (0.04, 0.1, 0.1)), box((0, 0, 0), (2, 0.1, 2))
    mesh, piece = joined(finger, nail, plate)
    component = np.where((piece == 0) & (mesh.vertices[:, 1] > 1), 0, -1)
    found = with_hanging(nodes_of(mesh), component)
    np.testing.assert_array_equal(found, np.where(piece == 1, 0, component))
    session = session_of(mesh, piece)
    tip = int(np.where(piece == 0, mesh.vertices[:, 1], -9).argmax())
    for detach in (False, True):
        handle = session.add(tip, translation=(0, 0.3, 0), detach=detach)
        moved = session.vertices - mesh.vertices
        np.testing.assert_allclose(moved[piece == 1, 1], 0.0 if detach else 0.3, atol=1e-6)
        session.remove(handle)


def test_a_small_piece_beside_the_border_moves_as_the_surface_that_it_touches():
    """A mirror touches the body of a car in the blend band of a wide pull, its glass only the mirror.

    A lamp touches the body inside and outside the part. A spoiler is farther.
    """
    post = straight(2.0, 61, 0.2)
    mirror, spoiler = (box((0.22, height, 0), (0.1, 0.06, 0.06)) for height in (0.95, 0.1))
    glass, lamp = box((0.29, 0.95, 0), (0.04, 0.04, 0.04)), box((-0.22, 1.0, 0), (0.1, 0.3, 0.06))
    mesh, piece = joined(post, mirror, spoiler, glass, lamp)
    component = np.where((piece == 0) & (mesh.vertices[:, 1] > 1.0), 0, -1)
    tip = int(np.where(piece == 0, mesh.vertices[:, 1], -9).argmax())
    weights = held_weights(mesh, component, tip, (0.4, 0, 0))
    beside = weights[(piece == 0) & (np.abs(mesh.vertices[:, 1] - 0.95) < 0.06)]
    assert 0.02 < beside.min() < beside.max() < 0.95
    assert beside.min() - 0.02 <= weights[piece == 1].min() <= weights[piece == 1].max() <= beside.max() + 0.02
    np.testing.assert_array_equal(weights[piece == 2], 0)
    assert (
        weights[piece == 1].min() <= weights[piece == 3].min() <= weights[piece == 3].max() <= weights[piece == 1].max()
    )
    heights = mesh.vertices[:, 1]
    for height in (0.86, 1.0, 1.14):
        near = np.abs(heights - height) < 0.03
        assert weights[(piece == 4) & near].mean() == pytest.approx(weights[(piece == 0) & near].mean(), abs=0.1)
    loose = hold(mesh, component, tip, mesh.vertices[tip], detach=True).components[0]
    assert not np.isin(loose.vertices, np.flatnonzero(piece == 1)).any()


def test_a_large_region_beside_the_part_and_one_that_an_edge_connects_stay():
    post, beam = straight(2.0, 41, 0.1), box((1.0, 1.9, 0), (1.9, 0.3, 1.5))
    mesh, piece = joined(post, beam)
    component = np.where((piece == 0) & (mesh.vertices[:, 1] > 0.2), 0, -1)
    np.testing.assert_array_equal(with_hanging(nodes_of(mesh), component), component)


def test_of_a_post_through_a_plate_only_the_side_of_the_handle_moves():
    post, plate = straight(2.0, 41, 0.1), box((0, 1.0, 0), (2, 0.1, 2), 8)
    mesh, piece = joined(post, plate)
    component = np.where(piece == 0, 0, -1)
    foot = int(np.where(piece == 0, mesh.vertices[:, 1], 9).argmin())
    (found,) = contacts_of(nodes_of(mesh), component, [np.array([foot])])
    assert len(found.kept) in (1, 2)
    heights = mesh.vertices[:, 1]
    assert (found.apart[(piece == 0) & (heights > 1.0)] == 0).all()
    below = (piece == 0) & (heights < 0.8)
    np.testing.assert_allclose(found.apart[below], 0.95 - heights[below], atol=0.12)
    assert np.isinf(found.apart[piece == 1]).all()
    held = hold(mesh, component, foot, mesh.vertices[foot]).components[0]
    assert held.contacts.free == pytest.approx(0.5 * found.apart[foot], abs=0.06)


def test_a_piece_with_a_border_of_its_own_may_leave_what_it_touches():
    """A hand that touches a hip is attached at its shoulder."""
    arm, hip = straight(2.0, 41, 0.1), box((0.6, 2.0, 0), (1.0, 0.3, 1.0))
    mesh, piece = joined(arm, hip)
    component = np.where((piece == 0) & (mesh.vertices[:, 1] > 1), 0, -1)
    tip = int(np.where(piece == 0, mesh.vertices[:, 1], -9).argmax())
    assert contacts_of(nodes_of(mesh), component, [np.array([tip])]) == [None]


def test_horns_that_are_pieces_stay_on_the_head():
    sample = dfd.samples.quadruped(4000)
    head = sample.mesh.vertices[sample.vertices_of("head")]
    top = head[head[:, 1].argmax()] * (0, 1, 1)
    horns = [
        tube(top + np.linspace(0, 1, 12)[:, None] * np.array([0.2 * side, 0.25, 0]) - (0, 0.05, 0), 0.02)
        for side in (-1, 1)
    ]
    mesh, piece = joined(sample.mesh, *horns)
    session = session_of(mesh, np.where(piece == 0, sample.labels.max() + 1, 0))
    tip = int(np.where(piece == 1, mesh.vertices[:, 1], -9).argmax())
    for motion in ({"translation": (0, 0.15, 0)}, {"rotation": (0, 0, 35)}, {"rotation": (20, 10, 0), "scale": 1.3}):
        handle = session.add(tip, **motion)
        told = session.report()
        assert (told.loose, told.handles[0].arrived) == (0, True)
        np.testing.assert_array_equal(session.vertices[piece == 0], mesh.vertices[piece == 0])
        session.remove(handle)
