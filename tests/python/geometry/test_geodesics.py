"""Test distances along the surface: exact values, a slow reference, gaps, and defective meshes."""

import copy
import pickle

import numpy as np
import pytest
import reference
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import CORNERS, CUBE

import dfd
from dfd import _core
from dfd.geometry.geodesics import Geodesics
from dfd.geometry.refine import split_long_edges
from dfd.mesh.mesh import Mesh


def sphere_of(subdivisions):
    made = trimesh.creation.icosphere(subdivisions)
    return Mesh(made.vertices, made.faces)


@pytest.fixture(scope="module")
def sphere():
    return sphere_of(4)


def on_sphere(mesh, handle):
    """Return the exact distances (V,) from `handle` on a unit sphere, divided by the largest distance π."""
    return np.arccos(np.clip(mesh.vertices @ mesh.vertices[handle], -1, 1)) / np.pi


@pytest.mark.parametrize(("subdivisions", "sampled"), [(4, True), (6, True), (6, False)])
def test_distances_on_a_sphere_are_angles(subdivisions, sampled):
    """The solver uses all 2,562 vertices, samples of 40,962 vertices, and all 40,962 vertices."""
    mesh = sphere_of(subdivisions)
    geodesics = Geodesics(mesh, sampled=sampled)
    assert geodesics.extent == pytest.approx(np.pi, rel=0.01)
    found = geodesics.distances([5, 1000, 2500])
    assert found.dtype == np.float32
    for row, handle in zip(found, (5, 1000, 2500), strict=True):
        error = np.abs(row - on_sphere(mesh, handle))
        assert error.mean() < 0.005
        assert error.max() < 0.015
        near = np.argsort(on_sphere(mesh, handle))[:50]
        assert error[near].max() < 0.001
        assert row[handle] == 0
        assert np.argmin(row) == handle


def test_distances_between_samples_rise_as_steadily_as_the_surface():
    """Without slopes between samples, distances would rise in steps, up to 1.6 times as fast as the edge is long."""
    mesh = sphere_of(6)
    edges = np.concatenate([mesh.faces[:, :2], mesh.faces[:, 1:]])
    lengths = np.linalg.norm(np.subtract(*mesh.vertices[edges.T]), axis=1)
    geodesics = Geodesics(mesh)
    for row in geodesics.distances([5, 1000, 2500]).astype(np.float64) * geodesics.extent:
        assert np.abs(np.subtract(*row[edges.T]) / lengths).max() < 1.2


@given(st.integers(0, 2**32 - 1), st.integers(3, 40), st.integers(0, 60), st.integers(0, 5))
def test_the_kernel_agrees_with_its_twin(seed, count, face_count, link_count):
    """Random faces include non-manifold edges, repeated faces, and faces without area."""
    random = np.random.default_rng(seed)
    vertices = random.uniform(-1, 1, (count, 3))
    faces = random.integers(0, count, (face_count, 3)).astype(np.int32)
    links = random.integers(0, count, (link_count, 2)).astype(np.int32)
    solver = _core.Geodesics(vertices, faces, links, count, 1)
    out = np.empty((1, count), np.float32)
    solver.distances(np.array([0]), 0.25, out, 1)
    wanted = reference.surface_distances(vertices, faces, links, 0)
    joined = np.isfinite(wanted)
    assert np.all(out[0, ~joined] == 0.25)
    assert solver.extent >= wanted[joined].max() - 1e-5
    assert np.allclose(out[0, joined] * solver.extent, wanted[joined], atol=1e-5)


def test_components_that_touch_are_near_and_others_farthest():
    seat = trimesh.creation.box((1, 0.1, 1))
    leg = trimesh.creation.box((0.1, 1, 0.1)).apply_translation((0.4, -0.54, 0.4))  # inside the seat
    far = trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((3, 0, 0))
    parts = trimesh.util.concatenate([seat, leg, far])
    mesh = Mesh(parts.vertices, parts.faces)
    geodesics = Geodesics(mesh)
    foot = 8 + int(np.argmin(leg.vertices[:, 1]))
    row = geodesics.distances([foot])[0] * geodesics.extent
    nearest = np.linalg.norm(seat.vertices - mesh.vertices[foot], axis=1)
    assert np.all(row[:8] >= nearest - 0.05)
    assert row[:8].min() < 1.4
    assert np.all(geodesics.distances([foot])[0, 16:] == 1)
    assert np.all(geodesics.distances([foot], separate=0.5)[0, 16:] == 0.5)
    assert np.all(geodesics.distances([16])[0, :16] == 1)


