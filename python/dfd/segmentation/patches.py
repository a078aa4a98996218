"""Divide the surface into about two thousand patches, and describe the borders between them.

Everything here is a function of the geometry: not of the order of vertices and faces, or of scale, place and rotation.
Three rules ensure this. Distances are normalized and rounded, so rounding errors of the input do not matter. The places
of a mesh are sorted by distance from the middle of the surface, then by position, so ties are broken alike.
Farthest-point sampling chooses the patches, and the planes of symmetry map patches to patches. The unit of length is
the side of a square with the area of the surface.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Bool, Float64, Int64, distinct_pairs, group_sums, unit
from dfd.geometry.body import Body, body_of
from dfd.geometry.coarse import RUN, Nodes, nodes_of
from dfd.geometry.topology import scene_parts_and_materials, vertex_areas
from dfd.mesh.mesh import Mesh
from dfd.segmentation.seeds import (
    COUNT,
    GRID,
    MOST,
    NEAR,
    mirrors_of,
    nearest_seed,
    orbits,
    orbits_of_patches,
    rounded,
    symmetric,
)
from dfd.symmetry.plane import SymmetryPlane

# Numbers are the IoU at level 0 and the best within one level, on 7 meshes by `python -m bench.quality.constants
# segmentation FOLDER --every 12`. As it is, they are 0.701 and 0.820, with a noise of about 0.02.
# NORMAL_WEIGHT: weight of normals in distances between seeds, so that both sides of a thin sheet get seeds. With 0.3:
# 0.698, 0.804; with 1.2: 0.683, 0.826.
NORMAL_WEIGHT = 0.6
# SAMPLES: largest number of vertices per patch over which features are averaged. With 4: 0.730, 0.817; with 16: 0.701,
# 0.820.
SAMPLES = 8
BRIDGE = 0.3  # concavity of borders across small gaps between components of the mesh, that of a clear crease
TINY = 1e-9  # replaces lengths, areas and distances of 0, such as the length of a border across a small gap
ACROSS = 1e3  # added to distances between two things of the file, so that a patch belongs to one; more than any path


class Borders:
    """The borders between neighboring patches, or between neighboring places.

    Attributes
    ----------
    pairs
        (E, 2) indices of the patches (or places) on both sides of each border, the lower index first.
    length
        (E,) lengths of the borders, 0 across small gaps.
    concavity
        (E,) how much the normals of the two patches point towards each other, in [−2, 2]; above 0 in a concave crease.
    apart
        (E,) distances between the centers of the two patches.
    """

    def __init__(self, pairs: Int64, length: Float64, center: Float64, normal: Float64) -> None:
        self.count = len(center)
        self.pairs, self.length = pairs, length
        one, other = pairs.T
        across = center[other] - center[one]
        self.apart = np.maximum(np.linalg.norm(across, axis=1), TINY)
        self.concavity = ((normal[one] - normal[other]) * across).sum(axis=1) / self.apart
        self.concavity[length == 0] = BRIDGE

    def graph(self, values: Float64) -> csr_array:
        """Return the symmetric sparse matrix (N, N) with `values` (E,) as the entries of the pairs."""
        one, other = self.pairs.T
        ends = np.concatenate([one, other]), np.concatenate([other, one])
        return csr_array((np.concatenate([values, values]), ends), shape=(self.count, self.count))

    def depth(self, inside: Bool) -> Float64:
        """Return each patch's distance (N,) from the border of a part `inside` (N,); 0 if the part has no border."""
        ends = np.unique(self.pairs[np.not_equal(*inside[self.pairs.T])])
        if len(ends) == 0:
            return np.zeros(self.count)
        return np.asarray(dijkstra(self.graph(self.apart), indices=ends, min_only=True), np.float64)


