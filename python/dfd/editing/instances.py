"""Instances of a handle: the places of a shape that look like the one it holds, each with a pivot and a frame.

The weight of a handle has a peak at the handle, one on every other leg, and low ones wherever something resembles it
from afar. A peak counts by its persistence, how deep the weight falls before higher ground is reached along the surface
(Edelsbrunner, Letscher and Zomorodian, "Topological persistence and simplification", 2002): ripples on one leg are no
legs. Turned or scaled about the one pivot of the handle, what lies far from it would swing and fly; each instance moves
about its own counterpart of the pivot instead, mirrored where a plane of symmetry relates it to the handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from dfd.geometry.surface_graph import surface_graph

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["Instance", "InstanceFinder"]

MOST_NODES = 20_000  # of the graph on which peaks are looked for; a finer mesh is gathered into fewer
CELLS = 100  # along the longest side, in which it is gathered
LEAST_PERSISTENCE = 0.05  # of weight: below, the field's own ripples have peaks
LEAST_WEIGHT = 0.15  # of a peak; lower ones go with the instance that is nearest
MOST_INSTANCES = 64  # the highest peaks; every one costs a column of weights
SHARPNESS = 2  # of the passage from one instance to the next: shares fall with this power of the distance
CLEAR = 0.03  # a share below this part of the largest is none, so that an instance is moved by itself alone
AS_ALIKE = 0.05  # of weight: by so much less alike, the mirror image of the handle is still preferred to a peak

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Instance:
    """One place that moves with a handle.

    Attributes
    ----------
    vertex
        Its counterpart of the handle: the vertex that looks most like it.
    position
        (3,) where that is, mesh units; for the handle's own instance the handle's own position.
    frame
        (3, 3) orthogonal: turns directions at the handle into those at the counterpart; a reflection where a plane of
        symmetry lies between them.
    weight
        How much it follows the handle, the weight at its counterpart.
    share
        (V,) the part of every vertex's weight that is this instance's, in [0, 1]; over all instances it adds up to 1.
        None stands for all of it, where the handle has one instance.
    """

    vertex: int
    position: tuple[float, float, float]
    frame: Float64
    weight: float
    share: Float32 | None

    def transform(self, affine: Float64, position: Sequence[float]) -> Float64:
        """The (3, 4) map that does here what `affine` does at a handle at `position` (3,)."""
        if np.array_equal(affine, np.eye(3, 4)):  # to the bit: a handle at rest changes nothing anywhere
            return np.eye(3, 4)
        here, there = np.asarray(self.position), np.asarray(position, np.float64)
        linear = self.frame @ affine[:, :3] @ self.frame.T
        moved = affine[:, :3] @ there + affine[:, 3] - there  # what the handle itself is moved by
        return np.column_stack([linear, here + self.frame @ moved - linear @ here])


class InstanceFinder:
    """Finds instances on one mesh; what does not depend on the handle is computed once, when it is first needed."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    def prepare(self) -> None:
        """Compute what does not depend on the handle, seconds for a million faces, before a person waits for it."""
        _ = self._nodes, self._tree

    def find(
        self,
        weights: NDArray[np.floating],
        vertex: int,
        position: Sequence[float],
        *,
        planes: Sequence[SymmetryPlane] = (),
    ) -> tuple[Instance, ...]:
        """Find the instances of a handle.

        Parameters
        ----------
        weights
            (V,) of the handle by looks alone, without what holds it back.
        vertex, position
            Where it is: the vertex nearest to it, and (3,) mesh units.
        planes
            Planes of symmetry of the shape, for frames.

        Returns
        -------
        The handle's own instance first, then the others, the most alike first.
        """
        x, y, z = (float(value) for value in position)
        of_node = np.maximum.reduceat(weights[self._nodes.members], self._nodes.starts)
        basin, saddle = _basins(np.asarray(of_node, np.float64), self._nodes.graph)
        own = int(basin[self._nodes.of_vertex[vertex]])
        highest = {int(root): float(of_node[root]) for root in saddle}
        others = sorted((root for root in highest if root != own), key=lambda root: (-highest[root], root))
        roots = [own, *others[: MOST_INSTANCES - 1]]
        if own < 0 or len(roots) == 1:
            return (Instance(vertex, (x, y, z), np.eye(3), float(weights[vertex]), None),)
        shares = self._shares(of_node, basin, saddle, roots)
        found = [Instance(vertex, (x, y, z), np.eye(3), float(weights[vertex]), shares[0])]
        for root, share in zip(roots[1:], shares[1:], strict=True):
            peak, frame = self._counterpart(root, weights, basin, found, planes)
            here = self._mesh.vertices[peak]
            found.append(Instance(peak, (here[0], here[1], here[2]), frame, float(weights[peak]), share))
        return tuple(found)

    def _counterpart(
        self,
        root: int,
        weights: NDArray[np.floating],
        basin: NDArray[np.int64],
        found: Sequence[Instance],
        planes: Sequence[SymmetryPlane],
    ) -> tuple[int, Float64]:
        """The vertex of an instance that answers the handle, and the frame there.

        The mirror image of an instance that was found already, where it looks as alike: a peak's top is often flat, and
        wanders on it. Otherwise the top itself, turned round once for each plane that lies between it and the handle.
        """
        peak = self._peak(weights, root)
        for plane in planes:
            images = plane.reflect([other.position for other in found])
            for other, nearest in zip(found, self._tree.query(images)[1].tolist(), strict=True):
                on_it = basin[self._nodes.of_vertex[nearest]] == root
                if on_it and weights[nearest] >= weights[peak] - AS_ALIKE:
                    return nearest, _reflection(plane) @ other.frame
        frame = np.eye(3)
        for plane in planes:
            ours, theirs = plane.signed_distance([found[0].position, self._mesh.vertices[peak]])
            if ours * theirs < 0:
                frame = _reflection(plane) @ frame
        return peak, frame

    def _peak(self, weights: NDArray[np.floating], node: int) -> int:
        members = self._nodes.members[self._nodes.starts[node] : self._nodes.ends[node]]
        return int(members[weights[members].argmax()])

    def _shares(
        self, weights: Float64, basin: NDArray[np.int64], saddle: dict[int, float], roots: Sequence[int]
    ) -> Float32:
        """(K, V) shares of the instances: 1 on the upper half of a peak, passing smoothly into each other between."""
        closeness = np.empty((len(roots), len(weights)))
        for row, root in enumerate(roots):
            core = np.flatnonzero((basin == root) & (weights >= (weights[root] + saddle[root]) / 2))
            distance = dijkstra(self._nodes.graph, indices=core, min_only=True)
            if np.isinf(distance).any():  # no way along the surface: the straight one, and farther than any other
                straight = cKDTree(self._nodes.center[core]).query(self._nodes.center)[0] + self._mesh.diagonal
                distance = np.where(np.isinf(distance), straight, distance)
            closeness[row] = (distance / self._mesh.diagonal + 1e-4) ** -SHARPNESS
        closeness /= closeness.max(axis=0)  # of the nearest one 1, however many there are
        smooth = self._nodes.to_vertices(np.maximum(closeness - CLEAR, 0) / (1 - CLEAR))
        shares: Float32 = smooth / smooth.sum(axis=0)
        return shares

    @cached_property
    def _nodes(self) -> _Nodes:
        return _Nodes(self._mesh.vertices, surface_graph(self._mesh))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._mesh.vertices)


