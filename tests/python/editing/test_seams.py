"""Weights smoothed where they fade: what is better, and what keeps its bits."""

import numpy as np
import pytest
from made_tube import AROUND, straight

import dfd
from dfd.editing.edit_file import to_document
from dfd.editing.influence.seams import WIDTH, Seams
from dfd.geometry.topology import first_at_place
from dfd.posing.transforms import Transform

NOTHING = np.zeros(0, np.int64)


@pytest.fixture(scope="module")
def tube():
    return straight()


def jagged(mesh, low=2.0, high=2.1):
    """(V,) 1 above a border that goes up and down around a tube, and 0 below it."""
    border = np.where(np.arange(len(mesh.vertices)) % 4 < 2, low, high)
    return (mesh.vertices[:, 1] > border).astype(np.float32)


def smoothed(mesh, weights, still=NOTHING):
    result = weights.copy()
    Seams(mesh).smooth(result, still)
    return result


def creases(mesh, moved):
    """(E,) degrees by which the angle between faces changed across each inner edge of a closed mesh."""
    faces = first_at_place(mesh)[mesh.faces]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T[::-1])
    one, other = order[::2] // 3, order[1::2] // 3

    def angles(points):
        corners = points[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.degrees(np.arccos(np.clip((normals[one] * normals[other]).sum(axis=1), -1.0, 1.0)))

    return np.abs(angles(moved) - angles(mesh.vertices))


@pytest.mark.parametrize(
    "transform",
    [{"scale": 1.5, "pivot": (0, 2, 0)}, {"rotation": (15, 0, 0), "pivot": (0, 2, 0)}, {"translation": (0.2, 0, 0)}],
)
def test_a_jagged_border_leaves_no_crease(tube, transform):
    weights = jagged(tube)
    matrix = Transform(**transform).matrix((0.0, 0.0, 0.0))
    before, after = (
        creases(tube, dfd.pose(tube.vertices, each[:, None], matrix[None], blend="linear"))
        for each in (weights, smoothed(tube, weights))
    )
    assert before.max() > 60.0
    assert after.max() < 0.25 * before.max()


def test_far_from_the_border_weights_keep_their_bits(tube):
    weights = jagged(tube)
    weights[tube.vertices[:, 1] > 3.0] = np.float32(0.9999)  # as good as 1
    after = smoothed(tube, weights)
    far = np.abs(tube.vertices[:, 1] - 2.05) > 0.1 + 2.0 * WIDTH * tube.diagonal
    np.testing.assert_array_equal(after[far], weights[far])
    assert (after != weights).any()
    assert after.min() >= 0.0
    assert after.max() <= 1.0


def test_broad_falloffs_stay_and_narrow_ones_widen(tube):
    height = tube.vertices[:, 1]
    broad = (0.5 - 0.5 * np.cos(np.pi * np.clip(height / 4.0, 0.0, 1.0))).astype(np.float32)
    np.testing.assert_allclose(smoothed(tube, broad), broad, atol=0.01)
    after = smoothed(tube, (height > 2.0).astype(np.float32))
    fades = height[(after > 0.1) & (after < 0.9)]
    assert 0.5 * WIDTH * tube.diagonal < np.ptp(fades) < 4.0 * WIDTH * tube.diagonal


@pytest.mark.parametrize("value", [0.0, 1.0, 0.3])
def test_where_nothing_fades_nothing_happens(tube, value):
    weights = np.full(len(tube.vertices), value, np.float32)
    np.testing.assert_array_equal(smoothed(tube, weights), weights)


def test_what_is_still_stays_and_all_is_as_smooth_in_a_fainter_copy(tube):
    weights = jagged(tube)
    still = np.flatnonzero(weights == 0.0)
    after = smoothed(tube, weights, still)
    np.testing.assert_array_equal(after[still], 0.0)
    assert (after != weights).any()
    np.testing.assert_allclose(smoothed(tube, weights / 4), smoothed(tube, weights) / 4, atol=1e-6)


def test_vertices_at_one_position_are_one(tube):
    """A tube whose triangles share no vertex, as some files have them, has the weights of the welded one."""
    apart = dfd.Mesh(tube.vertices[tube.faces.ravel()], np.arange(tube.faces.size, dtype=np.int32).reshape(-1, 3))
    corner = tube.faces.ravel()
    wanted = smoothed(tube, jagged(tube))[corner]
    np.testing.assert_allclose(smoothed(apart, jagged(tube)[corner]), wanted, atol=1e-5)


def test_defects_neither_spread_nor_stop_it(tube):
    """Slivers, repeated and folded faces, a vertex of no face and a third face at an edge."""
    extra = [[0, 0, 1], [0, 1, 2], [0, 2, 1], tube.faces[5], [0, AROUND, 40 * AROUND]]
    vertices = np.concatenate([tube.vertices, [[9.0, 9.0, 9.0], [0.0, 2.05, 0.5], [0.0, 2.05, 0.5 + 1e-9]]])
    extra.append([len(tube.vertices) + 1, len(tube.vertices) + 2, 0])
    mesh = dfd.Mesh(vertices, np.concatenate([tube.faces, extra]).astype(np.int32))
    weights = jagged(mesh)
    weights[len(tube.vertices) :] = 0.5, 0.5, 1.0
    after = smoothed(mesh, weights)
    assert np.isfinite(after).all()
    assert after[len(tube.vertices)] == np.float32(0.5)  # no face has it
    assert np.ptp(after[: len(tube.vertices)]) == 1.0
    flat = dfd.Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))
    np.testing.assert_array_equal(smoothed(flat, np.array([0.0, 0.5, 1.0], np.float32)), [0.0, 0.5, 1.0])


