"""Counterparts of a handle: the components of the part that it holds, each with its own pivot and frame.

A rotation about the handle's pivot would move distant legs in wide arcs. So each leg moves about its own pivot, which
corresponds to the handle's. If a mirror plane relates both legs, the motion is mirrored.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.editing.edit import Edit
from dfd.editing.influence.mirror_images import Component, component_of, mirror_image
from dfd.geometry.coarse import Nodes, Share, nodes_of
from dfd.geometry.part_axis import carried
from dfd.mesh.mesh import Mesh
from dfd.segmentation.parts import Grip
from dfd.symmetry.plane import SymmetryPlane

LEAST_ALIKE = 0.15  # weight below which `equalize` does not raise a counterpart; it still has its own pivot
MOST_COUNTERPARTS = 64  # the most similar components are kept, because each needs a column of weights
SHARPNESS = 2  # shares fall with this power of the distance from a counterpart
CLEAR = 0.03  # subtracted from the shares at a node, relative to the largest one; so small shares become 0
BESIDE = 0.1  # margin of a component's box, relative to its sides
AS_ALIKE = 0.05  # weight: the mirror image is chosen unless the most similar vertex exceeds its weight by more


@dataclass(frozen=True, eq=False)
class Counterpart:
    """One place that moves with a handle."""

    vertex: int  # the vertex that corresponds to the handle: its mirror image, or the most similar vertex
    # position: (3,) mesh units: the handle's position, its mirror image if `image` is given, else that of `vertex`
    position: tuple[float, float, float]
    # frame: (3, 3) orthogonal: maps directions at the handle to those at the counterpart; a reflection if a plane of
    # symmetry lies between them
    frame: Float64
    weight: float = 1.0  # the handle's weight at `vertex`
    share: Share | None = None  # its share of the handle's weights; None means all, for the only counterpart
    # image: (3, 4) the isometry that maps the handle's own component onto this one, where they are mirror images
    image: Float64 | None = None

    def transform(self, affine: Float64, position: Sequence[float]) -> Float64:
        """Return the map (3, 4) of this counterpart if the handle at `position` (3,) has the map `affine`."""
        here, there = np.asarray(self.position), np.asarray(position, np.float64)
        # `affine` is returned unchanged, because rounding would move vertices of a handle at rest.
        if np.array_equal(affine, np.eye(3, 4)) or (np.array_equal(here, there) and (self.frame == np.eye(3)).all()):
            return affine
        linear = self.frame @ affine[:, :3] @ self.frame.T
        moved = affine[:, :3] @ there + affine[:, 3] - there  # displacement of the handle
        return np.column_stack([linear, here + self.frame @ moved - linear @ here])


class Column(NamedTuple):
    """The handle and the counterpart of a column of weights."""

    handle: int  # the number of the handle in the edit
    counterpart: Counterpart  # the handle's own if all counterparts share its pivot
    carriers: tuple[int, ...] = ()  # the columns of other handles whose components contain this column's

    def matrix(self, edit: Edit) -> Float64:
        """Return the (3, 4) transform of the column, mesh units: the handle's transform, mapped to the counterpart."""
        handle = edit.handles[self.handle]
        return self.counterpart.transform(handle.matrix, handle.place.position)


class Held(NamedTuple):
    """The part and the counterparts at a place."""

    counterparts: tuple[Counterpart, ...]  # the counterpart at the place, then the others by decreasing similarity
    # part: (V,) the weights of the held part; None without one. Mirror images have equal weights, unless `everywhere`.
    part: Float32 | None


def find_counterparts(
    mesh: Mesh,
    weights: NDArray[np.floating],
    vertex: int,
    position: Sequence[float],
    grip: Grip | None,
    planes: Sequence[SymmetryPlane] = (),
    *,
    everywhere: bool = False,
) -> Held:
    """Find the counterparts of a handle at `position` (3,), mesh units; `vertex` is nearest to it.

    `weights` (V,) are those of the handle from features alone, without fixed points and locality. Each component of
    `grip`, the part that the handle holds, is one counterpart. Frames are reflected in the shape's `planes` of
    symmetry. With `everywhere`, counterparts share the whole surface, for weights that do not end with the part.
    """
    x, y, z = (float(value) for value in position)
    found = [Counterpart(vertex, (x, y, z), np.eye(3), float(weights[vertex]))]
    if grip is None:
        return Held((found[0],), None)
    nodes = nodes_of(mesh)
    component = _joined(nodes, grip.component, vertex)
    on_nodes = np.maximum.reduceat(weights[nodes.members], nodes.starts)
    own = int(component[nodes.of_vertex[vertex]])
    alike = np.full(component.max(initial=-1) + 2, -1.0)  # the last entry stands for nodes outside the part
    np.maximum.at(alike, component, on_nodes)
    alike[[own, -1]] = -1.0
    others = np.argsort(-alike, kind="stable")[: min(MOST_COUNTERPARTS - 1, int((alike >= 0).sum()))]
    if not len(others):
        return Held((found[0],), grip.weights)
    chosen = [own, *others.tolist()]
    surfaces = _surfaces(mesh, component[nodes.of_vertex], chosen)
    for index, number in enumerate(chosen[1:], 1):
        image = _image(surfaces[index], surfaces, found, planes)
        if image is not None:
            x, y, z = (image[:, :3] @ np.asarray(position, np.float64) + image[:, 3]).tolist()
            peak, frame = int(nodes.nearest((x, y, z))[0]), image[:, :3]
        else:
            best = int(np.where(component == number, on_nodes, -1.0).argmax())
            members = nodes.members[nodes.starts[best] : nodes.ends[best]]
            peak = int(members[weights[members].argmax()])
            peak, frame = _counterpart(mesh, component == number, weights, peak, found, planes)
            x, y, z = mesh.vertices[peak].tolist()
        found.append(Counterpart(peak, (x, y, z), frame, float(weights[peak]), image=image))
    rows = _closeness(mesh, [np.flatnonzero(component == number) for number in chosen])
    part = grip.weights
    if not everywhere:
        rows *= grip.of_node
        images = [(row, one.image) for row, one in zip(rows, found, strict=True) if one.image is not None]
        for row, isometry in images:
            row[:] = 0.0
            some, values = carried(nodes.center, nodes.tree, rows[0], isometry)
            row[some] = values
        if images:
            part = np.minimum(nodes.interpolated(rows.sum(axis=0, dtype=np.float32)), np.float32(1.0))
    shares = nodes.shares(rows)
    return Held(tuple(replace(one, share=share) for one, share in zip(found, shares, strict=True)), part)


