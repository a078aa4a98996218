"""`dfd.VertexField`: features of the vertices as they are given, in place of a field."""

import json
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
        (
            lambda rows, mesh: rows[:-1],
            r"`features` must have shape .*, a row for each vertex, or .*, a row for each face, got \(\d+, 12\)$",
        ),
        (lambda rows, mesh: rows[:, :0], r"`features` must have shape"),
        (lambda rows, mesh: rows * np.nan, "`features` must be finite"),
        (
            lambda rows, mesh: rows * (np.arange(len(rows)) != 3)[:, None],
            "rows with a direction, got only zeros in row 3",
        ),
    ],
)
def test_what_is_no_row_for_each_vertex_is_refused(mesh, rows, change, message):
    with pytest.raises(ValueError, match=message):
        dfd.VertexField(mesh, change(rows, mesh))


def test_a_file_of_another_network_is_loaded_as_a_field(mesh, rows, tmp_path):
    np.save(tmp_path / "chair.npy", rows)
    said = {"mode": "vertex", "num_vertices": len(rows), "feature_shape": list(rows.shape)}
    (tmp_path / "chair.json").write_text(json.dumps(said))
    field = dfd.Field.load(tmp_path / "chair.npy", mesh=mesh)
    assert isinstance(field, dfd.VertexField)
    np.testing.assert_array_equal(field.features(mesh), dfd.VertexField(mesh, rows).features(mesh))


def test_files_that_are_not_of_the_mesh_are_refused(mesh, rows, tmp_path):
    np.save(tmp_path / "few.npy", rows[:5])
    with pytest.raises(ValueError, match=r"Field.load: `path` .*few.npy: `features` must have shape"):
        dfd.Field.load(tmp_path / "few.npy", mesh=mesh)
    with pytest.raises(ValueError, match=r"Field.load: `mesh` must be given for .*few.npy"):
        dfd.Field.load(tmp_path / "few.npy")
    (tmp_path / "text.npy").write_text("1 2")
    with pytest.raises(ValueError, match=r"Field.load: `path` must be an .npy file of numbers"):
        dfd.Field.load(tmp_path / "text.npy", mesh=mesh)
    (tmp_path / "few.json").write_text('{"mode": "vertex", "num_vertices": 9, "feature_shape": [5, 12]}')
    with pytest.raises(ValueError, match=r"must be of this mesh, which has \d+ vertices, but .*few.json says 9"):
        dfd.Field.load(tmp_path / "few.npy", mesh=mesh)


def test_a_diff3f_file_is_a_tensor_of_half_precision(mesh, tmp_path):
    rows = torch.randn((len(mesh.vertices), 2048), generator=torch.Generator().manual_seed(0)).half()
    torch.save(rows, tmp_path / "chair.pt")
    field = dfd.Field.load(tmp_path / "chair.pt", mesh=mesh)
    assert field.dimension == 2048
    np.testing.assert_array_equal(field.features(mesh), dfd.VertexField(mesh, rows.float().numpy()).features(mesh))


def test_partfield_rows_of_faces_become_those_of_vertices(mesh, tmp_path):
    rows = np.random.default_rng(0).normal(size=(len(mesh.faces), 448)).astype(np.float32)
    np.save(tmp_path / "part_feat_chair_0_batch.npy", rows)
    dfd.Mesh(mesh.vertices * 3 + 1, mesh.faces).save(tmp_path / "feat_pca_chair_0.ply")
    found = dfd.Field.load(tmp_path / "part_feat_chair_0_batch.npy", mesh=mesh).features(mesh)
    sides = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1)
    vertex = 17
    around = (mesh.representative[mesh.faces] == mesh.representative[vertex]).any(axis=1)
    mean = (areas[around, None] * unit(rows[around])).sum(axis=0)
    np.testing.assert_allclose(found[vertex], mean / np.linalg.norm(mean), atol=1e-5)
    assert len(found) == len(mesh.vertices)
