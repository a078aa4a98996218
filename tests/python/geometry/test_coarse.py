"""Test the clustering of a fine mesh into nodes, its memory use, and the shares of vertices."""

import tracemalloc

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from sheet import grid

import dfd
from dfd.editing.weights.by_features import shares_everywhere
from dfd.editing.weights.held_part import hold
from dfd.geometry import coarse
from dfd.geometry.coarse import Nodes
from dfd.geometry.surface_graph import surface_graph


@pytest.fixture
def small_runs(monkeypatch):
    """Lower the limits, so that meshes of a few thousand vertices are clustered, in many batches."""
    monkeypatch.setattr(coarse, "MOST_NODES", 500)
    monkeypatch.setattr(coarse, "CELLS", 12)
    monkeypatch.setattr(coarse, "RUN", 300)


@pytest.mark.parametrize("sample", ["chair", "quadruped"])
def test_nodes_are_what_the_whole_graph_has_within_each_cell(small_runs, sample):
    mesh = getattr(dfd.samples, sample)(4000).mesh
    gathered = Nodes(mesh)
    graph = surface_graph(mesh).tocoo()
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    cell = np.rint((mesh.vertices - (low + high) / 2) / ((high - low).max() / 12)).astype(int)
    row, column = graph.coords
    graph.data[(cell[row] != cell[column]).any(axis=1)] = 0
    graph.eliminate_zeros()
    wanted = connected_components(graph, directed=False)[1]
    np.testing.assert_array_equal(gathered.of_vertex, wanted)
    for node in (0, len(gathered.starts) // 2, len(gathered.starts) - 1):
        members = gathered.members[gathered.starts[node] : gathered.ends[node]]
        np.testing.assert_array_equal(members, np.flatnonzero(wanted == node))
        np.testing.assert_allclose(gathered.center[node], mesh.vertices[members].mean(axis=0), atol=1e-12)


def test_many_counterparts_on_a_fine_mesh_take_no_column_each():
    mesh = grid(300)
    x, z = mesh.vertices[:, 0], mesh.vertices[:, 2]
    weights = (np.abs(np.sin(8 * np.pi * x) * np.sin(8 * np.pi * z)) ** 2).astype(np.float32)
    vertex = int(weights.argmax())
    nodes = coarse.nodes_of(mesh)
    _ = nodes.tree
    on_hill = weights[nodes.members[nodes.starts]] > 0.5
    component = np.full(len(on_hill), -1)
    component[on_hill] = connected_components(nodes.graph[on_hill][:, on_hill], directed=False)[1]
    own = component[nodes.of_vertex[vertex]]
    component = np.where(component == own, 0, np.where((component >= 0) & (component < own), component + 1, component))
    tracemalloc.start()
    try:
        held = hold(mesh, component, vertex, mesh.vertices[vertex], weights)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(held.components) == 64
    assert peak < 1.5 * 64 * len(mesh.vertices) * 4  # a dense column each would take twice as much
    everywhere = shares_everywhere(held, mesh.diagonal)
    fifth = held.components[5]
    assert held.at(fifth.counterpart.vertex) == 5
    np.testing.assert_allclose(sum(each.dense(len(mesh.vertices)) for each in everywhere), 1, atol=1e-5)
