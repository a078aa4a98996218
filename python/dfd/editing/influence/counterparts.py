"""Counterparts of a handle: the places that look like the one that it holds, each with its own pivot and frame.

The weight of a handle has a peak at the handle and one on every other leg. It has low peaks wherever the surface
resembles the handle a little. A peak counts by its persistence: how far the weight falls along the surface before it
rises to a higher peak (Edelsbrunner, Letscher and Zomorodian, "Topological persistence and simplification", 2002).
Ripples on one leg have a low persistence, so they are no counterparts.

A rotation about the handle's pivot would move distant legs in wide arcs. So each counterpart moves about its own
counterpart of the pivot, mirrored where a plane of symmetry relates it to the handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.editing.influence.mirror_images import Component, component_of, mirror_image
from dfd.geometry.coarse import Nodes, Share, nodes_of
from dfd.geometry.part_axis import carried
from dfd.posing.transforms import Vector, frame_of_normal

if TYPE_CHECKING:
    from dfd.editing.edit import Handle
    from dfd.mesh.mesh import Mesh
    from dfd.segmentation.parts import Grip
    from dfd.symmetry.plane import SymmetryPlane

LEAST_PERSISTENCE = 0.05  # weight: noise of the field makes peaks of less persistence
LEAST_WEIGHT = 0.075  # weight: a lower peak belongs to the nearest counterpart
LEAST_ALIKE = 0.15  # weight: counterparts of less have their own pivots, but `equalize` does not raise their weights
MOST_COUNTERPARTS = 64  # the highest peaks count; each counterpart costs a column of weights
SHARPNESS = 2  # shares fall with this power of the distance from a counterpart
CLEAR = 0.03  # smaller shares, relative to the largest one at a vertex, become 0
BESIDE = 0.1  # the margin of a box, relative to its sides: a peak inside the margin counts as inside the box
AS_ALIKE = 0.05  # weight: the mirror image of the handle is preferred to a peak that is higher by less


@dataclass(frozen=True, eq=False)
class Counterpart:
    """One place that moves with a handle."""

    vertex: int  # the vertex that looks most like the handle
    # position: (3,) of that vertex, mesh units. For the handle's own it is the handle's position, and for a region in
    # several components the center of one of them.
    position: tuple[float, float, float]
    # frame: (3, 3) orthogonal: turns directions at the handle into those at the counterpart; a reflection where a
    # plane of symmetry lies between them
    frame: Float64
    weight: float  # the handle's weight at `vertex`
    share: Share | None  # which part of the vertices' weights belongs to it; None means all: there is one counterpart
    # image: (3, 4) the isometry that maps the handle's own component onto this one, where they are mirror images
    image: Float64 | None = None

    def share_at(self, vertex: int) -> float:
        """Return its share at one vertex."""
        return 1.0 if self.share is None else self.share.at(vertex)

    def transform(self, affine: Float64, position: Sequence[float]) -> Float64:
        """Return the (3, 4) map that does at this counterpart what `affine` does at a handle at `position` (3,)."""
        if np.array_equal(affine, np.eye(3, 4)):  # exactly: rounding would move vertices of a handle at rest
            return np.eye(3, 4)
        here, there = np.asarray(self.position), np.asarray(position, np.float64)
        linear = self.frame @ affine[:, :3] @ self.frame.T
        moved = affine[:, :3] @ there + affine[:, 3] - there  # what the handle itself is moved by
        return np.column_stack([linear, here + self.frame @ moved - linear @ here])


class Column(NamedTuple):
    """The handle and the counterpart of a column of weights."""

    handle: int  # the number of the handle in the edit
    counterpart: Counterpart | None  # None if the handle's own transform applies
    gain: float = 1.0  # the column is the handle's weights times the counterpart's share times this gain
    carriers: tuple[int, ...] = ()  # the columns of other handles in whose components its own is nested

    def matrix(self, handle: Handle) -> Float64:
        """Return the (3, 4) transform of the column, mesh units: the handle's own in the counterpart's frame."""
        if self.counterpart is None:
            return handle.matrix
        return self.counterpart.transform(handle.matrix, handle.place.position)

    @property
    def image(self) -> Float64 | None:
        """(3, 4) the isometry from the handle's own component, if they are mirror images."""
        return None if self.counterpart is None else self.counterpart.image

    def vertex(self, anchor: int) -> int:
        """Return the vertex of the counterpart, or `anchor`, the vertex of the handle."""
        return anchor if self.counterpart is None else self.counterpart.vertex

    def position(self, handle: Handle) -> Vector:
        """Return the position (3,) of the counterpart or the handle, mesh units. It has a side of a mirror plane."""
        return handle.place.position if self.counterpart is None else self.counterpart.position


