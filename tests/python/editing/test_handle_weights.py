"""Test the weights of a session: their values, which steps compute them again, and compact features."""

from unittest import mock

import numpy as np
import pytest
import reference

import dfd
from dfd.editing.weights import handle_features
from dfd.field.field import Field

ONE_PIVOT = {"reach": 1.0, "falloff": "linear", "counterparts": "shared_pivot"}

# --- calls of bind and pose


def test_a_move_does_not_call_bind_and_a_new_handle_binds_only_itself(paper, bound):
    first = paper.add(5)
    _ = paper.vertices
    for angle in range(5):
        paper.move(first, rotation=(0, 0, angle))
        _ = paper.vertices
    assert bound == [1]
    second = paper.add(900, scale=2)
    _ = paper.vertices
    third = paper.add((0.5, 0.5, 0.5), scale=2)
    _ = paper.vertices
    assert bound == [1, 1, 1]
    paper.remove(second)
    _ = paper.vertices
    assert bound == [1, 1, 1]
    np.testing.assert_array_equal(paper.weights[:, 0], dfd.bind(paper.features, [5])[:, 0])
    assert paper.handles[1].id == third
    assert paper.weights.shape[1] == 2


def test_columns_of_weights_equal_the_results_of_bind(paper, geodesics_of, features, field):
    geodesics = geodesics_of(paper)
    for at in (1, 2, (0.1, 0.2, 0.3), (0.2, 0.1, 0.3), 3):
        paper.add(at)
    for vertex in (4, 5):
        paper.add(vertex, locality=2.0)
    weights = paper.weights
    points = field(np.array([(0.1, 0.2, 0.3), (0.2, 0.1, 0.3)]))
    np.testing.assert_array_equal(weights[:, [0, 1, 4]], dfd.bind(features, [1, 2, 3]))
    np.testing.assert_array_equal(weights[:, 2:4], dfd.bind(features, points))
    near = dfd.bind(features, [4, 5], geodesic=geodesics.distances([4, 5]), locality=2.0)
    np.testing.assert_array_equal(weights[:, 5:], near)


def test_a_drag_recomputes_only_the_moving_handle_and_equals_a_pose(fresh, folds):
    for symmetry, default in ((None, None), ("x", None), (None, (0, 0, 5)), ("x", (0, 0, 5))):
        deformer = fresh("paper")
        handles = [deformer.add(vertex, translation=(0, 0.01 * vertex, 0), **ONE_PIVOT) for vertex in (5, 6, 7, 8, 9)]
        deformer.set_symmetry(symmetry)
        deformer.set_default(rotation=default)
        assert deformer.weights.sum(axis=1).max() > 4
        start = deformer.vertices
        del folds[:]
        for frame in range(1, 4):
            deformer.move(handles[2], rotation=(0, 10 * frame, 0), scale=1 + 0.1 * frame, merge=frame > 1)
            dragged = deformer.vertices
        assert folds in ([1], [-1, 1])  # the first rotation may change the blend
        whole = fresh()
        whole.apply(deformer.edit)
        np.testing.assert_allclose(dragged, whole.vertices, rtol=0, atol=1e-12)
        assert np.abs(dragged - start).max() > 0.05
        deformer.undo()
        np.testing.assert_allclose(deformer.vertices, start, rtol=0, atol=1e-12)
        deformer.redo()
        np.testing.assert_allclose(deformer.vertices, dragged, rtol=0, atol=1e-12)


# --- distances


def test_a_point_s_distances_start_at_the_nearest_vertex(deformer, geodesics, mesh):
    deformer.add(mesh.vertices[70] + 1e-4, locality=1.0)
    _ = deformer.weights
    assert geodesics.asked == [[70]]


def test_locality_of_a_symmetric_edit_starts_at_both_mirror_images(deformer, geodesics, bound, mesh):
    vertex = int(mesh.vertices[:, 0].argmax())
    mirrored = int(np.linalg.norm(mesh.vertices - mesh.vertices[vertex] * [-1, 1, 1], axis=1).argmin())
    deformer.add(vertex, locality=3.0, reach=1.0, falloff="linear", follow="none")
    deformer.add(5, reach=1.0, follow="none")
    _ = deformer.weights
    deformer.set_symmetry("x")
    both = geodesics.distances([vertex, mirrored]).min(axis=0)
    wanted = dfd.bind(deformer.features, [vertex], geodesic=both[None], locality=3.0)
    np.testing.assert_array_equal(deformer.weights[:, :1], wanted)
    assert bound == [1, 1, 1]