def test_long_edges_are_halved_and_shared():
    vertices, faces = split_long_edges(CORNERS, CUBE.astype(np.int32), 0.3, most=10_000)
    fine = trimesh.Trimesh(vertices, faces, process=False)
    assert np.array_equal(vertices[:8], CORNERS)
    assert fine.edges_unique_length.max() <= 0.3
    assert fine.is_watertight
    assert fine.area == pytest.approx(6)
    assert fine.volume == pytest.approx(1)
    few, _ = split_long_edges(CORNERS, CUBE.astype(np.int32), 1e-6, most=1000)
    assert 8 < len(few) < 4000
    same, kept = split_long_edges(CORNERS, CUBE.astype(np.int32), 2.0, most=1000)
    assert np.array_equal(same, CORNERS)
    assert np.array_equal(kept, CUBE)


def test_vertices_that_no_face_uses():
    vertices = np.vstack([CORNERS, [(9, 9, 9), (9, 9, 9.5)]])
    found = Geodesics(Mesh(vertices, np.vstack([CUBE, [(8, 8, 9)]]))).distances([8, 0])
    assert found[0, :8].tolist() == [1] * 8
    assert found[0, 8] == 0
    assert 0 < found[0, 9] < 1
    assert found[1, 8:].tolist() == [1, 1]


def test_a_mesh_of_one_point_and_one_without_area():
    assert Geodesics(Mesh(np.ones((3, 3)), [(0, 1, 2)])).distances([1]).tolist() == [[0, 0, 0]]
    found = Geodesics(Mesh(CORNERS, [(0, 0, 1), (2, 2, 2)])).distances([3])
    assert found[0, 3] == 0
    assert np.isfinite(found).all()


@pytest.mark.parametrize(("scale", "offset"), [(1e-6, 0), (1e6, 0), (1, 1000), (1e155, 0), (1e-200, 0)])
def test_size_and_place_do_not_matter(sphere, scale, offset):
    plain = Geodesics(sphere)
    moved = Geodesics(Mesh(sphere.vertices * scale + offset, sphere.faces))
    assert np.allclose(moved.distances([3]), plain.distances([3]), atol=1e-5)
    assert moved.extent / scale == pytest.approx(plain.extent, rel=1e-5)


@pytest.mark.parametrize(
    ("handles", "message"),
    [
        ([9999], "`handles` must lie in 0 … 2561, got 9999"),
        ([0.5], "`handles` must be a list of vertex indices"),
        (np.zeros((2, 2)), r"`handles` must have shape \(H, 3\), got \(2, 2\)"),
        ([[np.nan, 0, 0]], "`handles` must be finite"),
    ],
)
def test_bad_handles_are_refused(handles, message, sphere):
    with pytest.raises(ValueError, match="Geodesics.distances: " + message):
        Geodesics(sphere).distances(handles)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
def test_copies_give_the_same_distances(copied):
    mesh = dfd.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [2, 1, 3]])
    own = dfd.Geodesics(mesh, bridges=False)
    wanted = own.distances([0])
    again = copied(own)
    assert repr(again) == repr(own)
    np.testing.assert_array_equal(again.distances([0]), wanted)


def test_negative_indices_and_masks_count_as_in_numpy(sphere):
    geodesics, count = Geodesics(sphere), len(sphere.vertices)
    mask = np.isin(np.arange(count), [3, count - 1])
    wanted = geodesics.distances([3, count - 1])
    np.testing.assert_array_equal(geodesics.distances([3, -1]), wanted)
    np.testing.assert_array_equal(geodesics.distances(mask), wanted)
    assert dfd.parts(sphere, dfd.VertexField(sphere, np.ones((count, 1)))).part(-1).vertex == count - 1
