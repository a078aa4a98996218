"""Find the counterparts of a handle: the components of the part at the handle, each with its own pivot and frame.

If all legs rotated about the handle's pivot, the distant legs would move along wide arcs. So each leg rotates about its
own pivot, which corresponds to the handle's pivot. If two legs are mirror images, their motions are mirror images too.
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

MOST_COUNTERPARTS = 64  # the largest number of counterparts of a handle, because each needs a column of weights
# A counterpart's share at a mesh node (`dfd.geometry.coarse`) is its fraction of the handle's weight at this node.
SHARE_POWER = 2  # shares are proportional to 1 / distance ** SHARE_POWER, before the cutoff
SHARE_CUTOFF = 0.03  # at each mesh node, this fraction of the largest share is subtracted, and negative shares become 0
BOX_MARGIN = 0.1  # the bounding box of a component is enlarged at each end by this fraction of the box's length
# The vertex at the mirror image of a handle corresponds to the handle if its weight is at most this much below the
# largest weight of the component.
IMAGE_TOLERANCE = 0.05


@dataclass(frozen=True, eq=False)
class Counterpart:
    """The place on a component that corresponds to a handle. The first counterpart of a handle is the handle itself."""

    vertex: int  # the vertex nearest to the handle or to its mirror image, or the vertex most similar to the handle
    # position: (3,) mesh units: that of the handle, of its mirror image if `image` is given, or else of `vertex`
    position: tuple[float, float, float]
    frame: Float64  # (3, 3) orthogonal matrix that maps directions at the handle to directions at the counterpart
    weight: float = 1.0  # the handle's weight at `vertex`, by features alone
    share: Share | None = None  # fraction of the handle's weight for this counterpart at each vertex; None means 1
    # image: (3, 4) isometry that maps the component at the handle onto this component; None if there is none
    image: Float64 | None = None

    def transform(self, affine: Float64, position: Sequence[float]) -> Float64:
        """Return the transform (3, 4) of this counterpart for the transform `affine` of a handle at `position` (3,)."""
        here, there = np.asarray(self.position), np.asarray(position, np.float64)
        # In these two cases, the equation below would only add rounding errors.
        if np.array_equal(affine, np.eye(3, 4)) or (np.array_equal(here, there) and (self.frame == np.eye(3)).all()):
            return affine
        linear = self.frame @ affine[:, :3] @ self.frame.T
        moved = affine[:, :3] @ there + affine[:, 3] - there  # displacement of the handle
        return np.column_stack([linear, here + self.frame @ moved - linear @ here])


class Column(NamedTuple):
    """The handle and the counterpart to which a column of the weights (V, C) belongs."""

    handle: int  # index of the handle in the edit
    counterpart: Counterpart  # the handle itself if all of its counterparts share one pivot and this column
    carriers: tuple[int, ...] = ()  # columns of other handles whose components contain this column's component

    def matrix(self, edit: Edit) -> Float64:
        """Return the transform (3, 4) of the column, mesh units: the handle's transform, mapped to the counterpart."""
        handle = edit.handles[self.handle]
        return self.counterpart.transform(handle.matrix, handle.place.position)


class Held(NamedTuple):
    """The part at a place, and its counterparts."""

    counterparts: tuple[Counterpart, ...]  # the counterpart at the place, then the others by decreasing similarity
    part: Float32 | None  # (V,) the weights of the part; None if there is no part at the place


def find_counterparts(
    mesh: Mesh,
    weights: NDArray[np.floating],
    vertex: int,
    position: Sequence[float],
    grip: Grip | None,
    planes: Sequence[SymmetryPlane] = (),
    *,
    everywhere: bool = False,
    known: Held | None = None,
) -> Held:
    """Find the counterparts of a handle at `position` (3,), in mesh units. `vertex` is the vertex nearest to it.

    `weights` (V,) are the handle's weights by features alone (Eq. 4 and 5). `grip` is the part at the handle, and each
    of its components has one counterpart. `planes` are the planes of symmetry of the shape. `everywhere` must be True
    if the handle's weights do not end at the part's border. Otherwise, the shares outside the part are 0. `known` is
    the result for another blend band of the part: then only shares and the part's weights are computed.
    """
    x, y, z = (float(value) for value in position)
    found = [Counterpart(vertex, (x, y, z), np.eye(3), float(weights[vertex]))]
    if grip is None:
        return Held((found[0],), None)
    nodes = nodes_of(mesh)
    component = _merged_components(nodes, grip.component, vertex)
    on_nodes = np.maximum.reduceat(weights[nodes.members], nodes.starts)
    own = int(component[nodes.of_vertex[vertex]])
    alike = np.full(component.max(initial=-1) + 2, -1.0)  # the last entry is for nodes outside the part
    np.maximum.at(alike, component, on_nodes)
    alike[[own, -1]] = -1.0
    others = np.argsort(-alike, kind="stable")[: min(MOST_COUNTERPARTS - 1, int((alike >= 0).sum()))]
    if not len(others):
        return Held((found[0],), grip.weights)
    chosen = [own, *others.tolist()]
    if known is not None:
        found = list(known.counterparts)
    else:
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
                peak, frame = _corresponding(mesh, component == number, weights, peak, found, planes)
                x, y, z = mesh.vertices[peak].tolist()
            found.append(Counterpart(peak, (x, y, z), frame, float(weights[peak]), image=image))
    rows = _shares_of_nodes(mesh, [np.flatnonzero(component == number) for number in chosen])
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


