"""Hold a part at rest: its components, the motion that maps the handle's component onto each, and signed depths.

The depth of a place is its distance from the border of the part along the surface: positive inside, negative outside.
Distances never cross a gap, such as a gap between lips, teeth or fingers. Nothing here depends on a handle's motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64, unit
from dfd.editing.weights.contacts import Contacts, contacts_of, following, joined, unbordered, with_hanging, with_room
from dfd.editing.weights.counterparts import find_counterparts
from dfd.editing.weights.fill import LEAST_DEPTH, Component, Counterpart
from dfd.geometry.coarse import Nodes, Share, nodes_of
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import vector
from dfd.symmetry.plane import SymmetryPlane

# The radius of a border is the root mean squared distance of its points from their center, such as that of a limb at
# its base. Outside the part, a band extends at most OUTSIDE radii, and covers at most BEYOND of the surface there.
# Inside, it covers at most INSIDE of the component's depth, so that at least the outer half of a limb keeps its shape.
OUTSIDE, BEYOND, INSIDE = 1.5, 0.2, 0.5
# A motion that lengthens a component stretches it where it is thin: up to the depth at which its section is WIDER times
# as long as the shortest one before. So the posts below the back of a chair stretch, but not the back. The number of
# sections is SECTIONS. Of 68 pulls by 0.2 diagonals on 17 shapes, five change visibly: the backs of two chairs, a
# table, the head of a robot, the body of an ant. Their edges change by 4.4 % in place of 9.1 %.
WIDER, SECTIONS = 2.0, 16
# Depths are smoothed by a Gaussian with this standard deviation, in radii, because borders run in zigzags along nodes.
SMOOTHING = 0.4
LARGEST = 1e300  # stands for infinite lengths in divisions


@dataclass(frozen=True, eq=False)
class HeldPart:
    """The part at a place, at rest: the component at the place, then the others by decreasing similarity."""

    components: tuple[Component, ...]
    nodes: Nodes
    component_of_node: Int64  # (N,) component of each mesh node; −1 outside the part

    def area(self, number: int) -> float:
        """Return the area of a component, as a fraction of the area of the surface."""
        return float(self.nodes.area[self.component_of_node == number].sum() / self.nodes.area.sum())

    def components_of(self, vertices: Int64) -> Int64:
        """Return the component that contains each of `vertices` (N,), or −1."""
        return self.component_of_node[self.nodes.of_vertex[vertices]]

    def at(self, vertex: int) -> int:
        """Return the index of the component that contains a vertex, or else of the one with the nearest counterpart."""
        inside = int(self.component_of_node[self.nodes.of_vertex[vertex]])
        if inside >= 0:
            return inside
        places = np.array([one.counterpart.position for one in self.components])
        return int(np.linalg.norm(places - self.nodes.center[self.nodes.of_vertex[vertex]], axis=1).argmin())


def hold(
    mesh: Mesh,
    component: Int64,
    vertex: int,
    position: Sequence[float],
    similar: Float32 | None = None,
    planes: Sequence[SymmetryPlane] = (),
    region: Int64 | None = None,
    *,
    detach: bool = False,
) -> HeldPart:
    """Return the part at a vertex. `component` (N,) is the result of `Parts.components`.

    `similar` (V,) are the weights of the handle by features alone (Eq. 4 and 5), and `planes` the planes of symmetry of
    the shape. Both are needed only if the part has several components. If the handle is a region, the bands of its
    component end outside the vertices `region` (R,). With `detach`, nothing hangs on the part, and no contact holds it.
    """
    nodes = nodes_of(mesh)
    several_pieces = nodes.component.any()
    if several_pieces:
        component = joined(nodes, component)
        component = component if detach else with_hanging(nodes, component)
    component = component[nodes.follows]
    counterparts = [Counterpart(vertex, vector("position", position), np.eye(3))]
    if component.max() > 0:
        assert similar is not None, "a part with several components needs features"
        found = find_counterparts(mesh, component, vertex, position, similar, planes)
        rank = np.full(component.max() + 2, -1)  # the last entry is for nodes outside the part
        rank[[number for number, _ in found]] = np.arange(len(found))
        component, counterparts = rank[component], [one for _, one in found]
    contacts: list[Contacts | None] = [None] * len(counterparts)
    own = np.array([vertex]) if region is None else region[component[nodes.of_vertex[region]] == 0]
    attached = several_pieces and not detach
    if attached:
        held = [np.unique(nodes.of_vertex[own]), *(nodes.of_vertex[[one.vertex]] for one in counterparts[1:])]
        contacts = contacts_of(nodes, component, [each.astype(np.int64) for each in held])
        contacts = with_room(nodes, contacts, own, INSIDE)
    return HeldPart(_components(nodes, component, own, counterparts, contacts, attached), nodes, component)


def _components(
    nodes: Nodes,
    component: Int64,
    held: Int64,
    counterparts: Sequence[Counterpart],
    contacts: Sequence[Contacts | None],
    attached: bool,
) -> tuple[Component, ...]:
    """Return the components of a part. The handle is at the vertices `held` (H,) of the first of them.

    If `attached`, small pieces that touch only surface near the part follow this surface.
    """
    count, surface = len(counterparts), nodes.surface
    row = np.repeat(np.arange(len(component)), np.diff(surface.indptr))
    one, other = component[row], component[surface.indices]
    half = surface.data / 2
    inside = component >= 0
    cut = (one >= 0) & (other < 0)
    borders = [_border(nodes, row, surface.indices, cut & (one == k)) for k in range(count)]
    radii = np.array([radius for _, _, radius in borders])
    depth = np.where(inside, _distances(surface, row[cut], half[cut], np.inf), -np.inf)
    outward = OUTSIDE * radii
    reach = outward + 3 * SMOOTHING * radii
    apart = np.full((count, len(component)), np.inf)  # distance of each node from each component
    for k in range(count):
        edge = (one == k) & (other != k)
        if edge.any():
            apart[k] = _distances(surface, surface.indices[edge], half[edge], reach[k])
        apart[k, component == k] = 0.0
    outward = np.minimum(outward, _within_share(nodes.area, inside, apart.min(axis=0)))
    deepest = np.array([depth[(component == k) & np.isfinite(depth)].max(initial=0.0) for k in range(count)])
    fields, inward = [], INSIDE * deepest
    free = unbordered(nodes, component) if attached else inside
    for k in range(count):
        field, deviation = np.where(inside, depth, -apart[k]), SMOOTHING * radii[k]
        field = _smoothed(surface, field, -reach[k], inward[k] + 3 * deviation, deviation)
        if attached and reach[k] > 0:
            some, extended = following(nodes, free, -field, reach[k], nodes.area[component == k].sum())
            field[some] = -extended(-field)
            apart[k, some] = extended(np.where(component == k, -depth, np.where(inside, np.inf, apart[k])))
        fields.append(field[nodes.follows])
    shares = _shares(apart, component, int(nodes.of_vertex[counterparts[0].vertex]), outward)[:, nodes.follows]
    # The handle lies inside the part, also after smoothing, and beyond the inner end of the band, so that it arrives.
    here = float(nodes.known_at(fields[0], held).min(initial=np.inf))
    shift = max(LEAST_DEPTH * radii[0] - here, 0.0)
    room = min((here + shift) / max(inward[0], 1e-300), 1.0)
    found = []
    for k, (counterpart, (border, number, radius)) in enumerate(zip(counterparts, borders, strict=True)):
        ends = float(outward[k]), float(room * inward[k])
        direction = np.zeros(3)
        if number:
            middle = nodes.center[component == k].mean(axis=0)
            inwards = unit((middle - border.mean(axis=0))[None])[0]
            if number == 1 or ((middle - border) @ inwards > 0).all():
                direction = inwards
        link = min(_thin(nodes, np.where(component == k, depth, -apart[k]), float(inward[k])), ends[1])
        at_vertices = _at_vertices(nodes, fields[k] + shift, shares[k], *ends, contacts[k])
        reached = link / max(inward[k], 1e-300)
        found.append(Component(counterpart, border, direction, radius, *ends, link, reached, **at_vertices))
    return tuple(found)


def _border(nodes: Nodes, row: Int64, beside: Int64, cut: Bool) -> tuple[Float64, int, float]:
    """Return the points (B, 3) of a component's border, the number of its borders, and their mean radius.

    `cut` (E,) says which of the edges from node `row` (E,) to node `beside` (E,) leave the component.
    """
    if not cut.any():
        return np.empty((0, 3)), 0, 0.0
    ends = np.stack([row[cut], beside[cut]], axis=1)
    points = nodes.center[ends].mean(axis=1)
    ring, index = np.unique(ends, return_inverse=True)
    count, label = connected_components(nodes.surface[ring][:, ring], directed=False)
    of_point = label[index.reshape(ends.shape)[:, 0]]
    sizes = np.bincount(of_point, minlength=count)
    center = np.stack([np.bincount(of_point, axis, count) for axis in points.T], axis=1) / sizes[:, None]
    squares = np.bincount(of_point, np.square(points - center[of_point]).sum(axis=1), count) / sizes
    large = sizes >= 0.1 * sizes.max()
    edge = float(np.median(np.linalg.norm(np.subtract(*nodes.center[ends.T]), axis=1)))
    return points, int(large.sum()), max(float(np.sqrt(squares[large]).mean()), edge / 2)


def _thin(nodes: Nodes, depth: Float64, most: float) -> float:
    """Return the depth, at most `most`, up to which a component is thin (`WIDER`). `depth` (N,) is negative outside.

    The area between two depths, divided by their difference, is the length of the section.
    """
    row, known = np.repeat(np.arange(len(depth)), np.diff(nodes.surface.indptr)), np.isfinite(depth)
    low, high, beside = depth.copy(), depth.copy(), depth[nodes.surface.indices]
    np.minimum.at(low, row, np.where(np.isfinite(beside), beside, np.inf))
    np.maximum.at(high, row, beside)
    low, high, area = low[known], high[known], nodes.area[known]
    levels = np.linspace(0, most, SECTIONS + 1)
    length = np.diff([area @ ((level - low) / np.maximum(high - low, 1e-300)).clip(0, 1) for level in levels])
    wide = np.flatnonzero(length > WIDER * np.minimum.accumulate(length))
    return float(levels[wide[0]]) if len(wide) else most


def _distances(surface: csr_array, sources: Int64, offset: Float64, limit: float) -> Float64:
    """Return the distance (N,) of each node from the nearest source, plus the source's `offset` (S,)."""
    count = surface.shape[0]
    start = np.full(count, np.inf)
    np.minimum.at(start, sources, offset)
    own = np.flatnonzero(np.isfinite(start))
    # One more node has an edge to each source, as long as the source's offset.
    joined_graph = csr_array(
        (
            np.concatenate([surface.data, start[own]]),
            np.concatenate([surface.indices, own]),
            np.append(surface.indptr, surface.nnz + len(own)),
        ),
        shape=(count + 1, count + 1),
    )
    return np.asarray(dijkstra(joined_graph, indices=count, limit=limit)[:count], np.float64)


