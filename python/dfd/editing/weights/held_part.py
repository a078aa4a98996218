"""Hold a part at rest: its components, the motion that maps the handle's component onto each, and signed depths.

The depth of a place is its distance from the border of the part along the surface: positive inside, negative outside.
Distances never cross a gap, such as a gap between lips, teeth or fingers. Nothing here depends on a handle's motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu

from dfd.common.linear_algebra import Bool, Float32, Float64, Int32, Int64, unit
from dfd.editing.weights.contacts import Attachment, Contact, attachments, with_hanging
from dfd.editing.weights.counterparts import Counterpart, find_counterparts
from dfd.geometry.coarse import Nodes, Share, nodes_of
from dfd.mesh.mesh import Mesh
from dfd.symmetry.plane import SymmetryPlane

# The radius of a border is the root mean squared distance of its points from their center, such as that of a limb at
# its base. Outside the part, a band extends at most OUTSIDE radii, and covers at most BEYOND of the surface there.
# Inside, it covers at most INSIDE of the component's depth, so that at least the outer half of a limb keeps its shape.
OUTSIDE, BEYOND, INSIDE = 1.5, 0.2, 0.5
# Depths are smoothed by a Gaussian with this standard deviation, in radii, because borders run in zigzags along nodes.
SMOOTHING = 0.4
LEAST_DEPTH = 1e-3  # depths are raised until that of the handle is at least this, in radii, also after smoothing
LARGEST = 1e300  # stands for infinite lengths in divisions
BOX_MARGIN = 0.1  # the bounding box of a component is enlarged at each end by this fraction of the box's length


@dataclass(frozen=True, eq=False)
class Component:
    """A connected component of a part, such as a leg, at rest. Lengths are in mesh units.

    Letters are those of Eq. 9 to 12 in docs/how_it_works/method.md.
    """

    counterpart: Counterpart  # the handle itself, or the place on this component that corresponds to it
    border: Float64  # (B, 3) points of the component's border; none if a whole piece of the mesh is the component
    direction: Float64  # (3,) unit vector from the border to the middle; 0 if there is no border, or more than one
    radius: float  # r: mean radius of the borders (`OUTSIDE`); 0 without a border
    outward: float  # O: largest distance of the band's outer end from the border
    inward: float  # N: largest distance of the band's inner end from the border
    room: (
        float  # ρ: `inward` is this fraction of what it would be for a handle at the tip: a handle itself has weight 1
    )
    core: Share  # the vertices beyond the inner end of every band, and their share of the motion
    vertices: Int32  # (M,) vertices that a band can contain
    depth: Float32  # (M,) d: their depths
    share: Float32  # (M,) s: their share of the motion: below 1 near another component that touches this one
    kept: tuple[Contact, ...] = ()  # contacts with surface outside the part that stay in place; see `Attachment`
    apart: Float32 | None = None  # (M,) a: distances of `vertices` from the kept contacts
    free: float = 0.0  # A: largest distance of the inner end of the band at the kept contacts from them
    drawing: tuple[Contact, ...] = ()  # contacts at which the touched surface follows
    drawn: Float32 | None = None  # (D,) distances from these contacts; the last D of `vertices` lie on touched surface
    drawn_reach: float = 0.0  # largest distance of the outer end of the band on touched surface

    def limited(self, vertex: int) -> "Component | None":
        """Return the component with bands that end before a vertex; None if the vertex lies outside or in no band."""
        if self.core.at(vertex) == 1:
            return self
        own = self.vertices[: len(self.vertices) - (0 if self.drawn is None else len(self.drawn))]
        number = int(np.searchsorted(own, vertex))
        if number >= len(own) or own[number] != vertex or self.share[number] < 1:
            return None
        depth = float(self.depth[number])
        apart = np.inf if self.apart is None else float(self.apart[number])
        if depth < min(self.inward, LEAST_DEPTH * self.radius) or not apart > 0:
            return None
        return replace(self, inward=min(self.inward, depth), free=min(self.free, apart))


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
    component = joined(nodes, component)
    component = (component if detach else with_hanging(nodes, component))[nodes.follows]
    found = find_counterparts(mesh, component, vertex, position, similar, planes)
    rank = np.full(component.max() + 2, -1)  # the last entry is for nodes outside the part
    rank[[number for number, _ in found]] = np.arange(len(found))
    component, counterparts = rank[component], [one for _, one in found]
    held = [nodes.of_vertex[[one.vertex]].astype(np.int64) for one in counterparts]
    if region is not None:
        at = nodes.of_vertex[region]
        held[0] = np.unique(at[component[at] == 0]).astype(np.int64)
    attached = [None] * len(held) if detach else attachments(nodes, component, held)
    components = _components(nodes, component, vertex, counterparts, region, attached)
    return HeldPart(components, nodes, component)


def joined(nodes: Nodes, component: Int64) -> Int64:
    """Return `component` (N,), in which components join larger ones inside whose bounding boxes they lie.

    An example is a hub inside a tire. The mesh does not connect the two.
    """
    result = component.copy()
    inside = np.flatnonzero(component >= 0)
    order = inside[np.argsort(component[inside], kind="stable")]
    members = np.split(order, np.flatnonzero(np.diff(component[order])) + 1)
    members.sort(key=lambda each: (-len(each), each[0]))
    centers = np.array([nodes.center[each].mean(axis=0) for each in members])
    of_mesh = np.array([nodes.component[each[0]] for each in members])
    alone = np.ones(len(members), bool)
    for rank, each in enumerate(members):
        if alone[rank]:
            alone[rank] = False
            joins = alone & (of_mesh != of_mesh[rank]) & _in_box(nodes.center[each], centers)
            numbers = component[[each[0], *(members[other][0] for other in np.flatnonzero(joins))]]
            result[np.isin(component, numbers)] = numbers.min()  # the component at the handle keeps its number 0
            alone &= ~joins
    return result


def _in_box(points: Float64, others: Float64) -> Bool:
    """Return whether each of `others` (M, 3) lies in the PCA-aligned bounding box of `points` (N, 3), (M,) bool."""
    center = points.mean(axis=0)
    axes = np.linalg.svd(points - center, full_matrices=False)[2] if len(points) > 2 else np.eye(3)
    own, along = (points - center) @ axes.T, (others - center) @ axes.T
    margin = BOX_MARGIN * np.ptp(own, axis=0)
    return ((along >= own.min(axis=0) - margin) & (along <= own.max(axis=0) + margin)).all(axis=1)


def _components(
    nodes: Nodes,
    component: Int64,
    vertex: int,
    counterparts: Sequence[Counterpart],
    region: Int64 | None,
    attached: Sequence[Attachment | None],
) -> tuple[Component, ...]:
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
    shares = _shares(apart, component, int(nodes.of_vertex[vertex]), outward)
    fields, inward = [], INSIDE * deepest
    for k in range(count):
        field, deviation = np.where(inside, depth, -apart[k]), SMOOTHING * radii[k]
        fields.append(_smoothed(surface, field, -reach[k], inward[k] + 3 * deviation, deviation)[nodes.follows])
    shares = shares[:, nodes.follows]
    # The handle lies inside the part, also after smoothing, and beyond the inner end of the band, so that it arrives.
    held = np.array([vertex]) if region is None else region[component[nodes.of_vertex[region]] == 0]
    here = float(_on_vertices(nodes, fields[0], held).min(initial=np.inf))
    shift = max(LEAST_DEPTH * radii[0] - here, 0.0)
    room = min((here + shift) / max(inward[0], 1e-300), 1.0)
    free, found = _free(nodes, attached, held), []
    for k, (counterpart, (border, number, radius)) in enumerate(zip(counterparts, borders, strict=True)):
        direction, ends = np.zeros(3), (float(outward[k]), float(room * inward[k]))
        if number == 1:
            direction = unit((nodes.center[component == k].mean(axis=0) - border.mean(axis=0))[None])[0]
        at_vertices = _at_vertices(nodes, fields[k] + shift, shares[k], *ends, attached[k], free[k])
        found.append(Component(counterpart, border, direction, radius, *ends, room, **at_vertices))
    return tuple(found)


def _free(nodes: Nodes, attached: Sequence[Attachment | None], held: Int64) -> list[float]:
    """Return for each component the largest distance of the inner end of the band at its contacts from them.

    It is at most `INSIDE` of the largest distance. If the handle, the vertices `held` (N,), lies nearer to a contact,
    all distances shrink alike, so that the handle has weight 1.
    """
    deepest = [
        0.0 if each is None else float(each.apart[np.isfinite(each.apart)].max(initial=0.0)) for each in attached
    ]
    room = 1.0
    if attached[0] is not None and deepest[0] > 0:
        here = float(_on_vertices(nodes, attached[0].apart[nodes.follows], held).min(initial=np.inf))
        room = min(here / (INSIDE * deepest[0]), 1.0)
    return [room * INSIDE * each for each in deepest]


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


def _on_vertices(nodes: Nodes, field: Float64, vertices: Int64) -> Float64:
    """Interpolate `field` (N,) to `vertices` (M,). Nodes with infinite values are left out."""
    known = np.isfinite(field)
    rows = np.stack([np.where(known, field, 0.0), known], axis=1).astype(np.float32)
    found = nodes.interpolated(rows, vertices).astype(np.float64)
    some = found[:, 1] > 1e-6
    result = field[nodes.of_vertex[vertices]]
    result[some] = np.where(np.isfinite(result[some]), found[some, 0] / found[some, 1], result[some])
    return result


def _at_vertices(
    nodes: Nodes,
    field: Float64,
    share: Float64,
    outward: float,
    inward: float,
    attached: Attachment | None,
    free: float,
) -> dict[str, Any]:
    """Return the fields of a `Component` that have values at vertices, and its contacts.

    `field` and `share` (N,) are the depths and the shares of the nodes. The other arguments are fields of `Component`.
    """
    used = (share > 0) & (field > -outward)
    uncertain = ~((field >= inward) & (share >= 1))
    if attached is not None:
        uncertain |= attached.apart[nodes.follows] < free
    # A vertex belongs to the core if all nodes from which its depth is interpolated do.
    if not nodes.are_vertices:
        used, uncertain = nodes.reach @ used, nodes.reach @ uncertain
    core = np.flatnonzero((used & ~uncertain)[nodes.of_vertex])
    vertices = np.flatnonzero((used & uncertain)[nodes.of_vertex])
    depth = _on_vertices(nodes, field, vertices)
    shares = nodes.interpolated(share.astype(np.float32), vertices)
    some = (depth > -outward) & (shares > 0)
    vertices, depth, shares = vertices[some], depth[some], shares[some]
    found: dict[str, Any] = {"core": Share(core.astype(np.int32), np.ones(len(core), np.float32))}
    if attached is not None and attached.kept:
        apart = _on_vertices(nodes, attached.apart[nodes.follows], vertices).astype(np.float32)
        found |= {"kept": attached.kept, "apart": apart, "free": free}
    if attached is not None and attached.drawing:
        touched = np.flatnonzero((attached.drawn < attached.reach)[nodes.follows][nodes.of_vertex])
        drawn = _on_vertices(nodes, attached.drawn[nodes.follows], touched).astype(np.float32)
        found |= {"drawing": attached.drawing, "drawn": drawn, "drawn_reach": attached.reach}
        far = np.full(len(touched), np.inf)
        if attached.kept:
            found["apart"] = np.concatenate([found["apart"], far.astype(np.float32)])
        vertices, depth = np.concatenate([vertices, touched]), np.concatenate([depth, far])
        shares = np.concatenate([shares, np.ones(len(touched), np.float32)])
    return found | {"vertices": vertices.astype(np.int32), "depth": depth.astype(np.float32), "share": shares}
