"""Test fits: vertices and scans arrive at their targets, and undetermined motions are named and stay small."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import dfd
from dfd.editing.deformer import Deformer


@pytest.fixture(scope="module")
def tower():
    """Return a mesh of two boxes on a third one, and the indices of their vertices; each box is a part of its own."""
    import trimesh

    boxes = [
        trimesh.creation.box((1, 0.4, 1)),
        trimesh.creation.box((0.3, 1, 0.3)).apply_translation((-0.3, 0.75, 0)),
        trimesh.creation.box((0.3, 1, 0.3)).apply_translation((0.3, 0.75, 0)),
    ]
    boxes = [box.subdivide().subdivide() for box in boxes]
    whole = trimesh.util.concatenate(boxes)
    labels = np.repeat(np.arange(3), [len(box.vertices) for box in boxes])
    mesh = dfd.Mesh(whole.vertices, whole.faces)
    return mesh, [np.flatnonzero(labels == k) for k in range(3)], dfd.VertexField(mesh, np.eye(3)[labels])


def session_on(tower, **how):
    """Return a session whose two handles each move one of the upper boxes, rigidly, by weights of 1."""
    mesh, parts, field = tower
    session = Deformer(mesh, field, **how)
    handles = [session.add(int(parts[k][0]), reach=0.5, counterparts="shared_pivot") for k in (1, 2)]
    return session, handles


def affine(vector, shift, factor=1.0):
    return np.column_stack([factor * Rotation.from_rotvec(vector, degrees=True).as_matrix(), shift])


@pytest.mark.parametrize("preset", ["default", "paper"])
@pytest.mark.parametrize("motion", ["rigid", "scale", "affine"])
@pytest.mark.filterwarnings("ignore:Deformer. `preset` is 'paper'")
def test_an_exact_motion_is_found(tower, motion, preset):
    mesh, parts, _ = tower
    session, handles = session_on(tower, preset=preset)
    matrices = [affine((20, 5, -30), (0.2, 0.1, 0)), affine((0, 50, 10), (0, 0.3, -0.2))]
    if motion != "rigid":
        matrices = [each * [[1.3, 1.3, 1.3, 1]] for each in matrices]
    if motion == "affine":
        matrices[0][:, :3] = matrices[0][:, :3] @ [[1, 0.4, 0], [0, 1.2, 0], [0, 0, 0.8]]
    chosen = np.concatenate([parts[1][:10], parts[2][:10]])
    matrix = np.repeat(matrices, 10, axis=0)
    goals = np.einsum("nij,nj->ni", matrix[:, :, :3], mesh.vertices[chosen]) + matrix[:, :, 3]
    found = session.fit((chosen, goals), motion=motion)
    assert found.largest < 2e-6
    assert found.before > 0.1
    assert not found.undetermined
    np.testing.assert_allclose(session.transforms, matrices, atol=3e-5)
    assert session.undo()
    np.testing.assert_array_equal(session.vertices, mesh.vertices)
    assert [handle.id for handle in session.handles] == handles


def test_targets_in_blend_bands_are_reached_exactly():
    import trimesh

    feet = [(x, 1.0, z) for x in (-0.7, 0.7) for z in (-0.7, 0.7)]
    boxes = [trimesh.creation.box((2, 0.4, 2))]
    boxes += [trimesh.creation.box((0.2, 1, 0.2)).apply_translation((x, 0.7, z)) for x, _, z in feet]
    whole = trimesh.util.concatenate([box.subdivide().subdivide().subdivide() for box in boxes])
    mesh = dfd.Mesh(whole.vertices, whole.faces)
    rows = np.exp(-np.linalg.norm(mesh.vertices[:, None] - np.array([(0, 0, 0), *feet]), axis=2))
    field = dfd.VertexField(mesh, rows / np.linalg.norm(rows, axis=1, keepdims=True))
    wanted, session = Deformer(mesh, field), Deformer(mesh, field)
    random = np.random.default_rng(0)
    for foot in feet:
        wanted.add(foot, translation=random.normal(0, 0.1, 3), rotation=random.normal(0, 20, 3))
        session.add(foot)
    weights = wanted.weights
    band = np.flatnonzero(((weights > 0.05) & (weights < 0.95)).any(axis=1))
    ends = np.flatnonzero(mesh.vertices[:, 1] > 0.9)
    marks = np.concatenate([ends[:: len(ends) // 16], band[:: len(band) // 8]])
    found = session.fit((marks, wanted.vertices[marks]))
    assert found.before > 0.1
    assert found.largest < 1e-4


def test_a_place_of_any_kind_is_a_target(tower):
    mesh, parts, _ = tower
    session, _ = session_on(tower)
    vertex = int(parts[1][3])
    with pytest.warns(
        UserWarning, match=r"do not determine all motions \(handle 1: translation and rotation, handle 2:"
    ):
        session.fit({vertex: mesh.vertices[vertex] + (0, 0.1, 0)})
    by_vertex = session.vertices
    np.testing.assert_allclose(by_vertex[vertex], mesh.vertices[vertex] + (0, 0.1, 0), atol=1e-6)
    other, _ = session_on(tower)
    with pytest.warns(UserWarning, match="do not determine"):
        other.fit({tuple(mesh.vertices[vertex]): mesh.vertices[vertex] + (0, 0.1, 0)})
    np.testing.assert_allclose(other.vertices, by_vertex, atol=1e-9)


def test_undetermined_motions_stay_small(tower):
    mesh, parts, _ = tower
    session, handles = session_on(tower)
    with pytest.warns(UserWarning, match="handle 2"):
        found = session.fit((parts[1][:5], mesh.vertices[parts[1][:5]] + (0.2, 0, 0)))
    assert set(found.undetermined) == {handles[1]}
    np.testing.assert_allclose(session.vertices[parts[2]], mesh.vertices[parts[2]], atol=1e-6)
    np.testing.assert_allclose(session.vertices[parts[1]], mesh.vertices[parts[1]] + (0.2, 0, 0), atol=1e-5)


def test_only_chosen_handles_move(tower):
    mesh, parts, _ = tower
    session, handles = session_on(tower)
    chosen = np.concatenate([parts[1][:5], parts[2][:5]])
    session.move(handles[1], pivot=(1, 2, 3), rotation=(0, 20, 0))
    session.fit((chosen, mesh.vertices[chosen] + (0.2, 0, 0)), handles=handles[1:])
    assert session.handle(handles[1]).pivot == (1, 2, 3), "a fit keeps a pivot that was set"
    assert session.handle(handles[0]).transform.rests
    np.testing.assert_allclose(session.vertices[parts[2]], mesh.vertices[parts[2]] + (0.2, 0, 0), atol=1e-5)


def test_the_result_does_not_depend_on_the_present_pose(tower):
    mesh, parts, _ = tower
    fresh, _ = session_on(tower)
    moved, handles = session_on(tower)
    moved.move(handles[0], rotation=(0, 70, 0), scale=2)
    for session in (fresh, moved):
        session.fit((np.concatenate(parts[1:]), mesh.vertices[np.concatenate(parts[1:])] + (0.1, 0.2, 0)))
    np.testing.assert_allclose(fresh.vertices, moved.vertices, atol=1e-6)


def test_the_surface_fits_the_points_of_a_scan(tower):
    mesh, parts, _ = tower
    session, handles = session_on(tower)
    truth, _ = session_on(tower)
    truth.move(handles[0], matrix=affine((6, 0, 4), (0.05, 0.04, 0.02)))
    truth.move(handles[1], matrix=affine((0, 0, -8), (0.04, 0.02, 0.03)))
    random = np.random.default_rng(0)
    faces = mesh.faces[random.integers(0, len(mesh.faces), 600)]
    shares = random.dirichlet((1, 1, 1), 600)
    scan = np.einsum("nk,nkd->nd", shares, truth.vertices[faces])
    found = session.fit(scan)
    assert found.before > 0.01
    assert found.mean < 0.1 * found.before
    upper = np.concatenate(parts[1:])
    before, after = (np.abs(some[upper] - truth.vertices[upper]).max() for some in (mesh.vertices, session.vertices))
    assert after < 0.25 * before


@pytest.mark.parametrize(
    ("targets", "options", "message"),
    [
        (([], np.zeros((0, 3))), {}, "`targets` must have at least one target"),
        (np.zeros((0, 3)), {}, "`targets` must have at least one point"),
        (np.zeros((4, 2)), {}, r"`targets` must have shape \(N, 3\), got \(4, 2\)"),
        (([0, 1], np.zeros((3, 3))), {}, r"`targets` must have shape \(2, 3\), got \(3, 3\)"),
        (([0, 1], np.full((2, 3), np.nan)), {}, "`targets` must be finite, got nan"),
        (([100_000], np.zeros((1, 3))), {}, r"`targets\[0\]` must lie in 0 …"),
        (([0],), {}, "`targets` must be a pair of vertices and positions, got 1 items"),
        ({"x>0": (0, 0, 0)}, {}, "`targets` must be at vertices or points, not regions"),
        ({0: (0, 0, 0)}, {"motion": "stretch"}, "`motion` must be one of rigid, scale, affine, got 'stretch'"),
        ({0: (0, 0, 0)}, {"handles": []}, "`handles` must have at least one handle to move"),
        ({0: (0, 0, 0)}, {"handles": [7]}, r"`handle` must be the id of a handle \(1, 2\), got 7"),
        ({0: (0, 0, 0)}, {}, "`targets` must be at places that the handles move"),
    ],
)
def test_refusals(tower, targets, options, message):
    session, _ = session_on(tower)
    before = session.edit
    with pytest.raises(ValueError, match="^Deformer.fit: " + message):
        session.fit(targets, **options)
    assert session.edit is before