def _within_share(area: Float64, inside: Bool, apart: Float64) -> float:
    """Return the distance from the part up to which at most `BEYOND` of the surface outside it lies."""
    out = np.flatnonzero(~inside)
    order = out[np.argsort(apart[out])]
    covered = np.cumsum(area[order])
    number = int(np.searchsorted(covered, BEYOND * area[out].sum()))
    return float(apart[order[number]]) if number < len(order) else np.inf


def _shares(apart: Float64, component: Int64, own: int, outward: Float64) -> Float64:
    """Return the share (K, N) of each component in the motion of each node; the sum is 1.

    Where components touch, the shares change smoothly from one to the next. The share is 1 at the node of the handle.
    """
    if len(apart) == 1:
        return np.ones_like(apart)
    others = np.delete(apart[:, own], component[own])
    half = float(min(outward[outward > 0].min(initial=LARGEST), others.min(initial=LARGEST)))
    first, second = np.full((2, apart.shape[1]), np.inf)  # the distances from the two nearest components
    for row in apart:
        second = np.minimum(second, np.maximum(first, row))
        first = np.minimum(first, row)
    shares = np.zeros_like(apart)
    for row, share in zip(apart, shares, strict=True):
        near = np.isfinite(row)
        ahead = np.where(row[near] == first[near], second[near], first[near]) - row[near]
        part = np.clip(ahead / max(2 * half, 1e-300), -0.5, 0.5) + 0.5
        share[near] = part * part * (3 - 2 * part)
    total = shares.sum(axis=0)
    return np.divide(shares, total, out=shares, where=total > 0)


