"""Divide the surface into about two thousand patches, and describe the borders between them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

import dfd._core as _core
from dfd.common.linear_algebra import Bool, Float64, Int64, distinct_pairs, group_sums, unit
from dfd.geometry.coarse import RUN, Nodes, nodes_of
from dfd.geometry.topology import first_at_place
from dfd.mesh.mesh import Mesh

COUNT = 2_000  # approximate number of patches; the computing time grows with the square of this number
PACKING = 0.75  # smallest distance between seeds, in patch spacings; a seed is a random mesh node that gets a patch
NORMAL_WEIGHT = 0.6  # weight of normals in distances between seeds, so that both sides of a thin sheet get seeds
MOST = 2 * COUNT  # largest number of patches; only meshes of many components have more than COUNT
WIDER = 1.25  # while there are more than MOST seeds, the distance between seeds is multiplied by this factor
SAMPLES = 8  # largest number of vertices per patch over which features are averaged
BESIDE = 0.2  # two patches are beside each other up to this distance along the surface, in diagonals of the box
STARTS = 96  # largest number of patches from which distances are measured to find the middle of a shape
MIDDLE = 1.5  # a middle patch has at most this factor times the smallest mean squared distance from the STARTS patches
BRIDGE = 1.0  # concavity of borders across small gaps between components of the mesh, as if there were a clear crease


class Borders:
    """The borders between neighboring patches, or between neighboring mesh nodes.

    Attributes
    ----------
    pairs
        (E, 2) indices of the patches (or mesh nodes) on both sides of each border, the lower index first.
    length
        (E,) lengths of the borders, in diagonals of the bounding box; 0 across small gaps.
    concavity
        (E,) how much the normals of the two patches point towards each other, in [−2, 2]; above 0 in a concave crease.
    apart
        (E,) distances between the centers of the two patches, in diagonals of the bounding box.
    """

    def __init__(self, pairs: Int64, length: Float64, center: Float64, normal: Float64) -> None:
        self.count = len(center)
        self.pairs, self.length = pairs, length
        one, other = pairs.T
        across = center[other] - center[one]
        self.apart = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
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
    """The patches of a mesh: groups of mesh nodes, which are groups of nearby vertices (`dfd.geometry.coarse`).

    Attributes
    ----------
    size
        The diagonal of the mesh's bounding box, in mesh units.
    spacing
        The patch spacing: the side of a square with the mean area of a patch, in diagonals of the bounding box.
    of_node, of_vertex
        (N,) and (V,) index of the patch of each mesh node, and of each vertex.
    area
        (P,) areas of the patches, as shares of the surface.
    borders, node_borders
        The borders between patches, and between mesh nodes.
    node_area
        (N,) areas of the mesh nodes, in squared diagonals of the bounding box.
    first
        (N,) index of the first mesh node at the position of each node. At a texture seam, several nodes coincide.

    Raises ValueError if no face of the mesh has an area.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.nodes = nodes = nodes_of(mesh)
        self.size = size = max(mesh.diagonal, np.finfo(float).tiny)
        center = (nodes.center - mesh.bounds.mean(axis=0)) / size
        area, normal, pairs, length = _surface(mesh, nodes, size)
        if not area.sum() > 0:
            raise ValueError("parts: `mesh` must have a face with an area, got none")
        self.node_area = area
        self.first = nodes.of_vertex[first_at_place(mesh)][nodes.members[nodes.starts]]
        self.spacing = float(np.sqrt(area.sum() / COUNT))
        links = _links(nodes.graph, pairs)
        pairs, length = np.concatenate([pairs, links]), np.concatenate([length, np.zeros(len(links))])
        self.node_borders = Borders(pairs, length, center, _smoothed(normal, pairs))
        apart = PACKING * self.spacing
        places = np.column_stack([center, NORMAL_WEIGHT * apart * unit(normal)])
        used = np.flatnonzero(nodes.used)
        seeds = used[_seeds(places[used], apart)]
        self.of_node = _nearest_seed(nodes.graph, seeds, center)
        self.of_vertex = self.of_node[nodes.of_vertex]
        count = len(seeds)
        weight = np.maximum(area, 1e-9 * area.sum())
        self.area = np.bincount(self.of_node, weight, minlength=count) / weight.sum()
        mean_center = group_sums(self.of_node, center * weight[:, None], count) / (self.area * weight.sum())[:, None]
        # Around a thin limb, the mean normal is near 0, and its direction is noise. So it is not scaled to unit length.
        mean_normal = group_sums(self.of_node, normal, count) / (self.area * weight.sum())[:, None]
        self.borders = Borders(*_contracted(self.of_node, pairs, length, count), mean_center, mean_normal)

    def means(self, features: Callable[[Int64], NDArray[np.floating]]) -> Float64:
        """Return the means (P, D) of the features that `features` returns for at most `SAMPLES` vertices per patch."""
        used = np.flatnonzero(self.nodes.used[self.nodes.of_vertex])
        order = used[np.argsort(self.of_vertex[used], kind="stable")]
        size = np.bincount(self.of_vertex[used], minlength=len(self.area))
        taken = np.minimum(size, SAMPLES)
        patch = np.repeat(np.arange(len(size)), taken)
        place = np.arange(len(patch)) - np.repeat(np.cumsum(taken) - taken, taken)
        vertices = order[np.repeat(np.cumsum(size) - size, taken) + place * size[patch] // taken[patch]]
        mean = csr_array((1 / taken[patch], (patch, np.arange(len(patch)))), shape=(len(size), len(patch)))
        return np.asarray(mean @ features(vertices).astype(np.float64))


class Distal:
    """Find the distal side of a patch: the surface beyond it, seen from the middle of the largest component."""

    def __init__(self, patches: Patches) -> None:
        borders = patches.borders
        self._graph = graph = borders.graph(borders.apart)
        component = connected_components(graph, directed=False)[1]
        body = np.flatnonzero(component == np.bincount(component, patches.area).argmax())
        starts = body[:: len(body) // STARTS + 1]
        spread = np.square(dijkstra(graph, indices=starts)[:, body]).sum(axis=0)
        middle = body[spread <= MIDDLE * spread.min()]
        self._distance, before, _ = dijkstra(graph, indices=middle, min_only=True, return_predecessors=True)
        self._pairs = borders.pairs.astype(np.int32)
        # `_steps[k]` (P,) is the patch that lies 2ᵏ steps nearer to the middle on each patch's shortest path.
        step = np.where(before >= 0, before, np.arange(len(before)))
        self._steps = [step]
        while not np.array_equal(step, step[step]):
            step = step[step]
            self._steps.append(step)

    def beyond(self, patch: int) -> Bool:
        """Return the patches on the distal side of a patch, (P,) bool.

        Shortest paths from the middle of the shape to these patches pass through `patch` or a patch beside it. A patch
        is beside `patch` if its distance is at most `BESIDE`, and a path between both comes no nearer to the middle.
        """
        far = self._distance >= self._distance[patch]
        component = _core.components(len(far), np.zeros((0, 3), np.int32), self._pairs[far[self._pairs].all(axis=1)])
        reached = np.isfinite(dijkstra(self._graph, indices=patch, limit=BESIDE)) & (component == component[patch])
        for step in self._steps:
            reached = reached | reached[step]
        return np.asarray(reached)


def _surface(mesh: Mesh, nodes: Nodes, size: float) -> tuple[Float64, Float64, Int64, Float64]:
    """Return areas (N,) and area-weighted normals (N, 3) of mesh nodes, and `pairs` and `length` of `Borders`."""
    count = len(nodes.center)
    first = first_at_place(mesh)
    areas, normals = np.zeros(count), np.zeros((count, 3))
    pairs, lengths = [np.zeros((0, 2), np.int64)], [np.zeros(0)]
    for start in range(0, len(mesh.faces), RUN):  # RUN faces fit the processor's cache
        faces = first[mesh.faces[start : start + RUN]]
        node = nodes.of_vertex[faces]
        corners = mesh.vertices[faces] / size
        along, aside = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        normal = np.stack([along[i - 2] * aside[i - 1] - along[i - 1] * aside[i - 2] for i in range(3)]) / 2
        area = np.sqrt(np.square(normal).sum(axis=0))
        for corner in node.T:
            areas += np.bincount(corner, area / 3, minlength=count)
            for axis in range(3):
                normals[:, axis] += np.bincount(corner, normal[axis], minlength=count)
        for one, other in ((0, 1), (1, 2), (2, 0)):
            between = np.flatnonzero(node[:, one] != node[:, other])
            side = np.linalg.norm(corners[between, one] - corners[between, other], axis=1)
            pairs.append(np.stack([node[between, one], node[between, other]], axis=1))
            # In a face, the border goes from the center straight to a side, so its length is a third of the height.
            lengths.append(2 / 3 * area[between] / np.maximum(side, 1e-12))
    joined = _contracted(np.arange(count), np.concatenate(pairs), np.concatenate(lengths), count)
    return areas, normals, *joined


def _smoothed(normal: Float64, pairs: Int64) -> Float64:
    """Return the unit normals (N, 3) of mesh nodes, averaged over about the area of a patch."""
    count = len(normal)
    ends = np.concatenate([pairs, pairs[:, ::-1], np.repeat(np.arange(count), 2).reshape(-1, 2)])
    near = csr_array((np.ones(len(ends)), tuple(ends.T)), shape=(count, count))
    for _ in range(min(round(np.sqrt(count / COUNT)), 6)):
        normal = near @ normal
    return unit(normal)


def _contracted(group: Int64, pairs: Int64, length: Float64, count: int) -> tuple[Int64, Float64]:
    """Return the distinct pairs (E, 2) of neighboring groups, and the total length (E,) of their borders.

    `group` (N,) is the group of each mesh node, `pairs` (K, 2) and `length` (K,) are the borders between mesh nodes,
    and `count` is the number of groups.
    """
    ends = group[pairs]
    apart = ends[:, 0] != ends[:, 1]
    joined, which = distinct_pairs(ends[apart], count)
    return joined, np.bincount(which, length[apart], len(joined)).astype(np.float64)


def _links(graph: csr_array, pairs: Int64) -> Int64:
    """Return the edges (L, 2) of `graph` that `pairs` lacks: between nodes across a small gap, or at one position."""
    count = graph.shape[0]
    row = np.repeat(np.arange(count, dtype=np.int64), np.diff(graph.indptr))
    key = np.setdiff1d((row * count + graph.indices)[row < graph.indices], pairs @ [count, 1])
    return np.stack(np.divmod(key, count), axis=1)


def _seeds(points: Float64, near: float) -> Int64:
    """Return indices of random `points` (N, 6) at least `near` apart; `near` is increased until at most `MOST` fit."""
    tree = cKDTree(points)
    order = np.random.default_rng(0).permutation(len(points)).tolist()
    while True:  # until at most MOST points are chosen
        free = np.ones(len(points), bool)
        chosen: list[int] = []
        for point in order:
            if len(chosen) > MOST:
                break
            if free[point]:
                chosen.append(point)
                free[tree.query_ball_point(points[point], near)] = False
        if len(chosen) <= MOST:
            return np.array(chosen, np.int64)
        near *= WIDER


def _nearest_seed(graph: csr_array, seeds: Int64, center: Float64) -> Int64:
    """Return the index of the seed nearest to each node, (N,), along the surface; in space if there is no path."""
    _, _, source = dijkstra(graph, indices=seeds, min_only=True, return_predecessors=True)
    number = np.full(len(center) + 1, -1)
    number[seeds] = np.arange(len(seeds))
    found: Int64 = number[np.maximum(source, -1)]
    lost = found < 0
    if lost.any():
        found[lost] = cKDTree(center[seeds]).query(center[lost])[1]
    return found
