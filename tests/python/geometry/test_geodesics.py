"""Distances along the surface: against exact ones, on broken meshes, and through the coarse stand-in."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE

from dfd.geometry.coarse import closest_on_triangles, coarsen
from dfd.geometry.geodesics import Geodesics
from dfd.mesh.mesh import Mesh, load


@pytest.fixture(scope="module")
def sphere() -> Mesh:
    made = trimesh.creation.icosphere(4)
    return Mesh(made.vertices, made.faces)


def on_sphere(mesh: Mesh, handle: int) -> np.ndarray:
    """The exact distance on a unit sphere, largest 1."""
    angle = np.arccos(np.clip(mesh.vertices @ mesh.vertices[handle], -1, 1))
    return angle / angle.max()


def test_distances_on_a_sphere_are_angles(sphere: Mesh) -> None:
    found = Geodesics(sphere).distances([0, 7, 100])
    assert found.shape == (3, len(sphere.vertices))
    assert found.dtype == np.float32
    for row, handle in zip(found, (0, 7, 100), strict=True):
        assert row[handle] == 0
        assert row.max() == 1
        assert np.abs(row - on_sphere(sphere, handle)).mean() < 0.01


@pytest.mark.parametrize("dtype", [np.float16, "float16"])
def test_half_the_memory_loses_next_to_nothing(sphere: Mesh, dtype: object) -> None:
    geodesics = Geodesics(sphere)
    full, halves = geodesics.distances([0, 7]), geodesics.distances([0, 7], dtype=dtype)
    assert halves.dtype == np.float16
    assert halves.nbytes == full.nbytes / 2
    assert np.abs(halves - full).max() <= 2.5e-4
    assert halves[0, 0] == 0
    assert np.array_equal(halves.max(axis=1), [1, 1])


@pytest.mark.parametrize("dtype", [np.float64, np.int8, "half a float", None])
def test_other_types_of_distances_are_refused(sphere: Mesh, dtype: object) -> None:
    with pytest.raises(ValueError, match="Geodesics.distances: `dtype` must be float32 or float16, got"):
        Geodesics(sphere).distances([0], dtype=dtype)


@pytest.mark.parametrize(("coarse_faces", "allowed"), [(1000, 0.025), (2500, 0.016), (8000, 0.01)])
def test_a_coarse_stand_in_loses_little(coarse_faces: int, allowed: float) -> None:
    made = trimesh.creation.icosphere(5)
    mesh = Mesh(made.vertices, made.faces)
    handles = [5, 3000, 9999]
    found = Geodesics(mesh, coarse_faces=coarse_faces).distances(handles)
    assert np.all(found >= 0)
    for row, handle in zip(found, handles, strict=True):
        error = np.abs(row - on_sphere(mesh, handle))
        assert error.mean() < allowed
        near = np.argsort(on_sphere(mesh, handle))[:50]
        assert error[near].max() < 0.01
        assert row[handle] == 0
        assert np.argmin(row) == handle


def test_simplification_of_flat_ground_puts_no_point_astray() -> None:
    """A box cut into many coplanar faces: there, quadrics leave the place of a point nearly free."""
    vertices, faces = CORNERS, CUBE
    for _ in range(6):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    coarse = coarsen(vertices, faces.astype(np.int32), 2000)
    assert len(coarse.faces) <= 2000
    assert coarse.vertices.min() > -0.05
    assert coarse.vertices.max() < 1.05
    carried = np.stack([coarse.carry(axis) for axis in coarse.vertices.T], axis=1)
    assert np.linalg.norm(carried - vertices, axis=1).max() < 0.05


def test_other_pieces_are_farthest() -> None:
    mesh = Mesh(np.vstack([CORNERS, CORNERS + 5]), np.vstack([CUBE, CUBE + 8]))
    found = Geodesics(mesh).distances([0])[0]
    assert np.all(found[8:] == 1)
    assert found[:8].max() == 1
    assert found[0] == 0
    assert np.argmax(found[:8]) == 7


def test_unwelded_and_repeated_faces_are_one_surface() -> None:
    soup = Mesh(CORNERS[CUBE].reshape(-1, 3), np.vstack([np.arange(36).reshape(-1, 3), [(0, 1, 2), (3, 3, 4)]]))
    welded = Geodesics(Mesh(CORNERS, CUBE)).distances([0])[0]
    found = Geodesics(soup).distances([0])[0]
    assert np.allclose(found, welded[CUBE.ravel()], atol=1e-6)


def test_edges_of_many_faces_are_no_obstacle() -> None:
    book = Mesh(
        np.vstack([[(0, 0, 0), (0, 0, 1)], [(np.cos(a), np.sin(a), 0.5) for a in np.linspace(0, 6, 7)]]),
        [(0, 1, i) for i in range(2, 9)],
    )
    found = Geodesics(book).distances([2, 0])
    assert np.isfinite(found).all()
    assert found[0, 0] < found[0, 4]


def test_a_handle_that_no_sound_face_uses() -> None:
    vertices = np.vstack([CORNERS, [(9, 9, 9), (9, 9, 9.5)]])
    found = Geodesics(Mesh(vertices, np.vstack([CUBE, [(8, 8, 9)]]))).distances([8, 0])
    assert found[0].tolist() == [1] * 8 + [0, 1]
    assert found[1, 8:].tolist() == [1, 1]


def test_a_mesh_without_any_sound_face() -> None:
    found = Geodesics(Mesh(CORNERS, [(0, 0, 1), (2, 2, 2)])).distances([3])
    assert found.tolist() == [[1, 1, 1, 0, 1, 1, 1, 1]]


def test_the_solver_failing_leaves_the_way_along_edges(sphere: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def compute_distance(self, corner: int) -> np.ndarray:
            return np.full(len(sphere.vertices), np.nan)

    monkeypatch.setattr("potpourri3d.MeshHeatMethodDistanceSolver", lambda *_, **__: Broken())
    found = Geodesics(sphere).distances([0])[0]
    assert np.abs(found - on_sphere(sphere, 0)).mean() < 0.05

    def refuses(*_: object, **__: object) -> None:
        raise RuntimeError("factorization failed")

    monkeypatch.setattr("potpourri3d.MeshHeatMethodDistanceSolver", refuses)
    assert np.array_equal(Geodesics(sphere).distances([0])[0], found)


def test_size_and_place_do_not_matter(sphere: Mesh) -> None:
    plain = Geodesics(sphere).distances([3])
    for scale, offset in ((1e-6, 0), (1e6, 0), (1, 1000)):
        moved = Mesh(sphere.vertices * scale + offset, sphere.faces)
        assert np.allclose(Geodesics(moved).distances([3]), plain, atol=2e-3)


def test_points_stand_for_their_nearest_vertices(sphere: Mesh) -> None:
    geodesics = Geodesics(sphere)
    points = sphere.vertices[[4, 50]] * 1.3
    assert np.array_equal(geodesics.distances(points), geodesics.distances([4, 50]))
    assert geodesics.distances([]).shape == (0, len(sphere.vertices))


@pytest.mark.parametrize(
    ("handles", "message"),
    [
        ([9999], "`handles` must lie in 0 … 2561, got 9999"),
        ([-1], "`handles` must lie in"),
        ([0.5], "`handles` must be a list of vertex indices"),
        (3, "`handles` must be a list of vertex indices"),
        (np.zeros((2, 2)), r"`handles` must have shape \(H, 3\), got \(2, 2\)"),
        ([[np.nan, 0, 0]], "`handles` must be finite"),
    ],
)
def test_bad_handles_are_refused(handles: object, message: str, sphere: Mesh) -> None:
    with pytest.raises(ValueError, match="Geodesics.distances: " + message):
        Geodesics(sphere).distances(handles)


def test_nothing_is_computed_before_the_first_question(sphere: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dfd.geometry.geodesics.coarsen", lambda *_: pytest.fail("too early"))
    Geodesics(sphere)
    with pytest.raises(ValueError, match="Geodesics: `coarse_faces` must be at least 100, got 10"):
        Geodesics(sphere, coarse_faces=10)


def test_closest_points_on_triangles_against_dense_sampling() -> None:
    random = np.random.default_rng(0)
    triangles, points = random.normal(size=(200, 3, 3)), random.normal(size=(200, 3)) * 2
    triangles[:20, 2] = triangles[:20, 1]  # slivers and points are triangles too
    triangles[:5, 1:] = triangles[:5, :1]
    weights, squared = closest_on_triangles(points, triangles)
    assert weights.min() >= 0
    assert np.allclose(weights.sum(axis=1), 1)
    share = np.stack(np.meshgrid(*[np.linspace(0, 1, 40)] * 2), axis=-1).reshape(-1, 2)
    share = share[share.sum(axis=1) <= 1 + 1e-9]
    sampled = np.einsum("sk,tkd->tsd", np.column_stack([1 - share.sum(axis=1), share]), triangles)
    best = ((sampled - points[:, None]) ** 2).sum(axis=2).min(axis=1)
    assert np.all(squared <= best + 1e-9)
    assert np.allclose(squared, best, atol=0.05)


@pytest.mark.skipif("DFD_MESHES" not in os.environ, reason="DFD_MESHES names no folder of meshes")
@pytest.mark.filterwarnings("ignore:load")
@pytest.mark.parametrize("name", ["chair_nonmanifold.obj", "truck_defects.obj", "knight.glb", "human_neutral.obj"])
def test_real_broken_meshes(name: str) -> None:
    mesh = load(Path(os.environ["DFD_MESHES"]) / name)
    handles = np.random.default_rng(0).integers(0, len(mesh.vertices), 5)
    found = Geodesics(mesh).distances(handles)
    assert np.isfinite(found).all()
    assert np.array_equal(found[np.arange(5), handles], np.zeros(5))
    assert np.all(found.max(axis=1) == 1)