def test_a_session_smooths_by_one_switch_that_undoes(deformer):
    held = deformer.add(int(deformer.mesh.vertices[:, 1].argmin()), reach=0.4, falloff="constant", scale=1.5)
    deformer.fix(900)
    before, weights = deformer.vertices, deformer.weights
    assert not deformer.smooth_seams
    deformer.smooth_seams = True
    after, following = deformer.vertices, deformer.following
    assert np.abs(after - before).max() > 1e-3
    assert following.max() <= 1.0 + 1e-6  # all look-alikes together
    np.testing.assert_array_equal(deformer.weights, weights)  # of the handles, as they are bound
    np.testing.assert_array_equal(after[900], deformer.mesh.vertices[900])
    assert deformer.report().handles[0].arrived
    again = dfd.Deformer(deformer.mesh, deformer.field, features=deformer.features)
    again.apply(deformer.edit)
    np.testing.assert_array_equal(again.vertices, after)
    deformer.move(held, scale=1.0)
    np.testing.assert_array_equal(deformer.vertices, deformer.mesh.vertices)
    deformer.undo()
    deformer.add(int(deformer.mesh.vertices[:, 1].argmax()))
    np.testing.assert_array_equal(deformer.following[:, 0], following[:, 0])
    deformer.smooth_seams = False
    np.testing.assert_array_equal(deformer.vertices, before)
    with pytest.raises(ValueError, match="`smooth_seams` must be True or False, got 1"):
        deformer.smooth_seams = 1


def test_nothing_follows_beyond_a_limit_and_one_rigid_motion_stays_one(deformer):
    top = deformer.mesh.vertices[:, 1] > np.median(deformer.mesh.vertices[:, 1])
    deformer.smooth_seams = True
    deformer.add(
        int(deformer.mesh.vertices[:, 1].argmax()), reach=2.0, falloff="constant", mask=top, translation=(0, 1, 0)
    )
    np.testing.assert_array_equal(deformer.vertices[~top], deformer.mesh.vertices[~top])
    deformer.change(1, mask="everywhere")
    moved = deformer.vertices - deformer.mesh.vertices
    np.testing.assert_allclose(moved, np.broadcast_to([0.0, 1.0, 0.0], moved.shape), atol=1e-12)


def test_a_rig_blends_with_the_smoothed_weights(deformer, tmp_path):
    deformer.add(
        int(deformer.mesh.vertices[:, 1].argmin()), reach=0.4, falloff="constant", instances="shared_pivot", scale=1.5
    )
    deformer.smooth_seams = True
    assert to_document(deformer.edit, deformer.mesh)["smooth_seams"] is True
    report = dfd.export_rig(deformer, tmp_path / "rig.glb", form="skin")
    assert report.largest < 1e-5 * deformer.mesh.diagonal
