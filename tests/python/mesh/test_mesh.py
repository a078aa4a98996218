"""Tests of `Mesh`: read-only copies, bounds, normals, content hashes and errors for invalid arrays."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from mesh_files import CORNERS, CUBE

from dfd.geometry.normals import updated_normals
from dfd.mesh.mesh import Mesh, load
from dfd.mesh.normals import smooth_normals


def test_a_mesh_has_read_only_copies_of_arrays():
    vertices, faces = CORNERS.copy(), CUBE.copy()
    mesh = Mesh(vertices, faces)
    vertices[:] = 7
    faces[:] = 0
    assert np.array_equal(mesh.vertices, CORNERS)
    assert np.array_equal(mesh.faces, CUBE)
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int32
    for array in (mesh.vertices, mesh.faces, mesh.normals, mesh.bounds, mesh.extents):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_size_and_normals_of_a_cube():
    mesh = Mesh(CORNERS * 2, CUBE)
    assert mesh.bounds.tolist() == [[0, 0, 0], [2, 2, 2]]
    assert mesh.extents.tolist() == [2, 2, 2]
    assert mesh.diagonal == pytest.approx(np.sqrt(12))
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1)
    assert np.all(np.einsum("ij,ij->i", mesh.normals, CORNERS - 0.5) > 0.7)


def test_normals_of_faces_without_area_are_zero_not_nan():
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0), (5, 5, 5)], [(0, 1, 2), (0, 0, 1)])
    assert np.array_equal(mesh.normals, np.zeros((4, 3)))


def test_content_hashes_differ_only_if_meshes_differ():
    mesh, same = Mesh(CORNERS, CUBE), Mesh(CORNERS.copy(), CUBE.astype(np.int64))
    moved, turned = Mesh(CORNERS + 1e-12, CUBE), Mesh(CORNERS, CUBE[:, [1, 2, 0]])
    assert mesh.content_hash == same.content_hash
    assert len({mesh.content_hash, moved.content_hash, turned.content_hash}) == 3


def test_degenerate_and_duplicate_faces_are_kept():
    faces = [(0, 1, 3), (0, 1, 3), (2, 2, 2), (0, 1, 0)]
    assert Mesh(CORNERS, faces).faces.tolist() == [list(face) for face in faces]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (CORNERS[:, :2], CUBE, r"`vertices` must have shape \(V, 3\), got \(8, 2\)"),
        (CORNERS * np.nan, CUBE, r"`vertices` must be finite, got nan at \[0, 0\]"),
        (CORNERS[:2], [(0, 1, 1)], "`vertices` must hold at least 3 vertices, got 2"),
        (CORNERS, np.zeros((0, 3), int), "`faces` must hold at least one face"),
        (CORNERS, CUBE[:, :2], r"`faces` must be whole numbers of shape \(F, 3\), got int64 of shape \(12, 2\)"),
        (CORNERS, CUBE * 1.0, "`faces` must be whole numbers"),
        (CORNERS, CUBE + 1, r"`faces` must name vertices 0 … 7, got 8"),
    ],
)
def test_bad_arrays_are_refused(vertices, faces, message):
    with pytest.raises(ValueError, match=message):
        Mesh(vertices, faces)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.2, 1.0])
def test_updated_normals_equal_newly_computed_normals(quadruped_sample, share):
    mesh = quadruped_sample.mesh
    after = mesh.vertices.copy()
    after[: int(share * len(after))] += np.random.default_rng(0).normal(scale=0.01, size=(int(share * len(after)), 3))
    updated = updated_normals(mesh.normals, mesh.vertices, after, mesh.faces)
    np.testing.assert_allclose(updated, smooth_normals(after, mesh.faces), atol=1e-6)


def test_a_mesh_cannot_be_changed():
    mesh = Mesh(CORNERS, CUBE)
    before = mesh.content_hash, mesh.diagonal
    with pytest.raises(AttributeError, match="^Mesh: `vertices` cannot be set, because a mesh is immutable"):
        mesh.vertices = 2 * mesh.vertices
    with pytest.raises(AttributeError, match="cannot be set"):
        mesh.bounds = np.zeros((2, 3))
    with pytest.raises(AttributeError, match="cannot be deleted"):
        del mesh.faces
    assert (mesh.content_hash, mesh.diagonal) == before
    again = pickle.loads(pickle.dumps(mesh))
    assert again.content_hash == mesh.content_hash
    with pytest.raises(AttributeError, match="cannot be set"):
        again.faces = CUBE


def test_meshes_of_open3d_and_pyvista_are_read():
    open3d = SimpleNamespace(vertices=CORNERS, triangles=CUBE)
    surface = SimpleNamespace(points=CORNERS, regular_faces=CUBE, is_all_triangles=True)
    quads = SimpleNamespace(points=CORNERS, regular_faces=CUBE[:, :2], is_all_triangles=False)
    quads.triangulate = lambda: surface
    for source in (open3d, surface, quads):
        mesh = load(source)
        np.testing.assert_array_equal(mesh.vertices, CORNERS)
        np.testing.assert_array_equal(mesh.faces, CUBE)
