"""Fit the axis of a part: a curve from its base, where the part meets the rest of the shape, to its tip.

Each point of the curve has a parameter: 0 at the base, 1 at the tip. A region that is connected to the shape only
through the part, such as a hoof, is attached to the part and moves with it. A node is a group of nearby mesh vertices
(`dfd.geometry.coarse`), except in `PartAxis.nodes`, which are points of the curve.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from dfd.common.linear_algebra import Bool, Float64, Int32, Int64, unit
from dfd.geometry.coarse import Nodes, nodes_of
from dfd.geometry.topology import even_points, face_areas
from dfd.mesh.mesh import Mesh

NODES = 33  # number of points of the curve
SAMPLES = 4_000  # number of surface samples of the part, to which the curve is fitted
# Each point of the curve is an average of samples, weighted by a Gaussian kernel. The kernel's standard deviation is
# the larger of two values: WIDTH times the part's length, and WIDE times the part's radius.
WIDTH, WIDE = 0.08, 0.5
STOUT = 0.4  # if a part's radius divided by its length is above this, its nodes keep their first parameters (`_curve`)
ENDS = (0.005, 0.995)  # quantiles of the parameters between which the curve runs, so that no outlier sets the tip
ROUNDS = 3  # number of rounds, each of which fits the curve and projects the samples onto it
FARTHEST = 0.2  # largest difference between a point's parameter on the curve and its scaled distance from the base
RISE = 0.6  # distance from the base, in radii there, up to which a factor of the parameters rises smoothly from 0 to 1
NEAR_JOINT = 0.12  # joints whose parameter differs from the handle's by at most this are preferred
SLENDER = 0.75  # the length of a limb, divided by its width, is above this
# A wheel is a part with these variances along its principal axes: the middle variance is above ROUND times the largest,
# and the smallest variance is below FLAT times the largest.
ROUND, FLAT = 0.95, 0.7
ATTACHED = 0.5  # a region beside a part is attached to it if its area is at most this share of the largest such area
SMALL_COMPONENT = 0.05  # a component of a part has no axis if its area is at most this share of the largest component's


@dataclass(frozen=True, eq=False)
class PartAxis:
    """The axis of one connected part. Positions and lengths are in mesh units."""

    vertices: Int64  # (N,) vertices of the part and of attached regions, ascending
    parameter: Float64  # (N,) curve parameter of each vertex; nearly constant in an attached region far from the part
    nodes: Float64  # (33, 3) points of the curve at equal steps of its length, from base to tip
    radius: Float64  # (33,) root mean squared distance of the surface from the curve, around each of these points
    border: Float64  # (B, 3) positions at the border with the rest of the shape, or at one end if there is no rest
    borders: int  # number of separate borders with the rest of the shape
    middle: Float64  # (3,) center of the part's surface
    rest: Float64  # (3,) mean of those nodes of the rest of the shape that are nearer to the base than the tip is
    spread: Float64  # (3,) variances of the part's surface along its principal axes, ascending

    @property
    def length(self) -> float:
        """Return the length of the curve."""
        return float(np.linalg.norm(np.diff(self.nodes, axis=0), axis=1).sum())

    @property
    def base(self) -> Float64:
        """Return the center (3,) of the border's bounding box."""
        return (self.border.min(axis=0) + self.border.max(axis=0)) / 2

    @property
    def direction(self) -> Float64:
        """Return the unit direction (3,) from the first to the last point of the curve."""
        return np.asarray(unit((self.nodes[-1] - self.nodes[0])[None])[0])

    @property
    def is_slender(self) -> bool:
        """Return whether the part is longer than `SLENDER` times its width, and is not a wheel."""
        if self.spread[1] > ROUND * self.spread[2] and self.spread[0] < FLAT * self.spread[2]:
            return False
        return self.length > SLENDER * 2 * float(np.sqrt(np.square(self.radius).mean()))

    @property
    def is_limb(self) -> bool:
        """Return whether the part is slender and has one border with the rest of the shape."""
        return self.borders == 1 and self.is_slender

    @cached_property
    def tangents(self) -> Float64:
        """Return the unit tangents (33, 3) of the curve."""
        return unit(np.gradient(self.nodes, axis=0))

    def joint(self, point: NDArray[np.floating]) -> float:
        """Return the parameter of the joint: the strongest bend or the narrowest place, such as a knee or an elbow.

        Only parameters from 0.2 to 0.8 are searched. If the parameter of `point` (3,) is in or near this range, only
        similar parameters are searched, so that a handle at a knee does not select the ankle.
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
        """Return the parameter, in [0, 1], of the curve's point nearest to `point` (3,)."""
        return int(np.linalg.norm(self.nodes - point, axis=1).argmin()) / (NODES - 1)

    @property
    def hinge(self) -> tuple[Float64, Float64]:
        """Return a point (3,) and the unit direction (3,) of the hinge, a line along border points far from the tip.

        A positive rotation about this line moves the tip away from the rest of the shape, as a jaw opens.
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
    """Compute the axes of parts of one mesh, on the mesh's nodes (`dfd.geometry.coarse`)."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    @cached_property
    def _nodes(self) -> Nodes:
        return nodes_of(self._mesh)

    def of(self, inside: Bool) -> list[PartAxis]:
        """Return an axis for each large component of the part `inside` (V,), the largest component first."""
        nodes = self._nodes
        own = np.flatnonzero(2 * np.bincount(nodes.of_vertex, inside) > nodes.ends - nodes.starts)
        component = connected_components(nodes.graph[own][:, own], directed=False)[1]
        area = np.bincount(component, self._nodes.area[own])
        order = np.argsort(-area, kind="stable")
        of_node = np.full(len(nodes.center), -1)
        of_node[own] = component
        first, *others = (of_node[nodes.of_vertex[corner]] for corner in self._mesh.faces.T)
        of_face = np.where((first == others[0]) & (first == others[1]), first, -1)
        large = (k for k in order if area[k] > SMALL_COMPONENT * area[order[0]])
        found = [self._of_component(own[component == k], self._mesh.faces[of_face == k]) for k in large]
        return [axis for axis in found if axis is not None]

    def _of_component(self, own: Int64, faces: Int32) -> PartAxis | None:
        """Return the axis of a component with nodes `own` (M,) and `faces` (F, 3); None if the length or area is 0."""
        center, graph = self._nodes.center, self._nodes.graph
        inside = np.zeros(len(center), bool)
        inside[own] = True
        beside = np.zeros(len(inside), bool)
        beside[graph[own].indices] = True
        outside = np.flatnonzero(~inside)
        region = np.full(len(inside), -1)  # index of the connected region of each node outside the part
        region[outside] = connected_components(graph[outside][:, outside], directed=False)[1]
        area = np.bincount(region[outside], self._nodes.area[outside])
        around = np.unique(region[beside & ~inside])
        rests = around[area[around] > ATTACHED * area[around].max()] if len(around) else around
        is_rest = np.isin(region, rests) & (region >= 0)
        touched = np.zeros(len(inside), bool)
        touched[graph[np.flatnonzero(is_rest & beside)].indices] = True
        base = np.flatnonzero(touched & inside)
        local = graph[own][:, own]
        number = np.full(len(inside), -1)
        number[own] = np.arange(len(own))
        if len(base) == 0:
            base = own[self._end(local, own)]
            borders = 0
        else:
            ring = np.flatnonzero((is_rest & beside) | (touched & inside))
            borders = connected_components(graph[ring][:, ring], directed=False)[0]
        away = dijkstra(local, indices=number[base], min_only=True)
        if not (np.isfinite(away).all() and away.max() > 0):
            return None
        curve = self._curve(own, faces, number, away)
        if curve is None:
            return None
        nodes, radius, parameter = curve
        rise = np.clip(away / max(RISE * radius[: NODES // 4].mean(), 1e-300), 0.0, 1.0)
        parameter = np.clip(parameter, 0.0, 1.0) * rise * rise * (3 - 2 * rise)
        weight = self._nodes.area[own]
        points, weight = center[own], weight if weight.sum() > 0 else np.ones(len(own))
        middle = np.average(points, axis=0, weights=weight)
        spread = np.linalg.eigvalsh(np.cov(points.T, aweights=weight, ddof=0)).astype(np.float64)
        near = np.flatnonzero(is_rest)
        near = near[np.linalg.norm(center[near] - nodes[0], axis=1) < np.linalg.norm(nodes[-1] - nodes[0])]
        rest = center[near].mean(axis=0) if len(near) else nodes[0]
        attached = np.flatnonzero((region >= 0) & np.isin(region, around) & ~is_rest)
        vertices, parameter = self._on_vertices(*self._with_attached(own, parameter, attached, region))
        return PartAxis(vertices, parameter, nodes, radius, center[base], borders, middle, rest, spread)

    def _on_vertices(self, some: Int64, values: Float64) -> tuple[Int64, Float64]:
        """Return the vertices (N,) of nodes `some` (M,), and values (N,) interpolated from the nodes' `values` (M,).

        Gradients are interpolated too, so that values that are linear in space stay linear.
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
        """Return the base of a part without borders, as indices (K,) in `own`: the end nearer to the shape's center."""
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
        """Return the curve (33, 3), its radius (33,) and the parameters (M,) of `own`; None if all `faces` have area 0.

        The curve is a principal curve (Hastie and Stuetzle 1989). The first parameters are the distances `away` (M,)
        from the base, divided by the largest. In each round, a point of the curve is fitted to the samples with similar
        parameters. Projection of the samples onto the curve then gives their new parameters.
        """
        if not face_areas(self._mesh.vertices, faces).sum() > 0:
            return None
        of_corner, barycentric = even_points(self._mesh.vertices, faces, SAMPLES)
        corners = number[self._nodes.of_vertex[of_corner]]
        points = np.einsum("nk,nkd->nd", barycentric, self._mesh.vertices[of_corner])
        start = (barycentric * away[corners]).sum(axis=1) / away.max()
        parameter, width = start, WIDTH
        own_level = away / away.max()
        for _ in range(ROUNDS):
            at = np.linspace(np.quantile(parameter, ENDS[0]), np.quantile(parameter, ENDS[1]), NODES)
            nodes = _resampled(_fitted(at, parameter, points, width))
            width = float(np.sqrt(np.square(points - _on(nodes, parameter)).sum(axis=1).mean())) / away.max()
            if width > STOUT:
                break
            width = max(WIDTH, WIDE * width)
            parameter = _projected(nodes, points, start)
        else:
            own_level = _projected(nodes, self._nodes.center[own], own_level)
        at = np.linspace(0.0, 1.0, NODES)
        squares = np.square(points - _on(nodes, parameter)).sum(axis=1)
        radius = np.sqrt(_fitted(at, parameter, squares[:, None], WIDTH, straight=False)[:, 0])
        return nodes, radius, own_level

    def _with_attached(self, own: Int64, parameter: Float64, attached: Int64, region: Int64) -> tuple[Int64, Float64]:
        """Return the nodes of the part and of the `attached` regions, and their parameters.

        Near the part, the parameters of a region equal the part's. Farther away, they change to the region's median.
        """
        if len(attached) == 0:
            return own, parameter
        nodes = np.sort(np.concatenate([own, attached]))
        known = np.full(len(region), np.nan)
        known[own] = parameter
        local = self._nodes.graph[nodes][:, nodes]
        unknown = np.isnan(known[nodes])
        distance, _, source = dijkstra(local, indices=np.flatnonzero(~unknown), min_only=True, return_predecessors=True)
        result = np.where(unknown, known[nodes[np.maximum(source, 0)]], known[nodes])
        for number in np.unique(region[attached]):
            here = region[nodes] == number
            far = np.clip(distance[here] / max(distance[here].max() / 3, 1e-300), 0.0, 1.0)
            result[here] += (np.median(result[here]) - result[here]) * far * far * (3 - 2 * far)
        return nodes, result


def _fitted(at: Float64, parameter: Float64, values: Float64, width: float, *, straight: bool = True) -> Float64:
    """Return values (K, D) at the parameters `at` (K,), smoothed from samples: `values` (N, D) at `parameter` (N,).

    The kernel is a Gaussian with the standard deviation `width`. If `straight` is True, local lines are fitted instead
    of local means, so that the curve does not shrink at its ends.
    """
    apart = parameter[None] - at[:, None]
    kernel = np.exp(-0.5 * np.square(apart / width)) + 1e-12
    total = kernel.sum(axis=1)
    mean = kernel @ values / total[:, None]
    if not straight:
        return np.asarray(mean)
    lean = (kernel * apart).sum(axis=1) / total
    centered = apart - lean[:, None]
    spread = (kernel * np.square(centered)).sum(axis=1)
    slope = (kernel * centered) @ values / np.maximum(spread, 1e-6 * width**2 * total)[:, None]
    return np.asarray(mean - slope * lean[:, None])


def _resampled(nodes: Float64) -> Float64:
    """Return the curve `nodes` (K, 3), resampled at equal steps of its length."""
    step = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    length = np.concatenate([[0.0], np.cumsum(step)])
    if length[-1] == 0:
        return nodes
    wanted = np.linspace(0.0, length[-1], len(nodes))
    return np.stack([np.interp(wanted, length, axis) for axis in nodes.T], axis=1)


def _on(nodes: Float64, parameter: Float64) -> Float64:
    """Return the points (N, 3) of a curve at `parameter` (N,)."""
    at = np.linspace(0.0, 1.0, len(nodes))
    return np.stack([np.interp(parameter, at, axis) for axis in nodes.T], axis=1)


def _projected(nodes: Float64, points: Float64, start: Float64) -> Float64:
    """Project `points` (N, 3) onto a curve. Return their parameters (N,), at most `FARTHEST` from those in `start`."""
    at = np.linspace(0.0, 1.0, len(nodes))
    best, nearest = start.copy(), np.full(len(points), np.inf)
    along = np.diff(nodes, axis=0)
    squares = np.maximum(np.square(along).sum(axis=1), 1e-300)
    for k, (node, side) in enumerate(zip(nodes[:-1], along, strict=True)):
        # The curve is extended by straight lines beyond its ends, so that parameters there stay distinct.
        low = -np.inf if k == 0 else 0.0
        high = np.inf if k == len(along) - 1 else 1.0
        some = np.flatnonzero(np.abs(at[k] - start) <= 2 * FARTHEST)
        apart = points[some] - node
        fraction = np.clip(apart @ side / squares[k], low, high)
        parameter = at[k] + fraction / len(along)
        far = np.square(apart - fraction[:, None] * side).sum(axis=1)
        better = (far < nearest[some]) & (np.abs(parameter - start[some]) <= FARTHEST)
        best[some[better]], nearest[some[better]] = parameter[better], far[better]
    return best
