"""Group the vertices of a large mesh into nodes. Functions that vary smoothly are fast to compute on the nodes."""

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple
from weakref import WeakKeyDictionary, ref

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, eye_array
from scipy.spatial import cKDTree

import dfd._core as _core
from dfd.common.linear_algebra import Bool, Float32, Float64, Int32, Int64, distinct_pairs, group_sums
from dfd.common.threads import get_num_threads
from dfd.geometry.surface_graph import GAPS, seam_links, surface_graph, surface_links
from dfd.geometry.topology import face_sides, first_at_place, vertex_areas
from dfd.mesh.mesh import Mesh

MOST_NODES = 40_000  # largest number of vertices of a mesh in which each vertex is a node
CELLS = 100  # number of grid cells along the longest side of the mesh's bounding box
SHORTEST = 1e-9  # smallest length of an edge, in diagonals, because 0 means no edge to graph algorithms
RUN = 1 << 17  # number of faces per batch, which limits temporary memory


class Share(NamedTuple):
    """The share of each vertex in a group: a number in [0, 1]. Only shares above 0 are stored."""

    vertices: NDArray[np.integer]  # (N,) ascending
    values: Float32  # (N,) in (0, 1]

    def at(self, vertex: int) -> float:
        """Return the share of one vertex."""
        place = int(np.searchsorted(self.vertices, vertex))
        known = place < len(self.vertices) and self.vertices[place] == vertex
        return float(self.values[place]) if known else 0.0

    def dense(self, count: int) -> Float32:
        """Return the shares of all `count` vertices, (count,)."""
        shares = np.zeros(count, np.float32)
        shares[self.vertices] = self.values
        return shares


