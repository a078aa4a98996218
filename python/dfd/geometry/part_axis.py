"""Fit the axis of a part: a curve from its base, where the part meets the rest of the shape, to its tip."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Bool, Float64, Int32, Int64, unit
from dfd.geometry.coarse import Nodes, nodes_of
from dfd.geometry.topology import even_points, face_areas, vertex_areas
from dfd.mesh.mesh import Mesh

NODES = 33  # points of the curve
SAMPLES = 4_000  # surface samples of the part, to which the curve is fitted
# Each point of the curve is a mean over this fraction of the length, or over this many radii if that is more.
WIDTH, WIDE = 0.08, 0.5
# Radius over length. A stouter part keeps the distances to the base as its levels.
STOUT = 0.4
# The curve runs between these quantiles of the levels, so that a single vertex does not set the tip.
ENDS = (0.005, 0.995)
ROUNDS = 3  # of fitting the curve and projecting the samples onto it
# Fraction of the length: largest difference between a vertex's projection and its distance to the base.
FARTHEST = 0.2
# In radii at the base: distance along the surface over which motion along the axis begins.
SEAM = 0.6
# Fraction of the length: a joint this near to the handle is taken first.
NEAR_JOINT = 0.12
SLENDER = 0.75  # a limb is longer than this times its width
# Variances of a wheel's surface, over the largest: the least of the second, and the most of the third.
ROUND, FLAT = 0.95, 0.7
# Fraction of the largest region around a part: smaller regions that touch the part move with it.
CARRIED = 0.5
# Fraction of the largest component of a region: a smaller component has no axis.
SMALL_COMPONENT = 0.05


@dataclass(frozen=True, eq=False)
class PartAxis:
    """The axis of one connected part."""

    vertices: Int64  # (N,) vertices of the part and of the regions that move with it, ascending
    # (N,) position of each vertex along the axis, in [0, 1]: 0 at the base, 1 at the tip.
    # Vertices that move with the part have the position of the place where they are attached.
    parameter: Float64
    nodes: Float64  # (33, 3) curve at equal steps of its length, from base to tip, mesh units
    radius: Float64  # (33,) root mean squared distance of the surface from the curve, mesh units
    # (B, 3) positions where the part meets the rest, mesh units; one end of the part if there is no rest
    border: Float64
    borders: int  # number of places where the part meets the rest
    middle: Float64  # (3,) center of the part's surface, mesh units
    # (3,) center of the rest of the shape near the base, mesh units
    rest: Float64
    # (3,) variances of the part's surface along its principal axes, ascending
    spread: Float64

    @property
    def length(self) -> float:
        """Return the length of the curve, mesh units."""
        return float(np.linalg.norm(np.diff(self.nodes, axis=0), axis=1).sum())

    @property
    def base(self) -> Float64:
        """Return the mean position (3,) of the border, mesh units."""
        return (self.border.min(axis=0) + self.border.max(axis=0)) / 2

    @property
    def direction(self) -> Float64:
        """Return the unit direction (3,) from the first to the last point of the curve."""
        return np.asarray(unit((self.nodes[-1] - self.nodes[0])[None])[0])

    @property
    def is_limb(self) -> bool:
        """Return whether the part meets the rest in one place, is longer than wide, and is not a wheel."""
        if self.spread[1] > ROUND * self.spread[2] and self.spread[0] < FLAT * self.spread[2]:
            return False
        return self.borders == 1 and self.length > SLENDER * 2 * float(np.sqrt(np.square(self.radius).mean()))

    @cached_property
    def tangents(self) -> Float64:
        """Return the unit tangents (33, 3) of the curve."""
        return unit(np.gradient(self.nodes, axis=0))

    def joint(self, point: NDArray[np.floating]) -> float:
        """Return the position along the axis, in [0, 1], of the joint: the strongest bend or the narrowest place.

        Examples are a knee, an elbow, and the neck of a bottle. Only the middle of the axis, 0.2 to 0.8, is searched.
        If `point` (3,) is there, only places near it are searched: a handle at a knee does not select the ankle.
        """
        at = np.linspace(0.0, 1.0, NODES)
        inner = (at > 0.2) & (at < 0.8)
        near = inner & (np.abs(at - self.nearest(point)) <= NEAR_JOINT)
        if near.any():
            inner = near
        step = NODES // 8
        turn = np.zeros(NODES)
        cosines = (self.tangents[2 * step :] * self.tangents[: -2 * step]).sum(axis=1)
        turn[step:-step] = np.arccos(np.clip(cosines, -1.0, 1.0))
        beside = np.convolve(np.pad(self.radius, step, "edge"), np.ones(2 * step + 1) / (2 * step + 1), "valid")
        narrow = np.log(beside / np.maximum(self.radius, 1e-12))
        return float(at[np.where(inner, turn + 2 * narrow, -np.inf).argmax()])

    def nearest(self, point: NDArray[np.floating]) -> float:
        """Return the position along the axis, in [0, 1], of the curve's point nearest to `point` (3,)."""
        return int(np.linalg.norm(self.nodes - point, axis=1).argmin()) / (NODES - 1)

    @property
    def hinge(self) -> tuple[Float64, Float64]:
        """Return the middle (3,) and direction (3,) of the line through the border's extremes farthest from the tip.

        A positive turn about this line moves the tip away from the rest of the shape, as a jaw opens.
        """
        far = np.linalg.norm(self.border - self.nodes[-1], axis=1)
        back = self.border[far >= far.max() - self.radius[: NODES // 4].mean()]
        spread = back - back.mean(axis=0)
        across = np.linalg.eigh(spread.T @ spread)[1][:, -1]
        across = unit((across - (across @ self.direction) * self.direction)[None])[0]
        along = back @ across
        middle = (back[along.argmin()] + back[along.argmax()]) / 2
        opens = np.cross(across, self.nodes[-1] - middle) @ (self.middle - self.rest)
        return middle, across if opens >= 0 else -across


class PartAxes:
    """Find the axes of parts of one mesh, on its nodes (`dfd.geometry.coarse`)."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    @cached_property
    def _nodes(self) -> Nodes:
        return nodes_of(self._mesh)

    @cached_property
    def _areas(self) -> Float64:
        """Return the area (N,) of each node, mesh units squared."""
        areas = vertex_areas(self._mesh.vertices, self._mesh.faces)
        return np.bincount(self._nodes.of_vertex, areas, len(self._nodes.center)).astype(np.float64)

    def of(self, inside: Bool) -> list[PartAxis]:
        """Return the axes of the components of a region `inside` (V,), largest first. Small components have none."""
        nodes = self._nodes
        own = np.flatnonzero(2 * np.bincount(nodes.of_vertex, inside) > nodes.ends - nodes.starts)
        component = connected_components(nodes.graph[own][:, own], directed=False)[1]
        area = np.bincount(component, self._areas[own])
        order = np.argsort(-area, kind="stable")
        of_node = np.full(len(nodes.center), -1)
        of_node[own] = component
        first, *others = (of_node[nodes.of_vertex[corner]] for corner in self._mesh.faces.T)
        of_face = np.where((first == others[0]) & (first == others[1]), first, -1)
        large = (k for k in order if area[k] > SMALL_COMPONENT * area[order[0]])
        found = [self._of_component(own[component == k], self._mesh.faces[of_face == k]) for k in large]
        return [axis for axis in found if axis is not None]

    def image(self, axis: PartAxis, isometry: Float64) -> PartAxis:
        """Return the axis of a counterpart, onto which `isometry` (3, 4) maps the part of `axis`.

        The axis has no vertices if the mesh has none there.
        """
        nodes, linear, shift = self._nodes, isometry[:, :3], isometry[:, 3]
        total = np.bincount(nodes.of_vertex[axis.vertices], axis.parameter, len(nodes.center))
        some, values = carried(nodes.center, nodes.tree, total / (nodes.ends - nodes.starts), isometry)
        vertices, parameter = self._on_vertices(some, values)
        points = (points @ linear.T + shift for points in (axis.nodes, axis.border, axis.middle, axis.rest))
        curve, border, middle, rest = points
        return replace(
            axis, vertices=vertices, parameter=parameter, nodes=curve, border=border, middle=middle, rest=rest
        )

    def _of_component(self, own: Int64, faces: Int32) -> PartAxis | None:
        """Return the axis of a connected component of nodes `own` (M,) and `faces` (F, 3)."""
        center, graph = self._nodes.center, self._nodes.graph
        inside = np.zeros(len(center), bool)
        inside[own] = True
        beside = np.zeros(len(inside), bool)
        beside[graph[own].indices] = True
        outside = np.flatnonzero(~inside)
        group = np.full(len(inside), -1)
        group[outside] = connected_components(graph[outside][:, outside], directed=False)[1]
        area = np.bincount(group[outside], self._areas[outside])
        around = np.unique(group[beside & ~inside])
        rests = around[area[around] > CARRIED * area[around].max()] if len(around) else around
        is_rest = np.isin(group, rests) & (group >= 0)
        touched = np.zeros(len(inside), bool)
        touched[graph[np.flatnonzero(is_rest & beside)].indices] = True
        seeds = np.flatnonzero(touched & inside)
        local = graph[own][:, own]
        number = np.full(len(inside), -1)
        number[own] = np.arange(len(own))
        if len(seeds) == 0:
            seeds = own[self._end(local, own)]
            borders = 0
        else:
            ring = np.flatnonzero((is_rest & beside) | (touched & inside))
            borders = connected_components(graph[ring][:, ring], directed=False)[0]
        away = dijkstra(local, indices=number[seeds], min_only=True)
        if not (np.isfinite(away).all() and away.max() > 0):
            return None
        curve = self._curve(own, faces, number, away)
        if curve is None:
            return None
        nodes, radius, parameter = curve
        seam = SEAM * radius[: NODES // 4].mean()
        mix = np.clip(away / max(seam, 1e-300), 0.0, 1.0)
        parameter = np.clip(parameter, 0.0, 1.0) * mix * mix * (3 - 2 * mix)
        weight = self._areas[own]
        points, weight = center[own], weight if weight.sum() > 0 else np.ones(len(own))
        middle = np.average(points, axis=0, weights=weight)
        spread = np.linalg.eigvalsh(np.cov(points.T, aweights=weight, ddof=0)).astype(np.float64)
        near = np.flatnonzero(is_rest)
        near = near[np.linalg.norm(center[near] - nodes[0], axis=1) < np.linalg.norm(nodes[-1] - nodes[0])]
        rest = center[near].mean(axis=0) if len(near) else nodes[0]
        hanging = np.flatnonzero((group >= 0) & np.isin(group, around) & ~is_rest)
        vertices, parameter = self._on_vertices(*self._with_hanging(own, parameter, hanging, group))
        return PartAxis(vertices, parameter, nodes, radius, center[seeds], borders, middle, rest, spread)

    def _on_vertices(self, some: Int64, values: Float64) -> tuple[Int64, Float64]:
        """Interpolate `values` (M,) of the nodes `some` (M,). Return these nodes' vertices (N,) and their values (N,).

        Each node gives a value and a gradient, so values that are linear in space stay linear.
        """
        nodes = self._nodes
        chosen = np.zeros(len(nodes.center), bool)
        chosen[some] = True
        vertices = np.flatnonzero(chosen[nodes.of_vertex])
        if len(some) == 0 or len(nodes.center) == len(nodes.of_vertex):
            return vertices, values
        center = nodes.center[some] - nodes.center[some[0]]
        local = nodes.graph[some][:, some]
        row = np.repeat(np.arange(len(some)), np.diff(local.indptr))
        to, rise = center[local.indices] - center[row], values[local.indices] - values[row]
        products = np.concatenate([to[:, :, None] * to[:, None], (to * rise[:, None])[:, :, None]], axis=2)
        sums = np.stack([np.bincount(row, each, len(some)) for each in products.reshape(-1, 12).T], 1).reshape(-1, 3, 4)
        square, right = sums[:, :, :3], sums[:, :, 3:]
        size = np.trace(square, axis1=1, axis2=2)[:, None, None] + 1e-300
        gradient = np.linalg.solve(square + 1e-3 * size * np.eye(3), right)[:, :, 0]
        rows = np.zeros((len(chosen), 5), np.float32)
        rows[some] = np.column_stack([np.ones(len(some)), values - (gradient * center).sum(axis=1), gradient])
        found = nodes.interpolated(rows, vertices).astype(np.float64)
        points = self._mesh.vertices[vertices] - nodes.center[some[0]]
        return vertices, (found[:, 1] + (found[:, 2:] * points).sum(axis=1)) / found[:, 0]

    def _end(self, local: csr_matrix, own: Int64) -> Int64:
        """Return the nodes (K,) of the base, for a part without surroundings: the end nearer to the shape's center."""
        some = dijkstra(local, indices=0)
        one = int(np.where(np.isfinite(some), some, -1).argmax())
        away = dijkstra(local, indices=one)
        other = int(np.where(np.isfinite(away), away, -1).argmax())
        center = self._mesh.bounds.mean(axis=0)
        ends = np.linalg.norm(self._nodes.center[own[[one, other]]] - center, axis=1)
        start = one if ends[0] <= ends[1] else other
        near = dijkstra(local, indices=start)
        return np.flatnonzero(near <= 0.05 * near[np.isfinite(near)].max())

    def _curve(self, own: Int64, faces: Int32, number: Int64, away: Float64) -> tuple[Float64, Float64, Float64] | None:
        """Return the curve (33, 3), its radius (33,), and the position along it of the nodes `own` (M,).

        Return None if the faces have no area. The curve is a principal curve (Hastie and Stuetzle 1989). The first
        levels are the distances `away` from the base. Each round takes means of the samples at each level as the curve,
        and then projects the samples onto it for new levels.
        """
        areas = face_areas(self._mesh.vertices, faces)
        if not areas.sum() > 0:
            return None
        face, barycentric = even_points(areas, SAMPLES)
        corners = number[self._nodes.of_vertex[faces[face]]]
        weight = np.ones(SAMPLES)
        points = np.einsum("nk,nkd->nd", barycentric, self._mesh.vertices[faces[face]])
        start = (barycentric * away[corners]).sum(axis=1) / away.max()
        level, width = start, WIDTH
        own_level = away / away.max()
        for _ in range(ROUNDS):
            at = np.linspace(np.quantile(level, ENDS[0]), np.quantile(level, ENDS[1]), NODES)
            nodes = _even(_fitted(at, level, points, weight, width))
            thick = np.average(np.square(points - _on(nodes, level)).sum(axis=1), weights=weight)
            width = float(np.sqrt(thick)) / away.max()
            if width > STOUT:
                break
            width = max(WIDTH, WIDE * width)
            level = _projected(nodes, points, start)
        else:
            own_level = _projected(nodes, self._nodes.center[own], own_level)
        at = np.linspace(0.0, 1.0, NODES)
        squares = np.square(points - _on(nodes, level)).sum(axis=1)
        radius = np.sqrt(_fitted(at, level, squares[:, None], weight, WIDTH, straight=False)[:, 0])
        return nodes, radius, own_level

    def _with_hanging(self, own: Int64, parameter: Float64, hanging: Int64, group: Int64) -> tuple[Int64, Float64]:
        """Return the nodes of the part and of the regions `hanging` on it, and their positions along the axis.

        Far from the part, all nodes of a region have one position.
        """
        if len(hanging) == 0:
            return own, parameter
        nodes = np.sort(np.concatenate([own, hanging]))
        known = np.full(len(group), np.nan)
        known[own] = parameter
        local = self._nodes.graph[nodes][:, nodes]
        distance, _, source = dijkstra(
            local, indices=np.flatnonzero(~np.isnan(known[nodes])), min_only=True, return_predecessors=True
        )
        nearest = known[nodes[np.maximum(source, 0)]]
        result = np.where(np.isnan(known[nodes]), nearest, known[nodes])
        of = group[nodes]
        for one in np.unique(of[of >= 0]):
            here = of == one
            width = float(np.ptp(result[here]))
            size = distance[here].max()
            far = np.clip(distance[here] / max(size / 3, 1e-300), 0.0, 1.0)
            if width > 0:
                result[here] += (np.median(result[here]) - result[here]) * far * far * (3 - 2 * far)
        return nodes, result


def carried(vertices: Float64, tree: cKDTree, values: Float64, isometry: Float64) -> tuple[Int64, Float64]:
    """Map `values` (V,) by `isometry` (3, 4). Return the vertices (N,) with values above 0, and these values (N,).

    Each vertex gets the mean over the vertices nearest to its preimage, weighted by proximity.
    """
    linear, shift = isometry[:, :3], isometry[:, 3]
    some = vertices[values > 0]
    margin = 0.05 * np.ptp(some, axis=0).max(initial=0.0)
    corners = np.stack(np.meshgrid(*np.stack([some.min(axis=0) - margin, some.max(axis=0) + margin]).T), -1)
    box = corners.reshape(-1, 3) @ linear.T + shift
    near = np.flatnonzero(((vertices >= box.min(axis=0)) & (vertices <= box.max(axis=0))).all(axis=1))
    shape = len(near), min(4, len(vertices))
    apart, nearest = (found.reshape(shape) for found in tree.query((vertices[near] - shift) @ linear, k=shape[1]))
    weight = 1.0 / np.square(apart + 1e-6 * (margin + 1e-300))
    found = (weight * values[nearest]).sum(axis=1) / weight.sum(axis=1)
    return near[found > 0], found[found > 0]


def _fitted(
    at: Float64, level: Float64, values: Float64, weight: Float64, width: float, *, straight: bool = True
) -> Float64:
    """Return `values` (N, D) at the levels `at` (K,), as (K, D): local means, or local lines, which keep the ends."""
    apart = level[None] - at[:, None]
    kernel = weight * np.exp(-0.5 * np.square(apart / width)) + 1e-12 * weight
    total = kernel.sum(axis=1)
    mean = kernel @ values / total[:, None]
    if not straight:
        return np.asarray(mean)
    lean = (kernel * apart).sum(axis=1) / total
    centered = apart - lean[:, None]
    spread = (kernel * np.square(centered)).sum(axis=1)
    slope = (kernel * centered) @ values / np.maximum(spread, 1e-6 * width**2 * total)[:, None]
    return np.asarray(mean - slope * lean[:, None])


def _even(nodes: Float64) -> Float64:
    """Return the curve resampled at equal steps of its length (K, 3)."""
    step = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(step)])
    if length[-1] == 0:
        return nodes
    wanted = np.linspace(0.0, length[-1], len(nodes))
    return np.stack([np.interp(wanted, length, axis) for axis in nodes.T], axis=1)


