"""Build a graph of the vertices of a mesh from its edges, and from bridges between components that nearly touch."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import dfd._core as _core
from dfd.common.linear_algebra import Float64, Int32, Int64, distinct_pairs
from dfd.geometry.topology import dirty_vertices, face_sides, face_sizes, first_at_place, points_on_faces
from dfd.mesh.mesh import Mesh
from dfd.mesh.weld import weld

# Two lengths, as fractions of the bounding box's diagonal. Points count as equal up to the distance SAME_PLACE. Bridges
# join components first across the smaller of GAPS, then across the larger. Components that are joined across the
# smaller gap get no bridges across the larger one: legs that meet at the hips stay separate at the knees.
SAME_PLACE, GAPS = 1e-6, (0.005, 0.02)
SEAM = 1e-3  # largest opening of a seam, in diagonals of the bounding box; quantized files open seams this far
SEAM_NEIGHBORS = 5  # number of border vertices that are compared with each border vertex
_MOST_POINTS = 400_000  # largest number of samples on edges, and of samples on faces
_LABELS_IN_CELL = 4  # largest number of components of a grid cell that are paired with those of other cells


def surface_graph(mesh: Mesh) -> csr_matrix:
    """Return a graph that joins the vertices of `mesh` along edges, at equal positions, and across small gaps.

    The graph is a symmetric float64 matrix (V, V) of edge lengths in mesh units. Edges between equal positions have the
    smallest normal float64 as length, because 0 means no edge to graph algorithms.

    Bridges are edges across a gap of at most 2 % of the diagonal of the box around all faces. They join two components
    along the whole gap. Components farther apart stay separate. A vertex without faces is joined to the nearest vertex
    of a face if their distance is at most this gap.

    Raises ValueError if the mesh is so large that edge lengths overflow.
    """
    size, scaled = _scaled(mesh)
    ends = np.concatenate([face_sides(mesh.faces), surface_links(mesh)])
    there, back = ends[ends[:, 0] != ends[:, 1]].T
    pattern = coo_array((np.ones(len(there), bool), (there, back)), shape=(len(scaled), len(scaled))).tocsr()
    graph = csr_matrix(pattern + pattern.T, dtype=np.float64)  # the sum of boolean matrices merges repeated edges
    row = np.repeat(np.arange(len(scaled), dtype=graph.indices.dtype), np.diff(graph.indptr))
    lengths = np.sqrt(sum((axis[row] - axis[graph.indices]) ** 2 for axis in np.ascontiguousarray(scaled.T)))
    least = np.finfo(np.float64).tiny
    graph.data = np.maximum(np.maximum(lengths, least) * size, least)
    return graph


def surface_links(mesh: Mesh) -> Int32:
    """Return pairs (L, 2) of vertices: the edges of `surface_graph` between equal positions and across small gaps.

    Raises ValueError if the mesh is so large that lengths overflow.
    """
    _, scaled = _scaled(mesh)
    stands_for = first_at_place(mesh)
    moved = np.flatnonzero(stands_for != np.arange(len(stands_for)))
    links = np.column_stack([moved, stands_for[moved]]).astype(np.int32)
    component = _core.components(len(mesh.vertices), mesh.faces, links)
    if component.max(initial=0) == 0:
        return links
    return np.concatenate([links, bridges(scaled, mesh.faces, component).astype(np.int32)])


def seam_links(mesh: Mesh) -> Int32:
    """Return pairs (L, 2) of vertices: at equal positions, or at nearby positions on both sides of an open seam.

    A seam is a border of the surface along which another border runs, as in files that were cut into pieces, quantized
    and written. Two vertices at borders are linked if their distance is at most `SEAM` times the diagonal of the
    bounding box, and at most half of the shortest side of a face there. A narrow slit on a fine mesh stays open.
    """
    first = first_at_place(mesh)
    moved = np.flatnonzero(first != np.arange(len(first)))
    links = np.column_stack([moved, first[moved]]).astype(np.int32)
    faces = first[mesh.faces]
    sides = face_sides(faces[(dirty := dirty_vertices(faces, len(first)))[faces].any(axis=1)])
    # A border has one face. An edge of faces with different sides has two.
    some = sides[dirty[sides].all(axis=1) & (sides[:, 0] != sides[:, 1])]
    pairs, which = distinct_pairs(some, len(first))
    border = np.unique(pairs[np.bincount(which, minlength=len(pairs)) == 1])
    if len(border) < 2:
        return links
    length = np.linalg.norm(mesh.vertices[sides[:, 0]] - mesh.vertices[sides[:, 1]], axis=1)
    shortest = np.full(len(first), np.inf)
    positive = length > 0
    for ends in sides[positive].T:
        np.minimum.at(shortest, ends, length[positive])
    near = np.minimum(SEAM * mesh.diagonal, shortest[border] / 2)
    neighbors = min(SEAM_NEIGHBORS, len(border))
    apart, found = cKDTree(mesh.vertices[border]).query(
        mesh.vertices[border], k=neighbors, distance_upper_bound=np.nextafter(near.max(), np.inf)
    )
    start = np.repeat(np.arange(len(border)), neighbors)
    some = np.isfinite(apart.ravel()) & (found.ravel() != start)
    start, end, apart = start[some], found.ravel()[some], apart.ravel()[some]
    close = apart <= np.minimum(near[start], near[end])
    return np.concatenate([links, np.column_stack([border[start[close]], border[end[close]]]).astype(np.int32)])


def _scaled(mesh: Mesh) -> tuple[float, Float64]:
    """Return the longest side of the bounding box, and the vertices (V, 3) divided by it, so that no square overflows.

    Raises ValueError if lengths overflow.
    """
    size = float(np.max(mesh.extents))
    if not np.isfinite(2 * size):
        raise ValueError(f"surface_graph: `mesh` must be smaller than 1e308, got {size:g}")
    return size, mesh.vertices / size if size > 0 else mesh.vertices


def bridges(vertices: Float64, faces: Int32, component: NDArray[np.integer]) -> Int64:
    """Return the bridges across small gaps: pairs (B, 2) of vertices of different components.

    `vertices` (V, 3) and `faces` (F, 3) are the mesh, and `component` (V,) is the component of each vertex.
    """
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    found = [np.zeros((0, 2), np.int64)]
    if used.any():
        size = float(np.linalg.norm(np.ptp(vertices[used], axis=0)))
        label = np.full(len(component), -1, np.int64)  # components of used vertices, renumbered from 0
        label[used] = np.unique(component[used], return_inverse=True)[1]
        own = np.flatnonzero(used)
        for gap in (SAME_PLACE, *GAPS):
            if size == 0 or label.max() == 0:
                break
            points, vertex = vertices[own], own
            if gap > SAME_PLACE:
                points, vertex = _samples(vertices, faces, own, 0.7 * gap * size)
            pairs = _across(points, vertex, label, gap * size)
            found.append(pairs)
            label = _joined(label, pairs)
        # A vertex without faces is paired with the nearest vertex of a face.
        if len(stray := np.flatnonzero(~used)):
            bound = np.nextafter(GAPS[-1] * size, np.inf)
            distance, nearest = cKDTree(vertices[own]).query(vertices[stray], distance_upper_bound=bound)
            near = np.isfinite(distance)
            found.append(np.column_stack([stray[near], own[nearest[near]]]))
    return np.concatenate(found)


def _across(points: Float64, vertex: Int64, label: Int64, gap: float) -> Int64:
    """Return pairs (B, 2) of vertices of different components, whose samples are within `gap` of each other.

    `points` (N, 3) are the samples, `vertex` (N,) their vertices, and `label` (V,) the components of the vertices.
    """
    kept, crowded = _thinned(points, label[vertex], gap / 2)
    pairs = kept[cKDTree(points[kept]).query_pairs(gap, output_type="ndarray")]
    ends = vertex[np.concatenate([pairs, crowded])]
    return distinct_pairs(ends[label[ends[:, 0]] != label[ends[:, 1]]], len(label))[0]


def _samples(vertices: Float64, faces: Int32, own: Int64, spacing: float) -> tuple[Float64, Int64]:
    """Return surface samples (N, 3) about `spacing` apart, and the vertex (N,) that each sample represents.

    The samples are the vertices `own` (K,), and points on and inside the faces with a side longer than `spacing`.
    """
    points, vertex = [vertices[own]], [own]
    longest, areas = face_sizes(vertices, faces)
    large = longest > spacing
    faces, areas = faces[large], areas[large]
    corners = vertices[faces]
    sides = face_sides(faces)
    per_side = _capped(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).ravel() / spacing)
    side = np.repeat(np.arange(len(sides)), per_side)
    index = np.arange(len(side)) - (np.cumsum(per_side) - per_side)[side]
    fraction = ((index + 0.5) / per_side[side])[:, None]
    points.append((1 - fraction) * vertices[sides[side, 0]] + fraction * vertices[sides[side, 1]])
    vertex.append(sides[side, (fraction[:, 0] > 0.5).astype(int)])
    face, weights = points_on_faces(_capped(areas / spacing**2))
    points.append(np.einsum("nk,nkd->nd", weights, corners[face]))
    vertex.append(faces[face, weights.argmax(axis=1)])
    return np.concatenate(points), np.concatenate(vertex).astype(np.int64)


def _capped(wanted: Float64) -> Int64:
    """Return the numbers `wanted` (K,), scaled to a sum of at most about `_MOST_POINTS`, and rounded up."""
    return np.ceil(wanted * min(1.0, _MOST_POINTS / max(float(wanted.sum()), 1.0))).astype(np.int64)


def _thinned(points: Float64, label: Int64, cell: float) -> tuple[Int64, Int64]:
    """Choose a point for each of the first few labels in each grid cell with sides `cell`. Return the indices (K,).

    Also return pairs (C, 2), one for each other label in a cell: a chosen point, and a point with this label.
    """
    voxel = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    span = voxel.max(axis=0) + 1
    if np.prod(span.astype(float)) < 2**31:
        number = (voxel[:, 0] * span[1] + voxel[:, 1]) * span[2] + voxel[:, 2]
    else:  # renumber the cells, because products of cell and label numbers would overflow
        number = weld(voxel.astype(np.float64))[1].astype(np.int64)
    key, first = np.unique(number * (label.max() + 1) + label, return_index=True)
    cells = key // (label.max() + 1)
    begins = np.flatnonzero(np.concatenate([[True], cells[1:] != cells[:-1]]))
    head = np.repeat(begins, np.diff(begins, append=len(first)))
    few = np.arange(len(first)) - head < _LABELS_IN_CELL
    return first[few], np.column_stack([first[head[~few]], first[~few]])


def _joined(label: Int64, pairs: Int64) -> Int64:
    """Return the labels (V,) of vertices after the labels of the two vertices of each pair (B, 2) become equal."""
    count = int(label.max()) + 1
    ends = label[pairs]
    links = coo_array((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), shape=(count, count))
    merged = connected_components(links, directed=False)[1].astype(np.int64)
    return np.where(label >= 0, merged[label], -1)
