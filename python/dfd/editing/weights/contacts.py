"""Join other pieces of the mesh to a part, and find its contacts: opened only if the mesh has several pieces.

A piece is a connected component of the mesh, such as a leg of a chair that was modeled alone. A piece without a border
on its own surface is attached only by its contacts, where it touches surface that does not move with it. So its weights
fall to 0 at them, as at the border of a limb. What touches only the part, such as fingers on a hand, moves with it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu

from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.geometry.coarse import Nodes

BOX_MARGIN = 0.1  # the bounding box of a component is enlarged at each end by this fraction of the box's length
# Measured with 72 pulls and turns at random places of six models of 9 to 97 pieces (a chair, a truck, a tank, a crab, a
# person, a robot), as the share of vertices that move, and the median of the largest stretch of an edge.
#
# A region outside the part hangs on the part if its area is below STAYS times that of the largest region outside, or
# below HANGS times that of the part. At level 0, without STAYS 0.27 of the vertices move, with 0.3 to 0.8 always 0.31.
# At level 1 of four of them, the stretch is 3.1 without HANGS, 1.6 with 0.05 and 1.4 with 0.2; 0.51, 0.59, 0.62 move.
# In 156 gestures on 26 models, edges change by 6.5 % with 0.05, and by 5.9 % with 0.1, with as many gaps.
STAYS, HANGS = 0.5, 0.1
# A touched piece stretches in place of the component if its area is below SMALLER times that of the component. So the
# legs of a table stretch, both if one of them is pulled and if the top is pulled. The stretch is 2.4 with 0, 3.6 with
# 0.5 or 0.9, and 3.5 with 2; 0.28, 0.31 and 0.35 move. Pieces that are smaller than a moved piece, and touch it or one
# another, follow it: of 156 gestures on 26 models, 0.18 open a gap of 1 % of the diagonal, and 0.39 if they stay.
SMALLER = 0.9


@dataclass(frozen=True, eq=False)
class Contact:
    """The place where a component touches one other piece: the mean and the spread of its points, in mesh units."""

    center: Float64  # (3,) mean of the points
    spread: Float64  # (3, 3) symmetric square root of the covariance of the points

    def motion(self, affine: Float64, default: Float64) -> tuple[float, float]:
        """Return how far `affine` (3, 4) moves the contact while `default` (3, 4) moves its surroundings, mesh units.

        The first distance is that between both images of the contact as a whole: the Wasserstein distance between two
        normal distributions. It is 0 if a wheel turns on its axle. The second is the RMS displacement of the points.
        """
        relative, one, other = affine - default, affine[:, :3] @ self.spread, default[:, :3] @ self.spread
        moved = np.square(relative[:, :3] @ self.center + relative[:, 3]).sum()
        common = np.linalg.svd(one.T @ other, compute_uv=False).sum()
        apart = max(np.square(one).sum() + np.square(other).sum() - 2 * common, 0.0)
        return float(np.sqrt(moved + apart)), float(np.sqrt(moved + np.square(one - other).sum()))


@dataclass(frozen=True, eq=False)
class Contacts:
    """The contacts of one component with surface outside the part. Distances are in mesh units, along the surface.

    They are distances of mesh nodes, and in `Component.contacts`, those of the component's vertices.
    """

    kept: tuple[Contact, ...]  # contacts at which the component stretches, so that they stay in place
    apart: NDArray[np.floating]  # (N,) a: distance of the component's nodes from the kept contacts; 0 also behind them
    drawing: tuple[Contact, ...]  # contacts at which the touched piece stretches, so that it follows the component
    # drawn: (N,) distance of the nodes of touched pieces from the drawing contacts; infinite elsewhere. For vertices,
    # (D,): the last D vertices of the component lie on touched pieces
    drawn: NDArray[np.floating]
    # base: (N,) the node of the component that a node of touched pieces follows; −1 elsewhere
    base: Int64
    reach: float  # half of the largest distance on a touched piece, the smallest of all touched pieces
    free: float = 0.0  # A: largest distance of the inner end of the band at the kept contacts from them

    def at_vertices(self, nodes: Nodes, vertices: Int64) -> tuple["Contacts", Int64]:
        """Return the contacts with distances of `vertices` (M,), and the vertices (D,) of touched pieces that follow.

        The distances are those of both, (M + D,), one after the other. For the latter, they are those of `base` (D,).
        """
        touched = np.flatnonzero((self.drawn < self.reach)[nodes.follows][nodes.of_vertex])
        base = self.base[nodes.follows][nodes.of_vertex[touched]]
        apart = nodes.known_at(self.apart[nodes.follows], vertices)
        drawn = nodes.known_at(self.drawn[nodes.follows], touched)
        apart = np.concatenate([apart, self.apart[base]])
        return replace(self, apart=apart.astype(np.float32), drawn=drawn.astype(np.float32), base=base), touched


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


def with_hanging(nodes: Nodes, component: Int64) -> Int64:
    """Return `component` (N,), −1 outside the part, in which regions that hang on the part join it.

    A region outside hangs on the part if it is small, touches the part, and no edge of a face connects it to the part.
    Its nodes join the nearest component.
    """
    inside, outside = np.flatnonzero(component >= 0), np.flatnonzero((component < 0) & nodes.used)
    if np.isin(nodes.component[outside], nodes.component[inside]).all():
        return component
    region = np.full(len(component), -1)
    region[outside] = connected_components(nodes.graph[outside][:, outside], directed=False)[1]
    area, own = np.bincount(region[outside], nodes.area[outside]), nodes.area[inside].sum()
    small = (area < STAYS * area.max()) | (area < HANGS * own)
    touching, connected = (
        _regions_beside(graph, component, region, len(area)) for graph in (nodes.graph, nodes.surface)
    )
    joins = np.flatnonzero((region >= 0) & (small & touching & ~connected)[region])
    if not len(joins):
        return component
    some = np.concatenate([inside, joins])
    nearest = dijkstra(
        nodes.graph[some][:, some], indices=np.arange(len(inside)), min_only=True, return_predecessors=True
    )[2][len(inside) :]
    result = component.copy()
    result[joins] = component[some[nearest]]
    return result


def _regions_beside(graph: csr_array, component: Int64, region: Int64, count: int) -> Bool:
    """Return whether `graph` connects each of `count` regions to the part, (count,) bool."""
    row = np.repeat(np.arange(len(component)), np.diff(graph.indptr))
    found = np.zeros(count, bool)
    beside = region[graph.indices[component[row] >= 0]]
    found[beside[beside >= 0]] = True
    return found


def contacts_of(nodes: Nodes, component: Int64, held: Sequence[Int64]) -> list[Contacts | None]:
    """Return the contacts of each component of a part with surface outside the part; None if it has none.

    `component` (N,) is the component of each node, −1 outside. `held` are the nodes of the handle or the counterpart on
    each component. Contacts of a piece with a border on its own surface do not count.
    """
    graph, piece = nodes.graph, nodes.component
    row = np.repeat(np.arange(len(component)), np.diff(graph.indptr))
    outside = (component < 0) & nodes.used
    touching = (component[row] >= 0) & outside[graph.indices] & (piece[row] != piece[graph.indices])
    one, other = row[touching], graph.indices[touching].astype(np.int64)
    free = unbordered(nodes, component)[one]
    one, other = one[free], other[free]
    found = [
        _contacts(nodes, component, k, one[component[one] == k], other[component[one] == k], at)
        for k, at in enumerate(held)
    ]
    drawn = np.array([np.full(len(component), np.inf) if each is None else each.drawn for each in found])
    for k, each in enumerate(found):
        if each is not None:
            each.drawn[drawn.argmin(axis=0) != k] = np.inf  # a piece between two components follows the nearer one
    return found


def unbordered(nodes: Nodes, component: Int64) -> Bool:
    """Return the nodes (N,) of components on pieces without a border of the component."""
    piece, surface = nodes.component, nodes.surface
    row = np.repeat(np.arange(len(component)), np.diff(surface.indptr))
    row = row[(component[row] >= 0) & (component[surface.indices] < 0)]
    bordered = np.zeros((component.max() + 1, piece.max() + 1), bool)
    bordered[component[row], piece[row]] = True
    return (component >= 0) & ~bordered[component, piece]


def with_room(nodes: Nodes, contacts: Sequence[Contacts | None], held: Int64, most: float) -> list[Contacts | None]:
    """Return the `contacts` of all components with their limits `free`: `most` times the largest distance.

    If the handle, the vertices `held` (N,) on the first component, lies nearer to a contact, all limits shrink alike,
    so that the handle has weight 1.
    """
    apart = [np.zeros(0) if each is None else each.apart for each in contacts]
    deepest = [float(each[np.isfinite(each)].max(initial=0.0)) for each in apart]
    room = 1.0
    if contacts[0] is not None and deepest[0] > 0:
        here = float(nodes.known_at(apart[0][nodes.follows], held).min(initial=np.inf))
        room = min(here / (most * deepest[0]), 1.0)
    return [each and replace(each, free=room * most * deep) for each, deep in zip(contacts, deepest, strict=True)]


def _contacts(
    nodes: Nodes, component: Int64, number: int, touching: Int64, beside: Int64, held: Int64
) -> Contacts | None:
    """Return the contacts of component `number`. Its nodes `touching` (C,) touch the nodes `beside` (C,)."""
    if not len(touching):
        return None
    inside, piece = component == number, nodes.component
    own_area = nodes.area[inside].sum()
    kept, drawing, held_back, sources = list[Contact](), list[Contact](), list[Int64](), list[Int64]()
    partner = np.full(len(inside), -1)
    partner[beside] = touching
    for which in np.unique(piece[beside]):
        at = piece[beside] == which
        points = np.unique(touching[at])
        label = connected_components(nodes.surface[points][:, points], directed=False)[1]
        area = nodes.area[piece == which].sum()
        small = area < SMALLER * own_area and bool((component[piece == which] < 0).all())
        for group in (points[label == each] for each in range(label.max() + 1)):
            opposite = np.unique(beside[at][np.isin(touching[at], group)])
            # The nodes of the smaller piece fit the contact better, because faces of a large one can be larger than it.
            contact = _contact(nodes.center[group if area > own_area else opposite])
            if small or np.isin(held, group).any():
                drawing.append(contact)
                sources.append(opposite)
            else:
                kept.append(contact)
                held_back.append(group)
    apart = np.full(len(inside), np.inf)
    if kept:
        contacts = np.unique(np.concatenate(held_back))
        apart[inside] = _distances(nodes.graph, np.flatnonzero(inside), contacts)
        free = inside.copy()
        free[contacts] = False
        apart[free & ~_moving(nodes, free, held)] = 0.0
    drawn, base, reach = np.full(len(inside), np.inf), np.full(len(inside), -1), np.inf
    for source in sources:
        some = np.flatnonzero((piece == piece[source[0]]) & (component < 0))
        away, _, nearest = dijkstra(
            nodes.surface[some][:, some], indices=np.searchsorted(some, source), min_only=True, return_predecessors=True
        )
        nearer = away < drawn[some]
        drawn[some[nearer]], base[some[nearer]] = away[nearer], partner[some[nearest[nearer]]]
        reach = min(reach, float(away[np.isfinite(away)].max()) / 2)
    if sources:
        some, extended = following(nodes, component >= 0, drawn, reach, own_area)
        drawn[some] = extended(drawn)
        some = np.flatnonzero(np.isfinite(drawn))
        known = np.flatnonzero(base[some] >= 0)
        nearest = dijkstra(nodes.graph[some][:, some], indices=known, min_only=True, return_predecessors=True)[2]
        base[some], drawn[some[nearest < 0]] = base[some[nearest.clip(0)]], np.inf
    return Contacts(tuple(kept), apart, tuple(drawing), drawn, base, reach)


def following(
    nodes: Nodes, apart: Bool, away: Float64, reach: float, area: float
) -> tuple[Int64, Callable[[Float64], Float64]]:
    """Return the nodes (M,) of pieces that follow a part, and a function that extends distances to them.

    Examples are a rung between two legs that stretch, and a mirror on the door of a car. `away` (N,) are distances from
    the part, infinite on other pieces, and `area` is that of the component. A small piece follows if it touches surface
    nearer than `reach`, and no nodes `apart` (N,). So do small pieces that touch it, if all of them together are small.
    The function takes distances (N,). Where pieces touch other surface, they have its distance, at most `reach`.
    Between contacts, distances are harmonic. So pieces move as what they touch.
    """
    graph, piece = nodes.graph, nodes.component
    row, beside = np.repeat(np.arange(len(piece)), np.diff(graph.indptr)), graph.indices
    across = (piece[row] != piece[beside]) & nodes.used[row] & nodes.used[beside]
    row, beside = row[across], beside[across]
    areas = np.bincount(piece, nodes.area)
    most = SMALLER * max(area, areas[piece[np.isfinite(away)]].max(initial=0.0))
    small = areas < most
    small[piece[apart | np.isfinite(away)]] = False
    small[piece[row[apart[beside]]]] = False
    pulled = np.zeros(len(small), bool)
    pulled[piece[row[away[beside] < reach]]] = True
    pulled &= small
    both = small[piece[row]] & small[piece[beside]]
    group = connected_components(csr_array((both, (piece[row], piece[beside])), shape=(len(small),) * 2))[1]
    chained = (np.bincount(group, areas * small) < most) & (np.bincount(group, pulled) > 0)
    some = np.flatnonzero((pulled | (small & chained[group]))[piece])
    if not len(some):
        return some, lambda distances: distances[some]
    conductance = nodes.surface[some][:, some]
    conductance.data = 1 / conductance.data
    spring = 1e3 * float(np.asarray(conductance.sum(axis=1)).max(initial=1.0))
    at = np.isin(row, some)
    place, other = np.searchsorted(some, row[at]), beside[at]
    inner = np.isin(other, some)
    links = place[inner], np.searchsorted(some, other[inner])
    conductance += csr_array((np.full(len(links[0]), spring), links), shape=conductance.shape)
    place, other = place[~inner], other[~inner]
    held = spring * np.bincount(place, minlength=len(some))
    solve = splu((diags_array(np.asarray(conductance.sum(axis=1)).ravel() + held) - conductance).tocsc()).solve

    def extended(distances: Float64) -> Float64:
        return np.asarray(solve(spring * np.bincount(place, np.minimum(distances[other], reach), len(some))))

    return some, extended


def _distances(graph: csr_array, some: Int64, sources: Int64) -> Float64:
    """Return the distance (M,) of each of the nodes `some` (M,), ascending, from the nearest of `sources` among them.

    Paths contain only nodes in `some`.
    """
    found = dijkstra(graph[some][:, some], indices=np.searchsorted(some, sources), min_only=True)
    return np.asarray(found, np.float64)


def _moving(nodes: Nodes, free: Bool, held: Int64) -> Bool:
    """Return the nodes (N,), among those `free` of contacts, that move: of each piece, those on the handle's side.

    On a piece without a handle, it is the side with the largest area.
    """
    some = np.flatnonzero(free)
    side = np.full(len(free), -1)
    side[some] = connected_components(nodes.surface[some][:, some], directed=False)[1]
    area = np.bincount(side[some], nodes.area[some])
    piece = np.zeros(len(area), np.int64)
    piece[side[some]] = nodes.component[some]
    area[side[held[free[held]]]] = np.inf
    largest = np.zeros(nodes.component.max() + 1)
    np.maximum.at(largest, piece, area)
    return free & (area >= largest[piece])[side]


def _contact(points: Float64) -> Contact:
    center = points.mean(axis=0)
    values, axes = np.linalg.eigh((points - center).T @ (points - center) / len(points))
    return Contact(center, (axes * np.sqrt(values.clip(0.0))) @ axes.T)
