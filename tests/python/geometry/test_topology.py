"""Test counts of components and defects on meshes with known defects."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mesh_files import CORNERS, CUBE

from dfd.geometry.topology import inspect
from dfd.mesh.mesh import Mesh


def test_a_cube_is_one_closed_component() -> None:
    found = inspect(Mesh(CORNERS * 2, CUBE))
    assert (found.vertex_count, found.face_count, found.components) == (8, 12, 1)
    assert (found.boundary_edges, found.non_manifold_edges) == (0, 0)
    assert (found.degenerate_faces, found.duplicate_faces, found.unreferenced_vertices) == (0, 0, 0)
    assert found.extents == (2, 2, 2)
    assert (found.parts, found.materials, found.textures) == (1, 0, 0)


def test_positions_that_coincide_count_as_one_vertex_of_the_surface() -> None:
    soup = Mesh(CORNERS[CUBE].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    found = inspect(soup)
    assert (found.components, found.boundary_edges, found.vertex_count) == (1, 0, 36)


def test_faces_without_area_and_repeated_faces_are_counted_and_do_no_harm() -> None:
    vertices = np.vstack([CORNERS, [(0, 0, 2), (9, 9, 9)]])
    bad = [(0, 0, 1), (3, 3, 3), (0, 1, 8), CUBE[0], CUBE[1][[2, 1, 0]], CUBE[1][[1, 2, 0]]]
    found = inspect(Mesh(vertices, np.vstack([CUBE, bad])))
    assert found.degenerate_faces == 3
    assert found.duplicate_faces == 3
    assert found.unreferenced_vertices == 1
    assert found.components == 1


@pytest.mark.parametrize("offset", [0.0, 1e3, -1e6])
def test_a_small_face_far_from_the_origin_has_area(offset: float) -> None:
    vertices = np.array([(0, 0, 0), (1e-3, 0, 0), (0, 1e-3, 0), (2e-3, 0, 0)]) + offset
    found = inspect(Mesh(vertices, [(0, 1, 2), (0, 1, 3)]))
    assert found.degenerate_faces == 1


def test_counts_agree_with_trimesh_on_a_torn_sphere() -> None:
    sphere = trimesh.creation.icosphere(3)
    kept = np.random.default_rng(1).random(len(sphere.faces)) < 0.7
    torn = trimesh.Trimesh(sphere.vertices, sphere.faces[kept], process=False)
    found = inspect(Mesh(torn.vertices, torn.faces))
    counts = np.bincount(torn.edges_unique_inverse)
    assert found.boundary_edges == (counts == 1).sum()
    links = trimesh.graph.connected_component_labels(torn.edges, node_count=len(torn.vertices))
    assert found.components == len(np.unique(links[torn.faces]))