def _smoothed(surface: csr_array, field: Float64, low: float, high: float, deviation: float) -> Float64:
    """Return `field` (N,), smoothed where it lies between `low` and `high`, by an implicit step of the heat equation.

    `deviation` is the standard deviation of the kernel, in mesh units. A node's mass is the sum of the lengths of its
    edges, and the conductance of an edge is the inverse of its length: with equal edges, this is a random walk.
    """
    free = np.flatnonzero((field > low) & (field < high))
    if not len(free) or deviation <= 0:
        return field
    known = np.isfinite(field)
    among = surface[free]
    length = np.maximum(among.data, 1e-3 * deviation)  # with shorter edges, the matrix could be singular
    conductance = csr_array((2 * deviation**2 / length, among.indices, among.indptr), shape=among.shape)
    conductance = conductance @ diags_array(known.astype(np.float64))
    mass = np.asarray(among.sum(axis=1)).ravel()
    within = conductance[:, free]
    total = np.asarray(conductance.sum(axis=1)).ravel()
    values = np.where(known, field, 0.0)
    fixed = conductance @ values - within @ values[free]
    result = field.copy()
    matrix = (diags_array(mass + total) - within).tocsc()
    solve = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve
    result[free] = solve(mass * values[free] + fixed)
    return result


def _at_vertices(
    nodes: Nodes, field: Float64, share: Float64, outward: float, inward: float, contacts: Contacts | None
) -> dict[str, Any]:
    """Return the fields of a `Component` that have values at vertices.

    `field` and `share` (N,) are the depths and the shares of the nodes. The other arguments are fields of `Component`.
    """
    used = (share > 0) & (field > -outward)
    uncertain = ~((field >= inward) & (share >= 1))
    if contacts is not None:
        uncertain |= contacts.apart[nodes.follows] < contacts.free
    # A vertex belongs to the core if all nodes from which its depth is interpolated do.
    if not nodes.are_vertices:
        used, uncertain = nodes.reach @ used, nodes.reach @ uncertain
    core = np.flatnonzero((used & ~uncertain)[nodes.of_vertex])
    vertices = np.flatnonzero((used & uncertain)[nodes.of_vertex])
    depth = nodes.known_at(field, vertices)
    shares = nodes.interpolated(share.astype(np.float32), vertices)
    some = (depth > -outward) & (shares > 0)
    vertices, depth, shares = vertices[some], depth[some], shares[some]
    if contacts is not None:
        contacts, touched = contacts.at_vertices(nodes, vertices)
        vertices = np.concatenate([vertices, touched])
        depth = np.concatenate([depth, field[contacts.base]])
        shares = np.concatenate([shares, share[contacts.base]])
    found = {
        "core": Share(core.astype(np.int32), np.ones(len(core), np.float32)),
        "vertices": vertices.astype(np.int32),
    }
    return found | {"depth": depth.astype(np.float32), "share": shares.astype(np.float32), "contacts": contacts}
