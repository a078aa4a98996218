"""Test the graph of a mesh: edges, and bridges where components touch or nearly touch."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import CORNERS, CUBE
from scipy.sparse.csgraph import connected_components, dijkstra

from dfd.geometry.surface_graph import bridges, surface_graph
from dfd.mesh.mesh import Mesh


def cubes(*places, size=1.0):
    vertices = np.vstack([CORNERS * size + place for place in places])
    return Mesh(vertices, np.vstack([CUBE + 8 * number for number in range(len(places))]))


def component_count(mesh):
    return int(connected_components(surface_graph(mesh), directed=False)[0])


def test_a_mesh_in_one_component_is_its_edges():
    graph = surface_graph(Mesh(CORNERS, CUBE))
    ends = np.unique(np.sort(CUBE[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    assert graph.shape == (8, 8)
    assert graph.nnz == 2 * len(ends)
    for a, b in ends:
        assert graph[a, b] == graph[b, a] == pytest.approx(np.linalg.norm(CORNERS[a] - CORNERS[b]))


def test_components_that_touch_nearly_touch_or_cross_are_joined():
    assert component_count(cubes((0, 0, 0), (1, 0, 0))) == 1
    assert component_count(cubes((0, 0, 0), (1.03, 0.3, 0))) == 1  # 1.3 % of the diagonal
    assert component_count(cubes((0, 0, 0), (0.9, 0.4, 0.4))) == 1
    legs = trimesh.util.concatenate(
        [trimesh.creation.box((1, 0.1, 1)), trimesh.creation.box((0.1, 1, 0.1)).apply_translation((0.3, -0.5, 0.3))]
    )
    assert component_count(Mesh(legs.vertices, legs.faces)) == 1


def test_components_that_are_truly_separate_stay_apart():
    assert component_count(cubes((0, 0, 0), (1.2, 0, 0))) == 2
    assert component_count(cubes((0, 0, 0), (1.01, 0, 0), (4, 0, 0))) == 2


def test_legs_that_meet_at_the_hips_are_not_bridged_at_the_knees():
    hips, left, right = (trimesh.creation.box(size) for size in ((1, 0.2, 1), (0.4, 2, 0.4), (0.4, 2, 0.4)))
    left.apply_translation((-0.215, -1.1, 0))
    right.apply_translation((0.215, -1.1, 0))  # the legs are 0.03 apart, about 1.2 % of the diagonal
    body = trimesh.util.concatenate([hips, left, right])
    for _ in range(3):
        body = body.subdivide()
    mesh = Mesh(body.vertices, body.faces)
    graph = surface_graph(mesh)
    assert connected_components(graph, directed=False)[0] == 1
    low = mesh.vertices[:, 1] < -1
    sides = np.sign(mesh.vertices[:, 0])
    rows, columns = graph.nonzero()
    assert not np.any(low[rows] & low[columns] & (sides[rows] * sides[columns] < 0))
    toe = int(np.argmin(mesh.vertices @ [1, 1, 0]))
    other = int(np.argmin(mesh.vertices @ [-1, 1, 0]))
    assert dijkstra(graph, indices=toe)[other] > 3.5


def test_shared_and_nearly_shared_positions_are_joined_at_no_distance():
    soup = Mesh(CORNERS[CUBE].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    whole = dijkstra(surface_graph(Mesh(CORNERS, CUBE)), indices=0)
    assert dijkstra(surface_graph(soup), indices=0)[CUBE.ravel() == 0].max() < 1e-300
    shaken = Mesh(soup.vertices + np.random.default_rng(0).uniform(-1e-8, 1e-8, (36, 3)), soup.faces)
    for mesh in (soup, shaken):
        found = dijkstra(surface_graph(mesh), indices=int(np.flatnonzero(CUBE.ravel() == 0)[0]))
        assert np.allclose(found, whole[CUBE.ravel()], atol=1e-6)


def test_vertices_of_no_face_are_joined_to_what_is_near():
    mesh = Mesh(np.vstack([CORNERS, [(0, 0, 1.01), (0, 0, 3)]]), CUBE)
    graph = surface_graph(mesh)
    corner = int(np.flatnonzero((CORNERS == (0, 0, 1)).all(axis=1))[0])
    assert graph[8, corner] == pytest.approx(0.01)
    assert graph[[9]].nnz == 0


@pytest.mark.parametrize("scale", [1e-200, 1.0, 1e155])
def test_lengths_are_in_the_units_of_the_mesh(scale):
    plain = surface_graph(cubes((0, 0, 0), (1.03, 0.3, 0)))
    mesh = cubes((0, 0, 0), (1.03, 0.3, 0))
    scaled = surface_graph(Mesh(mesh.vertices * scale, mesh.faces))
    assert np.array_equal(scaled.indices, plain.indices)
    assert np.allclose(scaled.data / scale, plain.data)


@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_confetti_gives_a_symmetric_graph_that_keeps_every_edge(seed, count):
    random = np.random.default_rng(seed)
    vertices = np.round(random.uniform(0, 1, (count + 3, 3)), int(random.integers(1, 4)))
    mesh = Mesh(vertices, random.integers(0, count + 3, (count, 3)))
    graph = surface_graph(mesh)
    assert abs(graph - graph.T).nnz == 0
    assert np.isfinite(graph.data).all()
    assert (graph.data > 0).all()
    for a, b in mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2):
        assert a == b or graph[a, b] == pytest.approx(np.linalg.norm(vertices[a] - vertices[b]))


def test_bridges_of_dense_confetti_stay_few():
    """With many components near each other, the number of bridges must not grow with the square of their number."""
    random = np.random.default_rng(0)
    corners = random.uniform(0, 1, (20_000, 1, 3)) + random.uniform(-0.01, 0.01, (20_000, 3, 3))
    corners[:, :, 2] *= 0.001
    faces = np.arange(60_000).reshape(-1, 3)
    component = np.repeat(np.arange(20_000), 3)
    assert 1_000 < len(bridges(corners.reshape(-1, 3), faces, component)) < 40 * 20_000