class Nodes:
    """The nodes of a mesh. In a large mesh, a node is a group of vertices that are connected within a grid cell.

    Attributes
    ----------
    of_vertex
        (V,) the node of each vertex. In a mesh with at most `MOST_NODES` vertices, each vertex is a node.
    graph
        (N, N) distances between the centers of neighboring nodes, in mesh units.
    surface
        (N, N) `graph` without edges across gaps. Positions of a seam (`seam_links`) are neighbors.
    center
        (N, 3) mean position of each node's vertices.
    members, starts, ends
        The vertices of node n are `members[starts[n] : ends[n]]`.
    component
        (N,) index of the connected component of `surface` that contains each node.
    seams
        (L, 2) vertices at equal positions, or on both sides of an open seam (`seam_links`).
    used
        (N,) whether the node's component has a face. No other node belongs to a part of the shape.
    """

    def __init__(self, mesh: Mesh) -> None:
        vertices = mesh.vertices
        count = len(vertices)
        self.are_vertices = count <= MOST_NODES
        links = None if self.are_vertices else surface_links(mesh)
        self.seams = seams = seam_links(mesh)
        self.of_vertex = np.arange(count, dtype=np.int32)
        if links is not None:
            self.of_vertex = _clustered(mesh, seams)
            if self.of_vertex.max() >= MOST_NODES:  # thousands of leaves, for example
                self.of_vertex = _clustered(mesh, links)
        size = np.bincount(self.of_vertex)
        self.center = self.centers(vertices)
        self.surface = _contracted(mesh, seams, self.of_vertex, self.center)
        self.graph = (
            surface_graph(mesh) if links is None else _with_edges(self.surface, self.of_vertex[links], self.center)
        )
        self.members = np.argsort(self.of_vertex, kind="stable").astype(np.int32)
        self.ends = np.cumsum(size)
        self.starts = self.ends - size
        first = first_at_place(mesh)
        component = _core.components(len(first), first[mesh.faces], seams)[first]
        self.component = component[self.members[self.starts]]
        self.used = np.isin(self.component, component[mesh.faces.ravel()]) | (len(mesh.faces) == 0)
        self._vertices, self._faces = vertices, mesh.faces

    def centers(self, positions: Float64) -> Float64:
        """Return the mean (N, 3) of the `positions` (V, 3) of each node's vertices."""
        size = np.bincount(self.of_vertex)
        return group_sums(self.of_vertex, positions, len(size)) / size[:, None]

    def shares(self, parts: Float64) -> list[Share]:
        """Interpolate the rows of `parts` (K, N) to the vertices. Return each row, divided by the sum of all rows."""
        rows = parts.astype(np.float32)
        total = rows.sum(axis=0)
        found = []
        for row in rows:
            near = row if self.are_vertices else self.reach @ (row > 0).astype(np.float32)
            vertices = np.flatnonzero(near[self.of_vertex] > 0)
            some, all_of = self.interpolated(np.stack([row, total], axis=1), vertices).T
            above = some > 0
            found.append(Share(vertices[above].astype(np.int32), some[above] / all_of[above]))
        return found

    def interpolated(self, values: Float32, vertices: NDArray[np.integer] | None = None) -> Float32:
        """Return the `values` (N, K) of nodes, interpolated to `vertices` (M,), as (M, K). None means all vertices."""
        if self.are_vertices:
            return values[self.of_vertex if vertices is None else vertices]
        chosen = np.arange(len(self.of_vertex), dtype=np.int32) if vertices is None else vertices.astype(np.int32)
        rows = np.ascontiguousarray(values.reshape(len(self.center), -1), np.float32)
        found = _core.empty_float32(len(chosen), rows.shape[1])
        reach = self.reach
        index = self.of_vertex, reach.indptr, reach.indices, chosen
        _core.interpolate(self._vertices, self.center, *index, rows, found, get_num_threads())
        return found.reshape(len(chosen), *values.shape[1:])

    def known_at(self, field: NDArray[np.floating], vertices: Int64) -> Float64:
        """Interpolate `field` (N,) to `vertices` (M,). Nodes with infinite values are left out."""
        known = np.isfinite(field)
        rows = np.stack([np.where(known, field, 0.0), known], axis=1).astype(np.float32)
        found = self.interpolated(rows, vertices).astype(np.float64)
        some = found[:, 1] > 1e-6
        result: Float64 = field[self.of_vertex[vertices]].astype(np.float64)
        result[some] = np.where(np.isfinite(result[some]), found[some, 0] / found[some, 1], result[some])
        return result

    def nearest(self, points: ArrayLike, inside: Bool | None = None) -> Int64:
        """Return the vertex (M,) nearest to each of `points` (M, 3). Only the eight nearest nodes are searched.

        With `inside` (N,), only nodes for which it is True are searched.
        """
        queries = np.reshape(points, (-1, 3)).astype(np.float64)
        some = np.arange(len(self.center)) if inside is None else np.flatnonzero(inside)
        tree = self.tree if inside is None else cKDTree(self.center[some])
        around = some[tree.query(queries, k=min(8, len(some)))[1].reshape(len(queries), -1)]
        found = np.empty(len(queries), np.int64)
        for i, nodes in enumerate(around):
            members = np.concatenate([self.members[self.starts[node] : self.ends[node]] for node in nodes])
            found[i] = members[np.square(self._vertices[members] - queries[i]).sum(axis=1).argmin()]
        return found

    @cached_property
    def follows(self) -> Int64:
        """Return the node (N,) that each node follows: itself, or without faces, the nearest one with faces nearby."""
        follows, stray, used = np.arange(len(self.center)), np.flatnonzero(~self.used), np.flatnonzero(self.used)
        if len(stray) and len(used):
            bound = GAPS[-1] * float(np.linalg.norm(np.ptp(self.center[used], axis=0)))
            apart, nearest = cKDTree(self.center[used]).query(self.center[stray], distance_upper_bound=bound)
            follows[stray[np.isfinite(apart)]] = used[nearest[np.isfinite(apart)]]
        return follows

    @cached_property
    def area(self) -> Float64:
        """Return the area (N,) of each node, in squared mesh units."""
        areas = vertex_areas(self._vertices, self._faces)
        return np.bincount(self.of_vertex, areas, len(self.center)).astype(np.float64)

    @cached_property
    def tree(self) -> cKDTree:
        """Return the search tree of the centers."""
        return cKDTree(self.center)

    @cached_property
    def reach(self) -> csr_array:
        """Return a matrix (N, N): row n has the nodes from which values at node n's vertices are interpolated."""
        reach = csr_array(self.graph.astype(bool) + eye_array(len(self.center), dtype=bool))
        reach.indptr, reach.indices = reach.indptr.astype(np.int32), reach.indices.astype(np.int32)
        return reach