class Patches:
    """The patches of a mesh: groups of places, which are distinct positions of mesh nodes (`dfd.geometry.coarse`).

    Raises ValueError if no face of the mesh has an area.

    Attributes
    ----------
    size
        The unit of lengths: the side of a square with the area of the surface, in mesh units.
    spacing
        The patch spacing: the side of a square with the mean area of a patch.
    place
        (N,) the place of each mesh node; −1 for nodes without faces. Places are sorted by position.
    node_of_place
        (M,) the first mesh node at each place.
    of_place, of_node, of_vertex
        (M,), (N,) and (V,) index of the patch of each place, mesh node and vertex.
    area
        (P,) areas of the patches, as shares of the surface.
    center
        (P, 3) centers of the patches.
    borders, place_borders
        The borders between patches, and between places.
    place_area
        (M,) areas of the places, as shares of the surface.
    orbit
        (P,) the orbit of each patch: the patches that reflections in the planes of symmetry map onto each other.
    things
        (K, P) the thing of the file to which each patch belongs, for each of K kinds (`_things_of_places`).
    """

    def __init__(self, mesh: Mesh, planes: Sequence[SymmetryPlane] = ()) -> None:
        self.nodes = nodes_of(mesh)
        body = body_of(mesh, self.nodes.seams)
        total, self._middle = _area_and_middle(mesh, body)
        self.size, self.spacing = float(np.sqrt(total)), COUNT**-0.5
        graph, center, normal = self._find_places(mesh, body)
        things = _things_of_places(mesh, self.nodes, self.place, self.node_of_place, ~body.left_out)
        self._find_patches(graph, center, normal, planes, things)

    def _find_places(self, mesh: Mesh, body: Body) -> tuple[csr_array, Float64, Float64]:
        """Set the attributes of places. Return their distances (M, M), centers (M, 3) and mean normals (M, 3)."""
        nodes, size = self.nodes, self.size
        center = nodes.center if body.vertices is mesh.vertices else nodes.centers(body.vertices)
        center = (center - self._middle) / size
        self._inside = np.zeros(len(center), bool)
        self._inside[nodes.of_vertex[body.faces]] = True
        self.place, self.node_of_place = _places(nodes, body, self._inside, center)
        center = center[self.node_of_place]
        self._vertex = _central_vertices(mesh, nodes, size)[self.node_of_place]
        of_vertex = self.place[nodes.of_vertex[body.stands_for]]
        area, normal, pairs, length = _surface(mesh, body, of_vertex, len(center), size)
        graph = self._graph_of_places(center)
        links = _links(graph, pairs)
        pairs, length = np.concatenate([pairs, links]), np.concatenate([length, np.zeros(len(links))])
        self.place_area, self.place_borders = area, Borders(pairs, length, center, _smoothed(normal, pairs))
        return graph, center, normal

    def _find_patches(
        self, graph: csr_array, center: Float64, normal: Float64, planes: Sequence[SymmetryPlane], things: Int64
    ) -> None:
        """Set the attributes of patches, and the patch of each place, mesh node and vertex.

        `things` (M, K) are the things of the file to which each place belongs.
        """
        tree, area, borders = cKDTree(center), self.place_area, self.place_borders
        mirrors = mirrors_of(planes, self._middle, self.size, tree, area)
        places = np.column_stack([center, NORMAL_WEIGHT * NEAR * self.spacing * unit(normal)])
        seeds, orbit = orbits(places, tree, self.spacing, mirrors)
        nearest = nearest_seed(_divided(graph, things), seeds, center)
        of_seed = symmetric(nearest, tree, center[seeds], mirrors)
        self.of_place, seed_of_patch, owned = _pieces(of_seed, things, area)
        self.things, count, weight = owned.T, len(owned), np.maximum(area, TINY)
        self.area = np.asarray(np.bincount(self.of_place, weight, count), np.float64)
        own = self.area[:, None]
        self.center = group_sums(self.of_place, center * weight[:, None], count) / own
        self.orbit = orbits_of_patches(orbit, seed_of_patch, self.center, self.spacing, mirrors)
        # Around a thin limb, the mean normal is near 0, and its direction is noise. So it is not scaled to unit length.
        mean_normal = group_sums(self.of_place, normal, count) / own
        joined, length = _contracted(self.of_place, borders.pairs, borders.length, count)
        self.borders = Borders(joined, length, self.center, mean_normal)
        self.of_node = self.of_place[self.place]
        stray = self.place < 0
        self.of_node[stray] = self.of_place[tree.query((self.nodes.center[stray] - self._middle) / self.size)[1]]
        self.of_vertex = self.of_node[self.nodes.of_vertex]

    def means(self, features: Callable[[Int64], NDArray[np.floating]]) -> Float64:
        """Return the means (P, D) of the features that `features` returns for at most `SAMPLES` vertices per patch."""
        order = np.argsort(self.of_place, kind="stable")
        size = np.bincount(self.of_place)
        taken = np.minimum(size, SAMPLES)
        patch = np.repeat(np.arange(len(size)), taken)
        rank = np.arange(len(patch)) - np.repeat(np.cumsum(taken) - taken, taken)
        places = order[np.repeat(np.cumsum(size) - size, taken) + rank * size[patch] // taken[patch]]
        mean = csr_array((1 / taken[patch], (patch, np.arange(len(patch)))), shape=(len(size), len(patch)))
        return np.asarray(mean @ features(self._vertex[places]).astype(np.float64))

    def _graph_of_places(self, center: Float64) -> csr_array:
        """Return the distances (M, M) between neighboring places."""
        graph, count = self.nodes.graph, len(center)
        place = np.where(self._inside, self.place, -1)
        ends = np.stack([np.repeat(place, np.diff(graph.indptr)), place[graph.indices]], axis=1)
        ends = distinct_pairs(ends[(ends >= 0).all(axis=1) & (ends[:, 0] != ends[:, 1])], count)[0]
        length = rounded(np.linalg.norm(center[ends[:, 0]] - center[ends[:, 1]], axis=1)) + 1 / GRID
        both = np.concatenate([ends, ends[:, ::-1]]).T
        return csr_array((np.tile(length, 2), tuple(both)), shape=(count, count))


def _places(nodes: Nodes, body: Body, inside: Bool, center: Float64) -> tuple[Int64, Int64]:
    """Return the place (N,) of each mesh node, and the first node (M,) of each place, in the order of places.

    `inside` (N,) are the nodes of the body, and `center` (N, 3) the centers of all nodes.
    """
    first = nodes.of_vertex[body.stands_for[nodes.members[nodes.starts]]]
    if not nodes.are_vertices:  # both sides of a cut are nodes of their own
        first[inside] = np.flatnonzero(inside)
    own = np.flatnonzero(nodes.used & (first == np.arange(len(first))))
    apart = np.linalg.norm(center[own], axis=1)
    own = own[np.lexsort(rounded(np.column_stack([center[own], apart])).T)]
    place = np.full(len(first), -1)
    place[own] = np.arange(len(own))
    return place[first], own


def _central_vertices(mesh: Mesh, nodes: Nodes, size: float) -> Int64:
    """Return the vertex (N,) nearest to the center of each mesh node."""
    members = nodes.members
    apart = rounded(np.linalg.norm(mesh.vertices[members] - nodes.center[nodes.of_vertex[members]], axis=1) / size)
    least = np.repeat(np.minimum.reduceat(apart, nodes.starts), nodes.ends - nodes.starts)
    nearest = np.flatnonzero(apart == least)
    return np.asarray(members[nearest[np.searchsorted(nearest, nodes.starts)]], np.int64)


def _things_of_places(mesh: Mesh, nodes: Nodes, place: Int64, node_of_place: Int64, faces: Bool) -> Int64:
    """Return the things of the file to which each place belongs, (M, K), for those kinds that have several things.

    The kinds are connected components, named objects (`Mesh.parts`) and materials. A place of several things belongs to
    the last one in the file. `faces` (F,) are the faces that count.
    """
    kinds = [nodes.component[node_of_place].astype(np.int64)]
    for labels in scene_parts_and_materials(mesh):
        if labels.any():
            kinds.append(np.zeros(len(node_of_place), np.int64))
            np.maximum.at(kinds[-1], place[nodes.of_vertex[mesh.faces[faces]]], labels[faces, None])
    several = [kind for kind in kinds if kind.min() < kind.max()]
    return np.array(several, np.int64).reshape(-1, len(node_of_place)).T


def _divided(graph: csr_array, things: Int64) -> csr_array:
    """Return the distances `graph` (M, M) with `ACROSS` added between places of different `things` (M, K)."""
    row = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr))
    apart = (things[row] != things[graph.indices]).any(axis=1)
    return csr_array((graph.data + ACROSS * apart, graph.indices, graph.indptr), shape=graph.shape)