def test_in_the_paper_s_preset_distances_start_at_the_handle_alone(paper, geodesics_of):
    geodesics = geodesics_of(paper)
    paper.set_symmetry("x")
    paper.add(5, locality=3.0)
    _ = paper.weights
    assert geodesics.asked == [[5]]


# --- compact features


@pytest.fixture
def compacted():
    """Use compact features for every mesh, as for meshes with many vertices."""
    with (
        mock.patch.object(handle_features, "MOST_EXACT", 100),
        mock.patch.object(Field, "features", side_effect=AssertionError),
    ):
        yield


def test_many_vertices_bind_from_compact_features(compacted, mesh, field, features):
    deformer = dfd.Deformer(mesh, field)
    for vertex in (5, 900, 1500):
        deformer.add(vertex, translation=(0, 0.1, 0), **ONE_PIVOT)
    deformer.add(mesh.vertices[70], scale=2, **ONE_PIVOT)
    deformer.add((0.3, 0.1, 0.2), **ONE_PIVOT)
    places = np.concatenate([features[[5, 900, 1500, 70]], field(np.array([(0.3, 0.1, 0.2)]))])
    for fixed in (None, 600, (0.1, 0.2, 0.3)):
        if fixed is not None:
            deformer.fix(fixed)
        rows = {
            None: None,
            600: features[[600]],
            (0.1, 0.2, 0.3): np.concatenate([features[[600]], field(np.array([(0.1, 0.2, 0.3)]))]),
        }[fixed]
        taken = 0.0 if rows is None else reference.feature_weights(places, rows).max(axis=1)
        exact = np.minimum(dfd.bind(features, places, fixed=rows) / (1 - taken), 1)
        # Each weight has an error of at most 0.01. With a fixed point, the result is a difference of two weights.
        wrong = np.abs(deformer.weights - exact) * (1 - taken)
        assert 0 < wrong.max() <= (0.01 if fixed is None else 0.02)
    assert isinstance(deformer.features, dfd.CompactFeatures)
    assert deformer.features.error <= 0.01
    np.testing.assert_array_equal(deformer.weights[600], 0)
    exactly = dfd.Deformer(mesh, field, features=features)
    exactly.apply(deformer.edit)
    np.testing.assert_allclose(deformer.vertices, exactly.vertices, atol=0.02 * mesh.diagonal)


def test_the_weight_at_a_handle_is_1_for_compact_features_of_any_precision(compacted, mesh, field):
    for tolerance, precision in ((0.01, None), (0.05, "int8"), (0.002, "float16")):
        compact = dfd.compact(field, mesh.vertices, tolerance=tolerance)
        assert precision is None or compact.precision == precision
        deformer = dfd.Deformer(mesh, field, features=compact)
        assert deformer.features is compact
        deformer.add((0.3, 0.1, 0.2))
        vertices = list(range(0, len(mesh.vertices), 250))
        for vertex in vertices:
            deformer.add(vertex)
        np.testing.assert_array_equal(deformer.weights[vertices, np.arange(1, 1 + len(vertices))], 1)
        np.testing.assert_array_equal(deformer.vertices, mesh.vertices)
        for vertex in vertices[1::2]:  # fixed points take from the weights, and all are scaled up
            deformer.fix(vertex + 1, strength=0.5)
        np.testing.assert_array_equal(deformer.weights[vertices, np.arange(1, 1 + len(vertices))], 1)


@pytest.mark.parametrize("most_exact", [100, 10_000])
def test_preparing_reports_its_progress(mesh, field, most_exact):
    done = []
    with mock.patch.object(handle_features, "MOST_EXACT", most_exact):
        deformer = dfd.Deformer(mesh, field)
        deformer.prepare(done.append)
        deformer.prepare(done.append)
    assert sum(done) == len(mesh.vertices)
    assert isinstance(deformer.features, dfd.CompactFeatures) == (most_exact == 100)


def test_compact_features_of_another_shape_are_refused(mesh, field, features):
    with pytest.raises(ValueError, match=r"Deformer: `features` must have shape \(2004, 16\), got \(2003, 16\)"):
        dfd.Deformer(mesh, field, features=dfd.compact(features[1:]))