def _merged_components(nodes: Nodes, component: Int64, vertex: int) -> Int64:
    """Return `component` (N,), the index of the part's component at each mesh node, after two changes.

    A component joins a larger one if its center lies in the bounding box of the larger one and the mesh does not
    connect the two. For example, a hub joins its tire. If the node of `vertex` has no component, it joins the nearest.
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
    """Return whether each of `others` (M, 3) lies in the PCA-aligned bounding box of `points` (N, 3), (M,) bool."""
    center = points.mean(axis=0)
    axes = np.linalg.svd(points - center, full_matrices=False)[2] if len(points) > 2 else np.eye(3)
    own, along = (points - center) @ axes.T, (others - center) @ axes.T
    margin = BOX_MARGIN * np.ptp(own, axis=0)
    return ((along >= own.min(axis=0) - margin) & (along <= own.max(axis=0) + margin)).all(axis=1)


def _surfaces(mesh: Mesh, component: Int64, chosen: Sequence[int]) -> list[Component | None]:
    """Return samples of the surface of each component in `chosen`. `component` (V,) is the component of each vertex."""
    of_corner = component[mesh.faces]
    of_face = np.where((of_corner == of_corner[:, :1]).all(axis=1), of_corner[:, 0], -1)
    return [component_of(mesh.vertices, mesh.faces[of_face == number]) for number in chosen]


def _image(
    surface: Component | None,
    surfaces: Sequence[Component | None],
    found: Sequence[Counterpart],
    planes: Sequence[SymmetryPlane],
) -> Float64 | None:
    """Return the isometry (3, 4) from the handle's component to `surface`; None if the two are no mirror images.

    The planes of the whole shape are tried first, then a plane fitted to two components. `surface` can also be the
    mirror image of another mirror image in `found`. The first items of `surfaces` are the surfaces of `found`.
    """
    if surface is None:
        return None
    for tried in (planes, None):
        for earlier, its_surface in zip(found, surfaces, strict=False):
            to_earlier = np.eye(3, 4) if earlier is found[0] else earlier.image
            if to_earlier is None or its_surface is None:
                continue
            step = mirror_image(its_surface, surface, tried)
            if step is not None:
                return np.column_stack([step[:, :3] @ to_earlier[:, :3], step[:, :3] @ to_earlier[:, 3] + step[:, 3]])
    return None


def _corresponding(
    mesh: Mesh,
    inside: Bool,
    weights: NDArray[np.floating],
    peak: int,
    found: Sequence[Counterpart],
    planes: Sequence[SymmetryPlane],
) -> tuple[int, Float64]:
    """Return the vertex of a component that corresponds to the handle, and its frame (3, 3).

    `inside` (N,) is True for the component's mesh nodes. `peak` is the component's vertex with the highest weight. The
    result is the vertex at the mirror image of a counterpart in `found`, if this vertex has nearly the weight of
    `peak`. Otherwise, it is `peak`, with a frame that is reflected in each plane between `peak` and the handle.
    """
    nodes = nodes_of(mesh)
    for plane in planes:
        images = plane.reflect([other.position for other in found])
        for other, nearest in zip(found, nodes.nearest(images).tolist(), strict=True):
            if inside[nodes.of_vertex[nearest]] and weights[nearest] >= weights[peak] - IMAGE_TOLERANCE:
                return nearest, plane.reflection[:3, :3] @ other.frame
    frame = np.eye(3)
    for plane in planes:
        ours, theirs = plane.signed_distance([found[0].position, mesh.vertices[peak]])
        if ours * theirs < 0:
            frame = plane.reflection[:3, :3] @ frame
    return peak, frame


def _shares_of_nodes(mesh: Mesh, components: Sequence[Int64]) -> Float64:
    """Return the share (K, N) of each counterpart at each mesh node. It is 1 on the component of the counterpart."""
    nodes = nodes_of(mesh)
    shares = np.empty((len(components), len(nodes.center)))
    for row, members in zip(shares, components, strict=True):
        distance = dijkstra(nodes.graph, indices=members, min_only=True)
        # Nodes without a path to the component get the straight distance plus the diagonal, so they count as farther.
        if len(apart := np.flatnonzero(np.isinf(distance) & nodes.used)):
            straight = cKDTree(nodes.center[members]).query(nodes.center[apart])[0]
            distance[apart] = straight + mesh.diagonal
        row[:] = (distance / mesh.diagonal + 1e-4) ** -SHARE_POWER
    shares[0, ~nodes.used] = 1.0
    shares /= shares.max(axis=0)
    shares -= SHARE_CUTOFF
    np.maximum(shares, 0.0, out=shares)
    shares /= shares.sum(axis=0)
    return shares
