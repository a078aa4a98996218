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
        (lambda rows, mesh: 0 * rows, "must have rows other than 0, got only zeros"),
        (lambda rows, mesh: torch.from_numpy(rows).requires_grad_(), "must not require gradients: detach them, or use"),
    ],
)
def test_what_is_no_row_for_each_vertex_is_refused(mesh, rows, change, message):
    with pytest.raises(ValueError, match=message):
        dfd.VertexField(mesh, change(rows, mesh))


def test_rows_of_zeros_are_filled_along_the_surface():
    columns = 6  # two flat strips, one above the other, which share no edge
    grid = np.array([(x, y, z) for z in (0.0, 0.1) for x in range(columns) for y in range(2)], float)
    faces = [
        (start + 2 * i + a, start + 2 * i + b, start + 2 * i + c)
        for start in (0, 2 * columns)
        for i in range(columns - 1)
        for a, b, c in ((0, 2, 1), (1, 2, 3))
    ]
    mesh = dfd.Mesh(grid, faces)
    rows = np.zeros((len(grid), 2), np.float32)
    rows[:2], rows[2 * columns :] = (1, 0), (0, 1)  # the lower strip is known at one end only
    with pytest.warns(UserWarning, match=r"^VertexField: `features` had 10 of 24 rows of zeros, filled from neighbors"):
        field = dfd.VertexField(mesh, rows)
    wanted = np.where(np.arange(len(grid))[:, None] < 2 * columns, [1, 0], [0, 1])
    np.testing.assert_array_equal(field.features(mesh), wanted)


def test_a_component_without_features_gets_those_of_the_nearest_vertex():
    mesh = dfd.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2], [3, 4, 5]])
    rows = np.zeros((6, 3), np.float32)
    rows[:3] = np.eye(3)
    with pytest.warns(UserWarning, match="3 of 6 rows"):
        np.testing.assert_array_equal(dfd.VertexField(mesh, rows).features(mesh)[3:], np.eye(3))


def test_features_of_faces_and_of_points():
    mesh = dfd.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 3, 0]], [[0, 1, 2], [2, 1, 3]])
    areas = np.array([0.5, 2.5])
    field = dfd.VertexField(mesh, np.eye(2), at="faces")
    shared = areas / np.linalg.norm(areas)
    np.testing.assert_allclose(field.features(mesh), [[1, 0], shared, shared, [0, 1]], atol=1e-6)
    near = dfd.VertexField(mesh, [[1, 0], [0, 2]], at=[[0, 0, 0.1], [2, 2, 0]])
    np.testing.assert_allclose(near.features(mesh), [[1, 0], [1, 0], [1, 0], [0, 1]], atol=1e-6)
    with pytest.raises(ValueError, match=r"`features` must have shape \(2, D\), a row for each face, got \(4, 2\)"):
        dfd.VertexField(mesh, np.ones((4, 2)), at="faces")
    with pytest.raises(ValueError, match=r"`features` must have shape \(1, D\), a row for each point, got \(4, 2\)"):
        dfd.VertexField(mesh, np.ones((4, 2)), at=[[0, 0, 0]])
    with pytest.raises(ValueError, match="`at` must be one of faces, got 'edges'"):
        dfd.VertexField(mesh, np.ones((4, 2)), at="edges")


def test_a_saved_field_gives_the_same_features(mesh, rows, tmp_path):
    field = dfd.VertexField(mesh, rows, settings={"of": "a network"})
    field.save(tmp_path / "given.field.safetensors")
    again = dfd.Field.load(tmp_path / "given.field.safetensors", mesh=mesh)
    assert isinstance(again, dfd.VertexField)
    points = np.random.default_rng(0).standard_normal((40, 3))
    np.testing.assert_allclose(again(points), field(points), atol=1e-7)
    assert (again.settings, again.scale, repr(again)) == (field.settings, field.scale, repr(field))
    again.save(tmp_path / "again.safetensors")
    assert dfd.Field.load(tmp_path / "again.safetensors").dimension == 12
    session = dfd.Deformer(mesh, again)
    session.add(17, translation=(0, 0.1, 0))
    session.save(tmp_path / "edit.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": None}, "`rows` is missing"),
        ({"of_vertex": np.array([0, 10**6])}, "`of_vertex` must lie in"),
        ({"places": np.zeros((2, 3))}, "`places` must have shape"),
        ({"scale": np.array(-1.0)}, "`scale` must be above 0"),
    ],
)
def test_a_damaged_file_is_refused(mesh, rows, tmp_path, change, message):
    from dfd.field import field_file

    dfd.VertexField(mesh, rows).save(tmp_path / "field.safetensors")
    architecture, arrays, settings = field_file.read(tmp_path / "field.safetensors")
    changed = {name: value for name, value in (arrays | change).items() if value is not None}
    field_file.write(tmp_path / "field.safetensors", architecture, changed, settings)
    with pytest.raises(ValueError, match=r"^Field.load: `path` .* is damaged: " + message):
        dfd.Field.load(tmp_path / "field.safetensors")