class _Nodes:
    """Vertices gathered into nodes, each a connected piece of the surface within a cell of space."""

    def __init__(self, vertices: Float64, graph: csr_array) -> None:
        count = len(vertices)
        if count <= MOST_NODES:
            self.of_vertex = np.arange(count)
            self.graph = graph
        else:
            self.of_vertex = _gathered(vertices, graph)
            self.graph = _contracted(vertices, graph, self.of_vertex)
        self.members = np.argsort(self.of_vertex, kind="stable")  # (V,) vertices, node by node
        self.starts = np.flatnonzero(np.diff(self.of_vertex[self.members], prepend=-1))
        self.ends = np.append(self.starts[1:], count)
        size = (self.ends - self.starts)[:, None]
        self.center = np.add.reduceat(vertices[self.members], self.starts) / size  # (N, 3)
        self._blend = None if count <= MOST_NODES else _interpolation(vertices, self)

    def to_vertices(self, values: Float64) -> Float32:
        """Values (K, N) of the nodes, smoothly passed on to the vertices, (K, V)."""
        if self._blend is None:
            return values.astype(np.float32)
        return np.ascontiguousarray((self._blend @ values.T.astype(np.float32)).T)


def _gathered(vertices: Float64, graph: csr_array) -> NDArray[np.int64]:
    """(V,) the node of each vertex: the connected pieces within the cells of a grid."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = float((high - low).max()) / CELLS
    place = np.floor((vertices - low) / cell).astype(np.int64)
    key = (place[:, 0] * (CELLS + 1) + place[:, 1]) * (CELLS + 1) + place[:, 2]
    edges = graph.tocoo()
    one, other = edges.coords
    within = key[one] == key[other]
    inside = csr_array((np.ones(int(within.sum()), bool), (one[within], other[within])), shape=graph.shape)
    return np.asarray(connected_components(inside, directed=False)[1], np.int64)


def _contracted(vertices: Float64, graph: csr_array, of_vertex: NDArray[np.int64]) -> csr_array:
    """The graph (N, N) between nodes, with the distances between their centers."""
    count = int(of_vertex.max()) + 1
    size = np.bincount(of_vertex, minlength=count)
    center = np.stack([np.bincount(of_vertex, axis, minlength=count) / size for axis in vertices.T], axis=1)
    edges = graph.tocoo()
    one, other = of_vertex[edges.coords[0]], of_vertex[edges.coords[1]]
    between = one != other
    linked = csr_array((np.ones(int(between.sum()), bool), (one[between], other[between])), shape=(count, count))
    linked.sum_duplicates()
    row, column = linked.tocoo().coords
    length = np.maximum(np.linalg.norm(center[row] - center[column], axis=1), 1e-12)
    return csr_array((length, (row, column)), shape=(count, count))


def _interpolation(vertices: Float64, nodes: _Nodes) -> csr_array:
    """Rows (V, N) that blend the values of a vertex's own node and of those beside it, the nearer the more."""
    count = nodes.graph.shape[0]
    reach = csr_array((np.ones(len(nodes.graph.data) + count, np.float32), *_with_itself(nodes.graph)), (count, count))
    beside = reach[nodes.of_vertex]
    row = np.repeat(np.arange(len(vertices)), np.diff(beside.indptr))
    squared = np.square(vertices[row] - nodes.center[beside.indices]).sum(axis=1)
    radius = np.maximum.reduceat(squared, beside.indptr[:-1])[row] * 1.1 + 1e-300
    beside.data = np.square(1 - squared / radius).astype(np.float32) + np.float32(1e-6)
    return csr_array(diags_array((1 / beside.sum(axis=1)).astype(np.float32)) @ beside)


