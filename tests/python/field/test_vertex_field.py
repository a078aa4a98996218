"""Test `dfd.VertexField`, a field from given features of vertices."""

import pickle

import numpy as np
import pytest
import torch

import dfd


@pytest.fixture
def rows(mesh):
    return np.random.default_rng(1).normal(size=(len(mesh.vertices), 12)).astype(np.float32)


def unit(rows):
    return rows / np.linalg.norm(rows.astype(np.float64), axis=1, keepdims=True)


def test_vertices_have_what_was_given(mesh, rows):
    before = rows.copy()
    field = dfd.VertexField(mesh, rows)
    np.testing.assert_allclose(field.features(mesh), unit(rows), atol=1e-7)
    assert field.dimension == 12
    assert field.features(mesh).dtype == np.float32
    np.testing.assert_array_equal(rows, before)
    rows[:] = 7
    np.testing.assert_allclose(field.features(mesh), unit(before), atol=1e-7)
    assert repr(field) == f"VertexField(12 dimensions of {len(mesh.vertices)} vertices)"
    assert field.settings == {"features": "vertices"}


def test_points_have_what_the_nearest_vertex_has(mesh, rows):
    field = dfd.VertexField(mesh, rows)
    points = mesh.vertices[[5, 80]] + 1e-6
    np.testing.assert_array_equal(field(points), field.features(mesh)[[5, 80]])
    tensor = field(torch.tensor(points))
    np.testing.assert_array_equal(tensor.numpy(), field(points))
    assert field(np.zeros((0, 3))).shape == (0, 12)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(field))(points), field(points))


def test_a_session_weighs_by_them(mesh, rows):
    session = dfd.Deformer(mesh, dfd.VertexField(mesh, rows), preset="paper")
    session.add(17, translation=(0, 0.1, 0))
    weights = dfd.bind(unit(rows).astype(np.float32), [17])
    np.testing.assert_allclose(session.weights, weights, atol=1e-6)
    moved = dfd.pose(mesh.vertices, weights, np.array([np.c_[np.eye(3), (0, 0.1, 0)]]))
    np.testing.assert_allclose(session.vertices, moved, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows, mesh: rows[:-1], r"`features` must have shape .*, a row for each vertex, got \(\d+, 12\)$"),
        (lambda rows, mesh: rows[:, :0], r"`features` must have shape"),
        (lambda rows, mesh: rows * np.nan, "`features` must be finite"),
        (lambda rows, mesh: rows * (np.arange(len(rows)) != 3)[:, None], "rows other than 0, got zeros in row 3"),
    ],
)
def test_what_is_no_row_for_each_vertex_is_refused(mesh, rows, change, message):
    with pytest.raises(ValueError, match=message):
        dfd.VertexField(mesh, change(rows, mesh))
