"""Weights smoothed where they fade: a ledge or a crease at the border of what follows a handle goes away.

Botsch and Kobbelt, "An Intuitive Framework for Real-Time Freeform Modeling", 2004, for the energy and its ends.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_matrix, diags_array
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

from dfd.common.linear_algebra import Bool, Float32, Float64, Int32, Int64
from dfd.geometry.surface_graph import edge_graph
from dfd.geometry.topology import face_sizes
from dfd.mesh.weld import weld

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

WIDTH = 0.02  # of the box's diagonal: what of a border is narrower is smoothed, and broad falloffs stay
SURE = 0.005  # what follows by less, or by all but less, does not fade
STEEP = 0.5  # from one end of an edge to the other: there a border is, although nothing fades
THINNEST = 1e-6  # height of a face, of its longest side: a thinner one has no angles to go by
MOST_COTANGENT = 100.0  # and least, in turn: slivers and blunt angles must not tear the surface apart


class Seams:
    """The borders of what follows, on one mesh; vertices at one position are one."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    @cached_property
    def _surface(self) -> tuple[Int64, Int32, Float64, Int32, csr_matrix]:
        """First vertices and the number of each, then positions, faces and edges of the welded mesh, diagonal 1."""
        first, vertex = weld(self._mesh.vertices)
        points = (self._mesh.vertices[first] - self._mesh.bounds[0]) / self._mesh.diagonal
        faces = vertex[self._mesh.faces]
        longest, areas = face_sizes(points, faces)
        faces = faces[areas > THINNEST * longest**2]
        return first, vertex, points, faces, edge_graph(points, faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2))

    def smooth(self, weights: Float32, still: Int64) -> None:
        """Smooth `weights` (V,), of 0 and more, where they fade; those of the vertices `still` (N,) stay.

        What is smoothed minimizes ∫ ℓ⁴ (Δw)² + (w − w₀)² with the values and slopes around it, ℓ being `WIDTH`. All
        other weights keep their bits.
        """
        top = float(weights.max(initial=0.0))
        if self._mesh.diagonal == 0.0 or top == 0.0:
            return
        first, vertex, points, faces, graph = self._surface
        before = weights[first].astype(np.float64) / top
        free = self._around(before, graph)
        free[vertex[still]] = False
        free &= np.diff(graph.indptr) > 0
        if not free.any():
            return
        near = graph @ free.astype(np.float64) > 0
        used, corners = np.unique(faces[(near | free)[faces].any(axis=1)], return_inverse=True)
        laplacian, area = _operators(points[used], corners.reshape(-1, 3))
        inner = free[used]
        bending = (laplacian @ diags_array(1.0 / area) @ laplacian)[inner]
        staying = area[inner] / WIDTH**4
        system = csc_array(bending[:, inner] + diags_array(staying))
        wanted = staying * before[used[inner]] - bending[:, ~inner] @ before[used[~inner]]
        after = splu(system, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(wanted)
        if np.isfinite(after).all():
            before[used[inner]] = np.clip(after, 0.0, 1.0)
            rows = free[vertex]
            weights[rows] = top * before[vertex[rows]]

    def _around(self, weights: Float64, graph: csr_matrix) -> Bool:
        """Which vertices are where `weights` fade or jump, or nearer than two widths to that."""
        fades = (weights > SURE) & (weights < 1.0 - SURE)
        row = np.repeat(np.arange(len(weights)), np.diff(graph.indptr))
        fades[row[np.abs(weights[row] - weights[graph.indices]) > STEEP]] = True
        if not fades.any():
            return fades
        sources = np.flatnonzero(fades)
        return np.isfinite(dijkstra(graph, indices=sources, min_only=True, limit=2.0 * WIDTH))


def _operators(points: Float64, faces: Int64) -> tuple[csr_matrix, Float64]:
    """The cotangent Laplacian (V, V) of a surface, positive, and the area (V,) around each vertex.

    Pinkall and Polthier, "Computing Discrete Minimal Surfaces and Their Conjugates", 1993.
    """
    count = len(points)
    corners = points[faces]
    double = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    one, other = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cotangents = (one * other).sum(axis=2) / double[:, None]
    across = np.clip(cotangents, 1.0 / MOST_COTANGENT, MOST_COTANGENT).ravel() / 2.0
    ends = np.roll(faces, -1, axis=1).ravel(), np.roll(faces, 1, axis=1).ravel()
    links = coo_array((across, ends), shape=(count, count)).tocsr()
    links = links + links.T
    area = np.bincount(faces.ravel(), np.repeat(double / 6.0, 3), minlength=count)
    return diags_array(links.sum(axis=1)) - links, np.maximum(area, 1e-3 * area.mean())