def _pieces(of_seed: Int64, things: Int64, area: Float64) -> tuple[Int64, Int64, Int64]:
    """Divide the places of each seed by `things` (M, K), so that a thing without a seed has a patch of its own.

    Return the patch (M,) of each place, the seed (P,) of each patch, or −1 if it is not the largest patch of its seed,
    and the things (P, K) of each patch. If there are more than `MOST` patches, the smallest join their seed's largest.
    """
    rows, of_place = np.unique(np.column_stack([of_seed, things]), axis=0, return_inverse=True)
    size = np.bincount(of_place, area)
    order = np.lexsort([-size, rows[:, 0]])
    largest = order[np.unique(rows[order, 0], return_index=True)[1]]
    others = np.setdiff1d(order, largest)
    others = others[np.argsort(-size[others], kind="stable")][: max(MOST - len(largest), 0)]
    kept = np.concatenate([largest, others])
    number = np.searchsorted(rows[largest, 0], rows[:, 0])
    number[others] = np.arange(len(largest), len(kept))
    seed = np.concatenate([rows[largest, 0], np.full(len(others), -1)])
    return number[of_place.ravel()], seed, rows[kept, 1:]


def _area_and_middle(mesh: Mesh, body: Body) -> tuple[float, Float64]:
    """Return the area of a body, in squared mesh units, and the centroid (3,) of its surface.

    Raises ValueError if no face has an area.
    """
    near = mesh.bounds.mean(axis=0)
    areas = vertex_areas(body.vertices, body.faces)
    total = float(areas.sum())
    if not total > 0:
        raise ValueError("parts: `mesh` must have a face with an area, got none")
    return total, near + areas @ (body.vertices - near) / total


