"""Counterparts of a handle: the components of the part that it holds, each with its own pivot and frame.

A rotation about the handle's pivot would move distant legs in wide arcs. So each leg moves about its own counterpart of
the pivot, mirrored where a plane of symmetry relates it to the handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
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

LEAST_ALIKE = 0.15  # weight: counterparts of less have their own pivots, but `equalize` does not raise their weights
MOST_COUNTERPARTS = 64  # those most alike count; each counterpart costs a column of weights
SHARPNESS = 2  # shares fall with this power of the distance from a counterpart
CLEAR = 0.03  # smaller shares, relative to the largest one at a vertex, become 0
BESIDE = 0.1  # the margin of a box, relative to its sides: a component inside the margin counts as inside the box
AS_ALIKE = 0.05  # weight: the mirror image of the handle is preferred to a vertex that is more alike by less


@dataclass(frozen=True, eq=False)
class Counterpart:
    """One place that moves with a handle."""

    vertex: int  # the vertex that looks most like the handle
    position: tuple[float, float, float]  # (3,) of that vertex, of the handle's own that of the handle, mesh units
    # frame: (3, 3) orthogonal: maps directions at the handle to those at the counterpart; a reflection if a plane of
    # symmetry lies between them
    frame: Float64
    weight: float  # the handle's weight at `vertex`
    share: Share | None  # its share of the handle's weights; None means all, for the only counterpart
    # image: (3, 4) the isometry that maps the handle's own component onto this one, where they are mirror images
    image: Float64 | None = None

    def share_at(self, vertex: int) -> float:
        """Return its share at one vertex."""
        return 1.0 if self.share is None else self.share.at(vertex)

    def transform(self, affine: Float64, position: Sequence[float]) -> Float64:
        """Return the map (3, 4) at this counterpart that corresponds to `affine` at a handle at `position` (3,)."""
        if np.array_equal(affine, np.eye(3, 4)):  # exactly: rounding would move vertices of a handle at rest
            return np.eye(3, 4)
        here, there = np.asarray(self.position), np.asarray(position, np.float64)
        linear = self.frame @ affine[:, :3] @ self.frame.T
        moved = affine[:, :3] @ there + affine[:, 3] - there  # displacement of the handle
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
        """Return the isometry (3, 4) from the handle's own component, or None if they are no mirror images."""
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
        grip: Grip | None,
        planes: Sequence[SymmetryPlane] = (),
        *,
        everywhere: bool = False,
    ) -> tuple[tuple[Counterpart, ...], Float32 | None]:
        """Find the counterparts of a handle.

        Parameters
        ----------
        weights
            (V,) of the handle, from features alone: without fixed points and locality.
        vertex, position
            The vertex nearest to the handle, and its position (3,), mesh units.
        grip
            The part that the handle holds; each of its components is one counterpart. None if there is no part.
        planes
            Planes of symmetry of the shape; frames are reflected in them.
        everywhere
            Whether the counterparts share the whole surface, for weights that do not end with the part.

        Returns
        -------
        counterparts
            The handle's own counterpart first, then the others, the most alike first.
        part
            (V,) the weights of `grip`; None without it. Unless `everywhere`, mirror images of the handle's own
            component have its weights.
        """
        nodes = self._nodes
        x, y, z = (float(value) for value in position)
        found = [Counterpart(vertex, (x, y, z), np.eye(3), float(weights[vertex]), None)]
        if grip is None:
            return (found[0],), None
        component = self._components(grip.component, vertex)
        on_nodes = np.maximum.reduceat(weights[nodes.members], nodes.starts)
        own = int(component[nodes.of_vertex[vertex]])
        alike = np.full(component.max(initial=-1) + 2, -1.0)  # the last one is that of nodes outside the part
        np.maximum.at(alike, component, on_nodes)
        alike[[own, -1]] = -1.0
        others = np.argsort(-alike, kind="stable")[: min(MOST_COUNTERPARTS - 1, int((alike >= 0).sum()))]
        if not len(others):
            return (found[0],), grip.weights
        chosen = [own, *others.tolist()]
        surfaces = self._surfaces(component, chosen)
        for index, number in enumerate(chosen[1:], 1):
            image = self._image(surfaces[index], surfaces, found, planes)
            if image is not None:
                x, y, z = (image[:, :3] @ np.asarray(position, np.float64) + image[:, 3]).tolist()
                peak = int(nodes.nearest((x, y, z))[0])
                found.append(Counterpart(peak, (x, y, z), image[:, :3], float(weights[peak]), None, image))
                continue
            peak, frame = self._counterpart(component == number, weights, on_nodes, found, planes)
            x, y, z = self._mesh.vertices[peak].tolist()
            found.append(Counterpart(peak, (x, y, z), frame, float(weights[peak]), None))
        rows = self._closeness([np.flatnonzero(component == number) for number in chosen])
        part, images = grip.weights, []
        if not everywhere:
            rows *= grip.of_node
            images = [(row, one.image) for row, one in zip(rows, found, strict=True) if one.image is not None]
        for row, isometry in images:
            row[:] = 0.0
            some, values = carried(nodes.center, nodes.tree, rows[0], isometry)
            row[some] = values
        if images:
            whole = nodes.interpolated(rows.sum(axis=0, dtype=np.float32))
            part = np.minimum(whole, np.float32(1.0))
        shares = nodes.shares(rows)
        return tuple(replace(one, share=share) for one, share in zip(found, shares, strict=True)), part

    @property
    def samples(self) -> tuple[Int64, Float64]:
        """Return vertices (N,) that sample the surface, and the number (N,) of vertices that each represents."""
        nodes = self._nodes
        return np.asarray(nodes.members[nodes.starts], np.int64), np.asarray(nodes.ends - nodes.starts, np.float64)

    def _components(self, component: Int64, vertex: int) -> Int64:
        """Return the `component` (N,) of each node, with two changes.

        A component inside the box of a larger one joins it, such as the hub of a wheel its tire, if both are components
        of the mesh. A vertex on the border of the part belongs to the nearest component.
        """
        nodes, joined = self._nodes, component.copy()
        inside = np.flatnonzero(component >= 0)
        if not len(inside):
            return joined
        order = inside[np.argsort(component[inside], kind="stable")]
        members = np.split(order, np.flatnonzero(np.diff(component[order])) + 1)
        members.sort(key=lambda each: (-len(each), each[0]))
        centers = np.array([nodes.center[each].mean(axis=0) for each in members])
        of_mesh = np.array([nodes.component[each[0]] for each in members])
        alone = np.ones(len(members), bool)
        for rank, each in enumerate(members[:MOST_COUNTERPARTS]):
            if alone[rank]:
                alone[rank] = False
                joins = alone & (of_mesh != of_mesh[rank]) & _Box(nodes.center[each]).holds(centers)
                for other in np.flatnonzero(joins):
                    joined[members[other]] = component[each[0]]
                alone &= ~joins
        own = nodes.of_vertex[vertex]
        if joined[own] < 0:
            nearest = np.linalg.norm(nodes.center[inside] - nodes.center[own], axis=1).argmin()
            joined[own] = joined[inside[nearest]]
        return joined

    def _surfaces(self, component: Int64, chosen: Sequence[int]) -> list[Component | None]:
        """Return samples of the surface of each of the components `chosen`; `component` (N,) is that of each node."""
        of_corner = component[self._nodes.of_vertex][self._mesh.faces]
        of_face = np.where((of_corner == of_corner[:, :1]).all(axis=1), of_corner[:, 0], -1)
        return [component_of(self._mesh.vertices, self._mesh.faces[of_face == number]) for number in chosen]

    @staticmethod
    def _image(
        surface: Component | None,
        surfaces: Sequence[Component | None],
        found: Sequence[Counterpart],
        planes: Sequence[SymmetryPlane],
    ) -> Float64 | None:
        """Return the isometry (3, 4) from the handle's own component to `surface`, if they are mirror images.

        Planes of the whole shape are tried first, then a plane of the pair. A component may also be the mirror image of
        one that is itself a mirror image of the handle's own.
        """
        if surface is None:
            return None
        for some in (planes, None):
            for before, known in zip(found, surfaces, strict=False):
                whole = np.eye(3, 4) if before is found[0] else before.image
                if whole is None or known is None:
                    continue
                step = mirror_image(known, surface, some)
                if step is not None:
                    return np.column_stack([step[:, :3] @ whole[:, :3], step[:, :3] @ whole[:, 3] + step[:, 3]])
        return None

    def _counterpart(
        self,
        inside: Bool,
        weights: NDArray[np.floating],
        on_nodes: NDArray[np.floating],
        found: Sequence[Counterpart],
        planes: Sequence[SymmetryPlane],
    ) -> tuple[int, Float64]:
        """Return the vertex on the nodes `inside` (N,) that corresponds to the handle, and its frame.

        The vertex is the mirror image of a counterpart found before, if it is nearly as similar as the most similar
        vertex. Otherwise it is the most similar vertex, and its frame is reflected in each plane between it and the
        handle.
        """
        nodes = self._nodes
        best = int(np.where(inside, on_nodes, -1.0).argmax())
        members = nodes.members[nodes.starts[best] : nodes.ends[best]]
        peak = int(members[weights[members].argmax()])
        for plane in planes:
            images = plane.reflect([other.position for other in found])
            for other, nearest in zip(found, nodes.nearest(images).tolist(), strict=True):
                if inside[nodes.of_vertex[nearest]] and weights[nearest] >= weights[peak] - AS_ALIKE:
                    return nearest, plane.reflection[:3, :3] @ other.frame
        frame = np.eye(3)
        for plane in planes:
            ours, theirs = plane.signed_distance([found[0].position, self._mesh.vertices[peak]])
            if ours * theirs < 0:
                frame = plane.reflection[:3, :3] @ frame
        return peak, frame

    def _closeness(self, components: Sequence[Int64]) -> Float64:
        """Return (K, N) shares: 1 on the nodes of each component, with smooth transitions in between."""
        closeness = np.empty((len(components), len(self._nodes.center)))
        for row, members in zip(closeness, components, strict=True):
            distance = dijkstra(self._nodes.graph, indices=members, min_only=True)
            # Other components of the mesh get their straight distance plus a diagonal, which exceeds all others.
            if len(apart := np.flatnonzero(np.isinf(distance) & self._nodes.used)):
                straight = cKDTree(self._nodes.center[members]).query(self._nodes.center[apart])[0]
                distance[apart] = straight + self._mesh.diagonal
            row[:] = (distance / self._mesh.diagonal + 1e-4) ** -SHARPNESS
        closeness[0, ~self._nodes.used] = 1.0
        closeness /= closeness.max(axis=0)  # the nearest counterpart has 1
        closeness -= CLEAR
        np.maximum(closeness, 0.0, out=closeness)
        closeness /= closeness.sum(axis=0)
        return closeness

    @cached_property
    def _nodes(self) -> Nodes:
        return nodes_of(self._mesh)


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


def shortest_turn(one: Float64, other: Float64) -> Float64:
    """Return the smallest rotation (3, 3) from `one` (3,) to `other` (3,), both of length 1."""
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
