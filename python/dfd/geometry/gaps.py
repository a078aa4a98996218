"""Measure the gaps that a motion opens between pieces of a mesh that touch each other at rest."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64, Int32, distinct_pairs
from dfd.geometry.coarse import nodes_of
from dfd.geometry.topology import even_points
from dfd.mesh.mesh import Mesh

# Pieces touch if their distance is below this fraction of the bounding box's diagonal. Between a plate and boxes or a
# post that only slide or turn on it, the samples measure gaps up to 0.0007.
TOUCHING = 0.005
SPACING = 0.7 * TOUCHING  # distance between neighboring samples, in diagonals
MOST_SAMPLES = 200_000  # largest number of samples on all pieces


class _Pair(NamedTuple):
    """Samples of two pieces, as corners (N, 3) and barycentric rows (N, 3), and the distance of the pieces."""

    one: tuple[Int32, Float32]
    other: tuple[Int32, Float32]
    apart: float


class Gaps:
    """The places where the pieces of a mesh, its connected components, touch each other."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh, self._pairs = mesh, list[_Pair]()
        nodes = nodes_of(mesh)
        piece, near = nodes.component, np.zeros(len(nodes.center), bool)
        row = np.repeat(np.arange(len(piece)), np.diff(nodes.graph.indptr))
        across = nodes.used[row] & nodes.used[nodes.graph.indices] & (piece[row] != piece[nodes.graph.indices])
        near[row[across]] = True
        faces = mesh.faces[near[nodes.of_vertex[mesh.faces]].any(axis=1)]
        area = mesh.vertices[faces]
        total = np.linalg.norm(np.cross(area[:, 1] - area[:, 0], area[:, 2] - area[:, 0]), axis=1).sum() / 2
        if not total > 0:
            return
        count = int(min(total / (SPACING * mesh.diagonal) ** 2, MOST_SAMPLES)) + 1
        corners, rows = even_points(mesh.vertices, faces, count)
        points = _points(mesh.vertices, (corners, rows))
        of_sample = piece[nodes.of_vertex[corners[:, 0]]].astype(np.int64)
        close = cKDTree(points).query_pairs(TOUCHING * mesh.diagonal, output_type="ndarray")
        close = close[of_sample[close[:, 0]] != of_sample[close[:, 1]]]
        pairs, which = distinct_pairs(of_sample[close], int(piece.max()) + 1)
        apart = np.linalg.norm(points[close[:, 0]] - points[close[:, 1]], axis=1)
        for k, ends in enumerate(pairs):
            sides = [(corners[of_sample == end], rows[of_sample == end]) for end in ends]
            self._pairs.append(_Pair(sides[0], sides[1], float(apart[which == k].min())))

    def opened(self, posed: Float64) -> Float64:
        """Return by how much the distance of each pair of touching pieces grows, (P,), in mesh units.

        `posed` (V, 3) are the moved vertices. The distance of two pieces is that of their nearest samples.
        """
        found = np.zeros(len(self._pairs))
        for i, pair in enumerate(self._pairs):
            one, other = _points(posed, pair.one), _points(posed, pair.other)
            found[i] = max(float(cKDTree(one).query(other)[0].min()) - pair.apart, 0.0)
        return found


def _points(vertices: Float64, samples: tuple[Int32, Float32]) -> Float64:
    """Return the positions (N, 3) of samples of faces."""
    return np.einsum("nk,nkd->nd", samples[1], vertices[samples[0]])