def _with_itself(graph: csr_array) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Column indices and row starts of `graph` with its diagonal."""
    count = graph.shape[0]
    row = np.concatenate([np.repeat(np.arange(count), np.diff(graph.indptr)), np.arange(count)])
    column = np.concatenate([graph.indices, np.arange(count)])
    order = np.lexsort((column, row))
    starts = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
    return column[order].astype(np.int32), starts


def _basins(weights: Float64, graph: csr_array) -> tuple[NDArray[np.int64], dict[int, float]]:
    """The peaks of weights (N,) over a graph, and what belongs to them.

    Returns
    -------
    basin
        (N,) the node at whose peak each node ends up uphill, -1 where the weight is too low to belong anywhere.
    saddle
        By peak, the height of the highest pass from it to another; the least weight where there is none.
    """
    floor = LEAST_PERSISTENCE / 2
    label = np.full(len(weights), -1)
    parent: dict[int, int] = {}
    saddle: dict[int, float] = {}

    def top(node: int) -> int:
        while parent[node] != node:
            parent[node] = parent[parent[node]]
            node = parent[node]
        return node

    basin_of: dict[int, int] = {}  # a peak that was too low for itself, and the one that took it in
    order = np.argsort(-weights, kind="stable")
    starts, neighbors = graph.indptr, graph.indices
    for node in order[: int((weights > floor).sum())].tolist():
        height = float(weights[node])
        tops = {top(int(label[other])) for other in neighbors[starts[node] : starts[node + 1]] if label[other] >= 0}
        if not tops:
            label[node] = parent[node] = node
            continue
        highest = max(tops, key=lambda peak: (weights[peak], -peak))
        label[node] = highest
        for peak in tops - {highest}:
            parent[peak] = highest
            if weights[peak] >= LEAST_WEIGHT and weights[peak] - height >= LEAST_PERSISTENCE:
                saddle[peak] = height
                saddle[highest] = max(saddle.get(highest, floor), height)
            else:
                basin_of[peak] = highest
    for peak in {top(peak) for peak in parent}:
        if weights[peak] >= LEAST_WEIGHT:
            saddle.setdefault(peak, floor)

    def settled(peak: int) -> int:
        while peak in basin_of:
            peak = basin_of[peak]
        return peak if peak in saddle else -1

    settled_of = {peak: settled(peak) for peak in parent}
    basin = np.array([settled_of[peak] if peak >= 0 else -1 for peak in label.tolist()], np.int64)
    return basin, saddle


def _reflection(plane: SymmetryPlane) -> Float64:
    """The linear part (3, 3) of the reflection at `plane`."""
    normal = np.asarray(plane.normal)
    return np.eye(3) - 2.0 * np.outer(normal, normal)