_NODES: WeakKeyDictionary[Mesh, ref[Nodes]] = WeakKeyDictionary()


def nodes_of(mesh: Mesh) -> Nodes:
    """Return the nodes of a mesh. Later calls with this mesh return the same object, while that object is in use."""
    known = _NODES.get(mesh)
    nodes = None if known is None else known()
    if nodes is None:
        nodes = Nodes(mesh)
        _NODES[mesh] = ref(nodes)
    return nodes


def _clustered(mesh: Mesh, links: Int32) -> Int32:
    """Return the node of each vertex, (V,). Vertices that are connected within a grid cell form one node.

    The middle of the mesh is the center of a cell, so the cells of a symmetric mesh are symmetric.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, cell = (low + high) / 2, float((high - low).max()) / CELLS
    key = np.zeros(len(mesh.vertices), np.int32)
    for axis in range(3):
        key *= CELLS + 1
        key += np.rint((mesh.vertices[:, axis] - middle[axis]) / cell).astype(np.int32) + CELLS // 2
    inside = [ends[key[ends[:, 0]] == key[ends[:, 1]]] for ends in _edges(mesh, links)]
    return _core.components(len(key), np.zeros((0, 3), np.int32), np.concatenate(inside))


def _contracted(mesh: Mesh, links: Int32, of_vertex: Int32, center: Float64) -> csr_array:
    """Return the graph (N, N) of neighboring nodes. Its entries are the distances between the centers of the nodes."""
    found = [np.zeros((0, 2), np.int64)]
    for ends in _edges(mesh, links):
        nodes = of_vertex[ends]
        found.append(distinct_pairs(nodes[nodes[:, 0] != nodes[:, 1]], len(center))[0])
    return _graph(np.concatenate(found), center)


def _with_edges(graph: csr_array, pairs: Int32, center: Float64) -> csr_array:
    """Return `graph` (N, N) with further edges between the `pairs` (L, 2) of nodes."""
    row = np.repeat(np.arange(len(center)), np.diff(graph.indptr))
    return _graph(np.concatenate([np.stack([row, graph.indices], axis=1), pairs[pairs[:, 0] != pairs[:, 1]]]), center)


def _graph(pairs: NDArray[np.integer], center: Float64) -> csr_array:
    """Return the symmetric graph (N, N) with edges between the `pairs` (E, 2) of nodes, by the distance of `center`."""
    low, high = distinct_pairs(pairs, len(center))[0].T
    least = SHORTEST * float(np.linalg.norm(np.ptp(center, axis=0))) + np.finfo(float).tiny
    length = np.maximum(np.linalg.norm(center[low] - center[high], axis=1), least)
    both = np.concatenate([low, high]), np.concatenate([high, low])
    graph = csr_array((np.concatenate([length, length]), both), shape=(len(center), len(center)))
    graph.sort_indices()
    return graph


def _edges(mesh: Mesh, links: Int32) -> Iterator[Int32]:
    """Yield the ends (E, 2) of the faces' sides, one batch of faces after the other, and at the end `links` (L, 2)."""
    for start in range(0, len(mesh.faces), RUN):
        yield face_sides(mesh.faces[start : start + RUN])
    yield links