class CounterpartFinder:
    """Find counterparts on one mesh. Data that does not depend on the handle is computed once, at the first use."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    def prepare(self) -> None:
        """Compute the data that does not depend on the handle. It takes seconds for a million faces."""
        _ = self._nodes.tree

    def find(
        self,
        weights: NDArray[np.floating],
        vertex: int,
        position: Sequence[float],
        *,
        held: NDArray[np.integer] | None = None,
        grip: Grip | None = None,
        planes: Sequence[SymmetryPlane] = (),
    ) -> tuple[tuple[Counterpart, ...], Float32 | None]:
        """Find the counterparts of a handle.

        Parameters
        ----------
        weights
            (V,) of the handle, from features alone: without fixed points and locality.
        vertex, position
            The vertex nearest to the handle, and its position (3,), mesh units.
        held
            (N,) all vertices of a handle that is a region. Each connected piece is one counterpart, and several pieces
            move about their own centers.
        grip
            The part that the handle holds. Each of its components is one counterpart.
        planes
            Planes of symmetry of the shape. They make frames.

        Returns
        -------
        counterparts
            The handle's own counterpart first, then the others, the most alike first.
        part
            (V,) the weights of `grip`, with those of the handle's own component at its mirror images; None without it.
        """
        nodes = self._nodes
        x, y, z = (float(value) for value in position)
        of_node = np.maximum.reduceat(weights[nodes.members], nodes.starts)
        of_node[~nodes.used] = 0.0
        centers: dict[int, Float64] = {}
        if grip is not None:
            basin, saddle = self._of_components(grip.component, of_node, vertex)
        else:
            basin, saddle = _basins(np.asarray(of_node, np.float64), nodes.graph)
            centers = {} if held is None else self._join_held(held, of_node, basin, saddle)
        part = None if grip is None else grip.weights
        self._join_inside(of_node, basin, saddle)
        own = int(basin[nodes.of_vertex[vertex]])
        highest = {int(root): float(of_node[root]) for root in saddle}
        others = sorted((root for root in highest if root != own), key=lambda root: (-highest[root], root))
        roots = [own, *others[: MOST_COUNTERPARTS - 1]]
        if own < 0 or len(roots) == 1:
            return (Counterpart(vertex, (x, y, z), np.eye(3), float(weights[vertex]), None),), part
        x, y, z = centers[own].tolist() if own in centers else (x, y, z)
        found = [Counterpart(vertex, (x, y, z), np.eye(3), float(weights[vertex]), None)]
        surfaces = [] if grip is None else self._surfaces(basin, roots)
        for number, root in enumerate(roots[1:], 1):
            image = self._image(number, surfaces, found, planes)
            if image is not None:
                x, y, z = (image[:, :3] @ np.asarray(position, np.float64) + image[:, 3]).tolist()
                peak = int(nodes.nearest((x, y, z))[0])
                found.append(Counterpart(peak, (x, y, z), image[:, :3], float(weights[peak]), None, image))
                continue
            peak, frame = self._counterpart(root, weights, basin, found, planes)
            x, y, z = centers.get(root, self._mesh.vertices[peak]).tolist()
            found.append(Counterpart(peak, (x, y, z), frame, float(weights[peak]), None))
        rows = self._closeness(of_node, basin, saddle, roots)
        if grip is not None:
            rows *= grip.of_node
            for row, one in zip(rows, found, strict=True):
                if one.image is not None:
                    row[:] = 0.0
                    some, values = carried(nodes.center, nodes.tree, rows[0], one.image)
                    row[some] = values
            if any(one.image is not None for one in found):
                whole = nodes.interpolated(rows.sum(axis=0, dtype=np.float32))
                part = np.minimum(whole, np.float32(1.0))
        shares = nodes.shares(rows)
        return tuple(replace(one, share=share) for one, share in zip(found, shares, strict=True)), part

    @property
    def samples(self) -> tuple[Int64, Float64]:
        """(N,) vertices that sample the surface, and how many vertices each represents."""
        nodes = self._nodes
        return np.asarray(nodes.members[nodes.starts], np.int64), np.asarray(nodes.ends - nodes.starts, np.float64)

    def _surfaces(self, basin: Int64, roots: Sequence[int]) -> list[Component | None]:
        """Return samples of the surface of each of the peaks `roots`."""
        peak = basin[self._nodes.of_vertex]
        of_face = peak[self._mesh.faces[:, 0]]
        for corner in (1, 2):
            of_face[of_face != peak[self._mesh.faces[:, corner]]] = -1
        return [component_of(self._mesh.vertices, self._mesh.faces[of_face == root]) for root in roots]

    @staticmethod
    def _image(
        number: int, surfaces: Sequence[Component | None], found: Sequence[Counterpart], planes: Sequence[SymmetryPlane]
    ) -> Float64 | None:
        """Return the isometry (3, 4) from the handle's own component to component `number`, if they are mirror images.

        Planes of the whole shape are tried first, then a plane of the pair. A component may also be the mirror image of
        one that is itself a mirror image of the handle's own.
        """
        own = surfaces[number] if surfaces else None
        if own is None:
            return None
        for some in (planes, None):
            for before, known in zip(found, surfaces, strict=False):
                whole = np.eye(3, 4) if before is found[0] else before.image
                if whole is None or known is None:
                    continue
                step = mirror_image(known, own, some)
                if step is not None:
                    return np.column_stack([step[:, :3] @ whole[:, :3], step[:, :3] @ whole[:, 3] + step[:, 3]])
        return None

    def _counterpart(
        self,
        root: int,
        weights: NDArray[np.floating],
        basin: Int64,
        found: Sequence[Counterpart],
        planes: Sequence[SymmetryPlane],
    ) -> tuple[int, Float64]:
        """Return the vertex of a counterpart that corresponds to the handle, and its frame.

        This is the mirror image of one that was found before, if its weight is as high: peaks are often flat,
        so their highest vertex is arbitrary. Otherwise it is the highest vertex, with a frame that is mirrored once for
        each plane between it and the handle.
        """
        peak = self._peak(weights, root)
        for plane in planes:
            images = plane.reflect([other.position for other in found])
            for other, nearest in zip(found, self._nodes.nearest(images).tolist(), strict=True):
                on_it = basin[self._nodes.of_vertex[nearest]] == root
                if on_it and weights[nearest] >= weights[peak] - AS_ALIKE:
                    return nearest, plane.reflection[:3, :3] @ other.frame
        frame = np.eye(3)
        for plane in planes:
            ours, theirs = plane.signed_distance([found[0].position, self._mesh.vertices[peak]])
            if ours * theirs < 0:
                frame = plane.reflection[:3, :3] @ frame
        return peak, frame

    def _of_components(self, component: Int64, weights: Float64, vertex: int) -> tuple[Int64, dict[int, float]]:
        """Return what `_basins` returns, with one peak for each `component` (N,); all of it counts as its top."""
        nodes = self._nodes
        of_node = component.copy()
        own = nodes.of_vertex[vertex]
        if of_node[own] < 0 <= of_node.max(initial=-1):  # on its border
            inside = np.flatnonzero(of_node >= 0)
            of_node[own] = of_node[inside[np.linalg.norm(nodes.center[inside] - nodes.center[own], axis=1).argmin()]]
        basin = np.full(len(of_node), -1)
        peaks = []
        for members in (np.flatnonzero(of_node == number) for number in range(int(of_node.max(initial=-1)) + 1)):
            if len(members):
                peaks.append(int(members[weights[members].argmax()]))
                basin[members] = peaks[-1]
        return basin, dict.fromkeys(peaks, -np.inf)

    def _join_held(
        self, held: NDArray[np.integer], weights: Float64, basin: Int64, saddle: dict[int, float]
    ) -> dict[int, Float64]:
        """Join all peaks on each connected piece of the vertices `held` (N,) of a region.

        Returns
        -------
        For each peak the center (3,) of its piece, mesh units; nothing for a region in one piece.
        """
        nodes, of_held = np.unique(self._nodes.of_vertex[held], return_inverse=True)
        count, piece = connected_components(self._nodes.graph[nodes][:, nodes], directed=False)
        whole_of: dict[int, int] = {}
        centers = {}
        vertices_of = _grouped(held, piece[of_held], count)
        for nodes_here, vertices_here in zip(_grouped(nodes, piece, count), vertices_of, strict=True):
            roots = {_last(whole_of, root) for root in {*basin[nodes_here].tolist()} - {-1}}
            if not roots:
                continue
            highest = max(roots, key=lambda root: (weights[root], -root))
            whole_of |= dict.fromkeys(roots - {highest}, highest)
            centers[highest] = self._mesh.vertices[vertices_here].mean(axis=0)
        _join(basin, saddle, {root: _last(whole_of, root) for root in whole_of})
        return centers if count > 1 else {}

    def _join_inside(self, weights: Float64, basin: Int64, saddle: dict[int, float]) -> None:
        """Join peaks with a higher peak whose box contains them, such as the hub of a wheel with its tire.

        Only peaks of different components are joined. On one component, persistence separates the limbs.
        """
        roots = np.array(sorted(saddle, key=lambda root: (-weights[root], root)), np.int64)
        cores = self._cores(roots, weights, basin, saddle)
        centers = np.array([self._nodes.center[core].mean(axis=0) for core in cores]).reshape(-1, 3)
        component = self._nodes.component[roots]
        alone = np.ones(len(roots), bool)
        whole_of: dict[int, int] = {}
        boxes = 0
        for rank, root in enumerate(roots.tolist()):
            if boxes == MOST_COUNTERPARTS:  # lower peaks are no counterparts
                break
            if root in whole_of:
                continue
            boxes += 1
            alone[rank] = False
            inside = alone & (component != component[rank]) & _Box(self._nodes.center[cores[rank]]).holds(centers)
            whole_of |= dict.fromkeys(roots[inside].tolist(), root)
            alone &= ~inside
        _join(basin, saddle, whole_of)

    @staticmethod
    def _cores(roots: Int64, weights: Float64, basin: Int64, saddle: dict[int, float]) -> list[Int64]:
        """Return the nodes of the upper half of each of the peaks `roots`."""
        half = np.full(len(weights), np.inf)
        half[roots] = [(weights[root] + saddle[root]) / 2 for root in roots.tolist()]
        high = np.flatnonzero((basin >= 0) & (weights >= half[basin]))
        rank = np.empty(len(weights), np.int64)
        rank[roots] = np.arange(len(roots))
        return _grouped(high, rank[basin[high]], len(roots))

    def _peak(self, weights: NDArray[np.floating], node: int) -> int:
        members = self._nodes.members[self._nodes.starts[node] : self._nodes.ends[node]]
        return int(members[weights[members].argmax()])

    def _closeness(self, weights: Float64, basin: Int64, saddle: dict[int, float], roots: Sequence[int]) -> Float64:
        """Return (K, N) shares: 1 on the upper half of a peak, with smooth transitions in between."""
        closeness = np.empty((len(roots), len(weights)))
        for row, core in enumerate(self._cores(np.asarray(roots), weights, basin, saddle)):
            distance = dijkstra(self._nodes.graph, indices=core, min_only=True)
            # Other components are at their straight distance plus a diagonal: beyond all of the same component.
            if len(apart := np.flatnonzero(np.isinf(distance) & self._nodes.used)):
                straight = cKDTree(self._nodes.center[core]).query(self._nodes.center[apart])[0]
                distance[apart] = straight + self._mesh.diagonal
            closeness[row] = (distance / self._mesh.diagonal + 1e-4) ** -SHARPNESS
        closeness[0, ~self._nodes.used] = 1.0
        closeness /= closeness.max(axis=0)  # the nearest counterpart has 1
        closeness -= CLEAR
        np.maximum(closeness, 0.0, out=closeness)
        closeness /= closeness.sum(axis=0)
        return closeness

    @cached_property
    def _nodes(self) -> Nodes:
        return nodes_of(self._mesh)


def _join(basin: Int64, saddle: dict[int, float], whole_of: dict[int, int]) -> None:
    """Give all nodes of each peak in `whole_of` to the peak that it maps to."""
    name = np.arange(len(basin))
    name[list(whole_of)] = list(whole_of.values())
    belongs = basin >= 0
    basin[belongs] = name[basin[belongs]]
    for root in whole_of:
        del saddle[root]


def _last(whole_of: dict[int, int], root: int) -> int:
    while root in whole_of:
        root = whole_of[root]
    return root


def _grouped(items: NDArray[np.integer], group: NDArray[np.integer], count: int) -> list[Int64]:
    """Return the items of each of `count` groups, in their order."""
    order = np.argsort(group, kind="stable")
    ends = np.cumsum(np.bincount(group, minlength=count))[:-1]
    return np.split(np.asarray(items, np.int64)[order], ends)[:count]


class _Box:
    """The box around points (N, 3) along their principal axes, with a margin."""

    def __init__(self, points: Float64) -> None:
        self._center = points.mean(axis=0)
        self._axes = np.linalg.svd(points - self._center, full_matrices=False)[2] if len(points) > 2 else np.eye(3)
        along = (points - self._center) @ self._axes.T
        self._low, self._high = along.min(axis=0), along.max(axis=0)
        margin = BESIDE * (self._high - self._low)
        self._low -= margin
        self._high += margin

    def holds(self, points: Float64) -> Bool:
        """Return which of points (N, 3) lie in the box, (N,)."""
        along = (points - self._center) @ self._axes.T
        return ((along >= self._low) & (along <= self._high)).all(axis=1)


def _basins(weights: Float64, graph: csr_array) -> tuple[Int64, dict[int, float]]:
    """Find the peaks of weights (N,) on a graph, and the nodes of each peak.

    Returns
    -------
    basin
        (N,) the peak that each node reaches uphill, −1 where the weight is too low.
    saddle
        For each peak, the height of the highest saddle to another peak, or the lowest weight if there is none.
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

    basin_of: dict[int, int] = {}  # from a peak that was too low to the peak that it joined
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


def shortest_turn(one: Float64, other: Float64) -> Float64:
    """(3, 3) the rotation by the smallest angle of `one` (3,) onto `other` (3,), both of length 1."""
    across = np.cross(one, other)
    sine, cosine = float(np.linalg.norm(across)), float(one @ other)
    if sine < 1e-9:
        # Opposite directions: turn about y, made perpendicular, so that upright parts stay upright.
        across = np.asarray(frame_of_normal(one)[0]) if abs(one[1]) > 0.9 else np.array([0.0, 1.0, 0.0])
        across = across - (across @ one) * one
        sine, length = 0.0, float(np.linalg.norm(across))
    else:
        length = sine
    return Rotation.from_rotvec(across / length * np.arctan2(sine, cosine)).as_matrix()