def _surface(
    mesh: Mesh, body: Body, of_vertex: Int64, count: int, size: float
) -> tuple[Float64, Float64, Int64, Float64]:
    """Return areas (M,) and area-weighted normals (M, 3) of places, and `pairs` and `length` of `Borders`."""
    faces = body.faces
    points = (body.vertices - mesh.bounds.mean(axis=0)) / size  # near 0, where differences have small rounding errors
    areas, normals = np.zeros(count), np.zeros((count, 3))
    pairs, lengths = [np.zeros((0, 2), np.int64)], [np.zeros(0)]
    for start in range(0, len(faces), RUN):  # RUN faces fit the processor's cache
        some = faces[start : start + RUN]
        place = of_vertex[some]
        corners = points[some]
        along, aside = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        normal = np.stack([along[i - 2] * aside[i - 1] - along[i - 1] * aside[i - 2] for i in range(3)]) / 2
        area = np.sqrt(np.square(normal).sum(axis=0))
        for corner in place.T:
            areas += np.bincount(corner, area / 3, minlength=count)
            for axis in range(3):
                normals[:, axis] += np.bincount(corner, normal[axis], minlength=count)
        for one, other in ((0, 1), (1, 2), (2, 0)):
            between = np.flatnonzero(place[:, one] != place[:, other])
            side = np.linalg.norm(corners[between, one] - corners[between, other], axis=1)
            pairs.append(np.stack([place[between, one], place[between, other]], axis=1))
            # In a face, the border goes from the center straight to a side, so its length is a third of the height.
            lengths.append(2 / 3 * area[between] / np.maximum(side, 1e-12))
    joined, length = _contracted(np.arange(count), np.concatenate(pairs), np.concatenate(lengths), count)
    # Sums depend on the order of the faces by rounding errors, so they are rounded.
    return rounded(areas * GRID) / GRID, rounded(normals * GRID) / GRID, joined, rounded(length)


def _smoothed(normal: Float64, pairs: Int64) -> Float64:
    """Return the unit normals (M, 3) of places, averaged over about the area of a patch."""
    count = len(normal)
    ends = np.concatenate([pairs, pairs[:, ::-1], np.repeat(np.arange(count), 2).reshape(-1, 2)])
    near = csr_array((np.ones(len(ends)), tuple(ends.T)), shape=(count, count))
    for _ in range(min(round(np.sqrt(count / COUNT)), 6)):
        normal = near @ normal
    return unit(normal)


def _contracted(group: Int64, pairs: Int64, length: Float64, count: int) -> tuple[Int64, Float64]:
    """Return the distinct pairs (E, 2) of neighboring groups, and the total length (E,) of their borders.

    `group` (M,) is the group of each place, `pairs` (K, 2) and `length` (K,) are the borders between places, and
    `count` is the number of groups.
    """
    ends = group[pairs]
    apart = ends[:, 0] != ends[:, 1]
    joined, which = distinct_pairs(ends[apart], count)
    return joined, np.bincount(which, length[apart], len(joined)).astype(np.float64)


def _links(graph: csr_array, pairs: Int64) -> Int64:
    """Return the edges (L, 2) of `graph` that `pairs` lacks: between places across a small gap."""
    count = graph.shape[0]
    row = np.repeat(np.arange(count, dtype=np.int64), np.diff(graph.indptr))
    key = np.setdiff1d((row * count + graph.indices)[row < graph.indices], pairs @ [count, 1])
    return np.stack(np.divmod(key, count), axis=1)