def _on(nodes: Float64, level: Float64) -> Float64:
    """Return the points (N, 3) of a curve at `level` (N,)."""
    at = np.linspace(0.0, 1.0, len(nodes))
    return np.stack([np.interp(level, at, axis) for axis in nodes.T], axis=1)


def _projected(nodes: Float64, points: Float64, start: Float64) -> Float64:
    """Return the level (N,) of each of `points` (N, 3) on a curve, searched near `start` (N,)."""
    at = np.linspace(0.0, 1.0, len(nodes))
    best, nearest = start.copy(), np.full(len(points), np.inf)
    along = np.diff(nodes, axis=0)
    squares = np.maximum(np.square(along).sum(axis=1), 1e-300)
    for k, (node, side) in enumerate(zip(nodes[:-1], along, strict=True)):
        # The curve continues straight beyond its ends, so that levels there stay distinct.
        low = -np.inf if k == 0 else 0.0
        high = np.inf if k == len(along) - 1 else 1.0
        some = np.flatnonzero(np.abs(at[k] - start) <= 2 * FARTHEST)
        apart = points[some] - node
        fraction = np.clip(apart @ side / squares[k], low, high)
        level = at[k] + fraction / len(along)
        far = np.square(apart - fraction[:, None] * side).sum(axis=1)
        better = (far < nearest[some]) & (np.abs(level - start[some]) <= FARTHEST)
        best[some[better]], nearest[some[better]] = level[better], far[better]
    return best
