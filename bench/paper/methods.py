"""Methods that DFD is compared with: each returns the moved vertices (V, 3) of a case, mesh units, or says why not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from bench.paper.handles import Case
from bench.quality.baselines import PeerError, in_child

__all__ = ["BALL", "arap", "biharmonic", "constraints"]

BALL = 0.01  # of the longest side: the radius in which the paper gives other methods the neighbors of a point as well
ITERATIONS = 100


def arap(case: Case, ball: float = BALL) -> NDArray[np.float64]:
    """As-rigid-as-possible by libigl, from the resting shape.

    Raises
    ------
    PeerError
        If libigl is not installed, fails, crashes or takes too long, or a piece of the surface has no constraint.
    """
    return _solved(case, ball, _arap)


def biharmonic(case: Case, ball: float = BALL) -> NDArray[np.float64]:
    """Biharmonic displacements: by the set's own coordinates where it has them, else by libigl over the surface.

    The paper solves within tetrahedra; over the surface none are needed, and meshes with holes are solved as well.

    Raises
    ------
    PeerError
        As in `arap`.
    """
    if case.coordinates is not None:
        return case.mesh.vertices + case.coordinates @ (case.held_to - case.mesh.vertices[case.held])
    return _solved(case, ball, _biharmonic)


def constraints(case: Case, ball: float = BALL) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Vertices (N,), distinct, and where they are to be (N, 3): those that are held, and their neighbors.

    Every corner of a face within `ball`, a part of the longest side, goes as the nearest held vertex does.
    """
    offsets = case.held_to - case.mesh.vertices[case.held]
    corners = np.unique(case.mesh.faces).astype(np.int64)
    radius = 0.0 if case.dense else ball * float(case.mesh.extents.max())
    distance, nearest = KDTree(case.mesh.vertices[case.held]).query(case.mesh.vertices[corners])
    near = distance <= radius
    return corners[near], case.mesh.vertices[corners[near]] + offsets[nearest[near]]


def _solved(case: Case, ball: float, solve: Callable[..., NDArray[np.float64]]) -> NDArray[np.float64]:
    held, held_to = constraints(case, ball)
    used, faces = np.unique(case.mesh.faces, return_inverse=True)  # a vertex of no face makes the equations singular
    faces = faces.reshape(-1, 3).astype(np.int64)
    held = np.searchsorted(used, held)
    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_array((np.ones(len(edges), bool), (edges[:, 0], edges[:, 1])), shape=(len(used), len(used)))
    count, piece = connected_components(graph, directed=False)
    if len(np.unique(piece[held])) < count:
        raise PeerError(f"needs a handle or a fixed point on every one of the {count} pieces of the surface")
    moved = case.mesh.vertices.copy()
    moved[used] = in_child(solve, case.mesh.vertices[used], faces, held, held_to)
    moved = moved[case.mesh.representative]
    if not np.isfinite(moved).all():
        raise PeerError("gives NaN")
    return moved


def _arap(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], held: NDArray[np.int64], held_to: NDArray[np.float64]
) -> NDArray[np.float64]:
    try:
        import igl
    except ImportError:
        raise PeerError("libigl is not installed") from None
    data = igl.ARAPData()
    data.max_iter = ITERATIONS
    igl.arap_precomputation(vertices, faces, 3, held.astype(np.int32), data)
    return np.asarray(igl.arap_solve(held_to, data, vertices))


def _biharmonic(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], held: NDArray[np.int64], held_to: NDArray[np.float64]
) -> NDArray[np.float64]:
    try:
        import igl
    except ImportError:
        raise PeerError("libigl is not installed") from None
    displacements = np.asarray(igl.harmonic(vertices, faces, held, held_to - vertices[held], 2))
    if displacements.shape != vertices.shape:
        raise PeerError("finds no solution")
    moved: NDArray[np.float64] = vertices + displacements
    return moved
