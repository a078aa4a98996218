"""Distances along the surface, for the falloff of Eq. 7.

The heat method (K. Crane, C. Weischedel, M. Wardetzky, "The heat method for distance computation", 2017) through
potpourri3d, on a coarse mesh when the mesh is large.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import potpourri3d
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from dfd.common import check
from dfd.geometry.coarse import CoarseMesh, coarsen
from dfd.geometry.topology import first_at_place
from dfd.mesh.mesh import Mesh

__all__ = ["Geodesics"]

_COARSE_FACES = 50_000


class Geodesics:
    """Distances over the surface of a mesh from any of its vertices; nothing is computed before the first question."""

    def __init__(self, mesh: Mesh, *, coarse_faces: int = _COARSE_FACES) -> None:
        """Keep the mesh.

        Parameters
        ----------
        mesh
            Any mesh; holes, many pieces, edges of more than two faces and faces without area are no obstacle.
        coarse_faces
            Meshes of more than twice as many faces are simplified to so many for the solver.
        """
        self._mesh = mesh
        self._coarse_faces = int(check.number("Geodesics", "coarse_faces", coarse_faces, minimum=100))

    def distances(self, handles: Any, *, dtype: Any = np.float32) -> NDArray[Any]:
        """Return how far every vertex is from each handle along the surface, as a share of the farthest it reaches.

        Parameters
        ----------
        handles
            (H,) vertex indices, or (H, 3) points, each of which stands for the vertex nearest to it.
        dtype
            float32, or float16: half the memory, and off by 2.5e-4 at most, which is less than the method errs.

        Returns
        -------
        (H, V) in [0, 1]: 0 at the handle, 1 at the farthest vertex of its piece of the mesh and on all other pieces.

        Raises
        ------
        ValueError
            If `handles` has another shape, or holds an index out of range or a coordinate that is not finite, or
            `dtype` is another.
        """
        if dtype not in (np.float32, np.float16, "float32", "float16"):
            raise ValueError(f"Geodesics.distances: `dtype` must be float32 or float16, got {dtype!r}")
        chosen = self._handle_vertices(handles)
        result = np.ones((len(chosen), len(self._mesh.vertices)), dtype)
        for row, handle in zip(result, chosen, strict=True):
            row[:] = self._from(int(handle))
        return result

    def _handle_vertices(self, handles: Any) -> NDArray[np.int64]:
        if np.ndim(handles) == 2:
            points = check.array("Geodesics.distances", "handles", handles, ("H", 3), dtype=np.float64)
            return np.asarray(self._tree.query(points)[1], np.int64).reshape(-1)
        return check.vertex_indices("Geodesics.distances", "handles", handles, len(self._mesh.vertices))

    def lengths(self, handles: Any) -> NDArray[np.float32]:
        """Return how far every vertex is from each handle along the surface, (H, V) in mesh units, inf where no way is.

        Parameters and errors are those of `distances`.
        """
        chosen = self._handle_vertices(handles)
        return np.array([self._lengths(int(handle)) for handle in chosen], np.float32).reshape(len(chosen), -1)

    def _from(self, handle: int) -> NDArray[np.float32]:
        """Return one row of `distances`."""
        lengths = self._lengths(handle)
        reached = np.isfinite(lengths)
        farthest = lengths[reached].max()
        row = np.ones(len(lengths), np.float32)
        row[reached] = lengths[reached] / farthest if farthest > 0 else 0
        return row

    def _lengths(self, handle: int) -> NDArray[np.float64]:
        """Return one row of `lengths`."""
        coarse = self._coarse
        row = np.full(len(self._mesh.vertices), np.inf)
        row[self._same_place(handle)] = 0
        if coarse.face[handle] < 0:  # no sound face leads away from it
            return row
        corners = coarse.faces[coarse.face[handle]]
        share = coarse.barycentric[handle]
        reached = self._piece[corners[0]] == np.where(coarse.face >= 0, self._piece[coarse.faces[coarse.face, 0]], -1)
        # distance is nearly linear in where it starts from, too: blend those from the corners around the handle
        far = np.zeros(len(coarse.vertices))
        for corner, weight in zip(corners, share, strict=True):
            if weight > 1e-9:
                far += weight * self._solve(int(corner))
        distance = coarse.carry(far)[reached]
        if share.max() < 1 - 1e-9:
            distance = self._near_field(handle, reached, distance)
        row[reached] = np.maximum(distance, 0)
        row[self._same_place(handle)] = 0
        return row

    def _near_field(
        self, handle: int, reached: NDArray[np.bool_], distance: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Within a few coarse edges of the handle the straight distance is the better one: blend into it."""
        vertices = self._mesh.vertices
        straight: NDArray[np.float64] = np.linalg.norm(vertices[reached] - vertices[handle], axis=1)
        edge = self._coarse_edge
        # judged by the distance along the surface, so that a sheet close by on another side is not meant
        share = np.clip(distance / edge - 1, 0, 2) / 2
        return straight + (np.maximum(distance, straight) - straight) * share * share * (3 - 2 * share)

    def _solve(self, corner: int) -> NDArray[np.float64]:
        """Return the distance (K,) of every coarse vertex of its piece from a coarse vertex; others mean nothing."""
        distance = np.asarray(self._solver.compute_distance(corner)) if self._solver is not None else np.array([np.nan])
        mine = self._piece == self._piece[corner]
        if len(distance) != len(mine) or not np.isfinite(distance[mine]).all():
            # slivers can break the solver's factorization: go along edges instead, at worst some percent too far
            distance = dijkstra(self._edges, directed=False, indices=corner)
        distance = np.where(mine, distance, 0.0)
        shifted: NDArray[np.float64] = distance - distance[corner]
        return np.maximum(shifted, 0)

    def _same_place(self, handle: int) -> NDArray[np.int64]:
        return np.flatnonzero((self._mesh.vertices == self._mesh.vertices[handle]).all(axis=1))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._mesh.vertices)

    @cached_property
    def _coarse(self) -> CoarseMesh:
        most = self._coarse_faces if len(self._mesh.faces) > 2 * self._coarse_faces else len(self._mesh.faces)
        stands_for = first_at_place(self._mesh)
        return coarsen(self._mesh.vertices, stands_for[self._mesh.faces], most).at(stands_for)

    @cached_property
    def _solver(self) -> Any:
        """The factorized heat method, None if the mesh does not allow it."""
        try:
            return potpourri3d.MeshHeatMethodDistanceSolver(self._coarse.vertices, self._coarse.faces, use_robust=True)
        except (RuntimeError, ValueError):
            return None

    @cached_property
    def _edges(self) -> Any:
        """Lengths of the coarse edges as a sparse matrix (K, K)."""
        ends = np.unique(np.sort(self._coarse.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        a, b = self._coarse.vertices[ends[:, 0]], self._coarse.vertices[ends[:, 1]]
        count = len(self._coarse.vertices)
        # csgraph takes a stored 0 for no edge
        lengths = np.maximum(np.linalg.norm(a - b, axis=1), np.finfo(float).tiny)
        return coo_array((lengths, (ends[:, 0], ends[:, 1])), shape=(count, count)).tocsr()

    @cached_property
    def _coarse_edge(self) -> float:
        return float(np.median(self._edges.data))

    @cached_property
    def _piece(self) -> NDArray[np.int32]:
        """(K,) the connected piece of each coarse vertex."""
        pieces: NDArray[np.int32] = connected_components(self._edges, directed=False)[1]
        return pieces