def _joined(nodes: Nodes, component: Int64, vertex: int) -> Int64:
    """Return the `component` (N,) of each node, with two changes.

    A component joins a larger one if its center lies in the larger one's box and both are on different components of
    the mesh, as a hub joins its tire. If the handle's vertex lies on no component, its node joins the nearest one.
    """
    joined = component.copy()
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
            joins = alone & (of_mesh != of_mesh[rank]) & _in_box(nodes.center[each], centers)
            for other in np.flatnonzero(joins):
                joined[members[other]] = component[each[0]]
            alone &= ~joins
    own = nodes.of_vertex[vertex]
    if joined[own] < 0:
        nearest = np.linalg.norm(nodes.center[inside] - nodes.center[own], axis=1).argmin()
        joined[own] = joined[inside[nearest]]
    return joined


def _in_box(points: Float64, others: Float64) -> Bool:
    """Return which of `others` (M, 3) lie in the box around `points` (N, 3) along their principal axes."""
    center = points.mean(axis=0)
    axes = np.linalg.svd(points - center, full_matrices=False)[2] if len(points) > 2 else np.eye(3)
    own, along = (points - center) @ axes.T, (others - center) @ axes.T
    margin = BESIDE * np.ptp(own, axis=0)
    return ((along >= own.min(axis=0) - margin) & (along <= own.max(axis=0) + margin)).all(axis=1)


def _surfaces(mesh: Mesh, component: Int64, chosen: Sequence[int]) -> list[Component | None]:
    """Return samples of the surface of each of the components `chosen`; `component` (V,) is that of each vertex."""
    of_corner = component[mesh.faces]
    of_face = np.where((of_corner == of_corner[:, :1]).all(axis=1), of_corner[:, 0], -1)
    return [component_of(mesh.vertices, mesh.faces[of_face == number]) for number in chosen]


def _image(
    surface: Component | None,
    surfaces: Sequence[Component | None],
    found: Sequence[Counterpart],
    planes: Sequence[SymmetryPlane],
) -> Float64 | None:
    """Return the isometry (3, 4) from the handle's own component to `surface`, if they are mirror images.

    The planes of the whole shape are tried first, then a plane fitted to the two components. A component may also be
    the mirror image of another mirror image of the handle's own component.
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
    mesh: Mesh,
    inside: Bool,
    weights: NDArray[np.floating],
    peak: int,
    found: Sequence[Counterpart],
    planes: Sequence[SymmetryPlane],
) -> tuple[int, Float64]:
    """Return the vertex on the nodes `inside` (N,) that corresponds to the handle, and its frame.

    The vertex is the mirror image of a counterpart found before, if it is nearly as similar as the most similar vertex,
    `peak`. Otherwise it is `peak`, and its frame is reflected in each plane between it and the handle.
    """
    nodes = nodes_of(mesh)
    for plane in planes:
        images = plane.reflect([other.position for other in found])
        for other, nearest in zip(found, nodes.nearest(images).tolist(), strict=True):
            if inside[nodes.of_vertex[nearest]] and weights[nearest] >= weights[peak] - AS_ALIKE:
                return nearest, plane.reflection[:3, :3] @ other.frame
    frame = np.eye(3)
    for plane in planes:
        ours, theirs = plane.signed_distance([found[0].position, mesh.vertices[peak]])
        if ours * theirs < 0:
            frame = plane.reflection[:3, :3] @ frame
    return peak, frame


def _closeness(mesh: Mesh, components: Sequence[Int64]) -> Float64:
    """Return (K, N) shares: 1 on the nodes of each component, with smooth transitions in between."""
    nodes = nodes_of(mesh)
    closeness = np.empty((len(components), len(nodes.center)))
    for row, members in zip(closeness, components, strict=True):
        distance = dijkstra(nodes.graph, indices=members, min_only=True)
        # Nodes on other components of the mesh get the straight distance plus the diagonal: connected ones come first.
        if len(apart := np.flatnonzero(np.isinf(distance) & nodes.used)):
            straight = cKDTree(nodes.center[members]).query(nodes.center[apart])[0]
            distance[apart] = straight + mesh.diagonal
        row[:] = (distance / mesh.diagonal + 1e-4) ** -SHARPNESS
    closeness[0, ~nodes.used] = 1.0
    closeness /= closeness.max(axis=0)  # the nearest counterpart has 1
    closeness -= CLEAR
    np.maximum(closeness, 0.0, out=closeness)
    closeness /= closeness.sum(axis=0)
    return closeness
