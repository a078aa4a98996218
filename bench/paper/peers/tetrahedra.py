"""Tetrahedra within a surface, by fTetWild; Hu et al., "Fast Tetrahedral Meshing in the Wild", 2020."""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import fast_simplification
import numpy as np
from scipy.spatial import KDTree

from bench.quality.baselines import PeerError, in_child
from dfd.common.linear_algebra import Float64, Int64

EDGE = 0.05  # of the diagonal: the length of tetrahedra's edges
MOST_FACES = 6_000  # of the surface that is filled: fTetWild takes minutes beyond on two cores
AWAY = 0.08  # of the diagonal: a surface that is farther from the tetrahedra was not filled
PATIENCE = 900.0


@dataclass(frozen=True)
class Tetrahedra:
    """What fills a surface, and where the surface's vertices lie on the boundary."""

    nodes: Float64  # (N, 3)
    cells: Int64  # (T, 4)
    corners: Int64  # (V, 3) nodes of the boundary's triangle nearest to each vertex of the surface
    barycentric: Float64  # (V, 3) coordinates there
    seconds: float  # that it took

    def nearest(self, points: Float64) -> Int64:
        """The node nearest to each of the points (P, 3)."""
        return KDTree(self.nodes).query(points)[1].astype(np.int64)

    def on_surface(self, values: Float64) -> Float64:
        """Values (V, D) at the surface's vertices of those at nodes (N, D)."""
        return np.einsum("vk,vkd->vd", self.barycentric, values[self.corners])


known: dict[str, Tetrahedra | PeerError] = {}  # several peers and pages ask for one shape's


def tetrahedra(
    vertices: Float64, faces: Int64, *, patience: float = PATIENCE, most_faces: int | None = MOST_FACES
) -> Tetrahedra:
    """Fill a surface with tetrahedra, once in a process; one of more than `most_faces` faces is simplified before.

    Raises PeerError if `wildmeshing` or libigl is not installed, or the surface cannot be filled, or not within
    `patience` seconds.
    """
    key = hashlib.sha256(vertices.tobytes() + faces.tobytes()).hexdigest() + f" {most_faces}"
    if key not in known:
        try:
            known[key] = in_child(_fill, vertices, faces, EDGE, most_faces, seconds=patience)
        except PeerError as error:
            known[key] = error
    found = known[key]
    if isinstance(found, PeerError):
        raise found
    return found


def fill(points: Float64, faces: Int64, edge: float) -> tuple[Float64, Int64]:
    """Nodes (N, 3) and tetrahedra (T, 4) within what a surface nearly closes off; in a process of its own.

    fTetWild writes every step to stdout, and a file where it works.

    Raises PeerError if `wildmeshing` is not installed, or nothing is closed off.
    """
    try:
        import igl  # noqa: F401
        import wildmeshing
    except ImportError as error:
        raise PeerError(f"needs {error.name}, which is not installed") from None
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    center = points.mean(axis=0)
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        tetrahedralizer = wildmeshing.Tetrahedralizer(stop_quality=30, max_its=30, edge_length_r=edge)
        tetrahedralizer.set_mesh(points - center, faces.astype(np.int32))
        tetrahedralizer.tetrahedralize()
        nodes, cells = tetrahedralizer.get_tet_mesh()[:2]
        os.chdir(before)
    if len(cells) == 0:
        raise PeerError("cannot be filled with tetrahedra: the surface encloses nothing")
    used, corners = np.unique(cells, return_inverse=True)
    return np.ascontiguousarray(nodes[used] + center), corners.reshape(-1, 4).astype(np.int64)


def boundary(nodes: Float64, cells: Int64, vertices: Float64) -> tuple[Int64, Float64, Float64]:
    """The boundary's triangle (V, 3) nearest to each vertex, barycentric coordinates in it, and the distance (V,)."""
    import igl

    surface = np.ascontiguousarray(igl.boundary_facets(cells)[0])
    squared, face, closest = igl.point_mesh_squared_distance(np.ascontiguousarray(vertices), nodes, surface)
    corners = surface[face].astype(np.int64)
    barycentric = igl.barycentric_coordinates(closest, *(np.ascontiguousarray(nodes[corner]) for corner in corners.T))
    return corners, np.asarray(barycentric), np.sqrt(squared)


def _fill(vertices: Float64, faces: Int64, edge: float, most: int | None) -> Tetrahedra:
    begin = time.perf_counter()
    points, sides = vertices, faces
    if most is not None and len(faces) > most:
        points, sides = fast_simplification.simplify(vertices.astype(np.float32), faces, target_count=most)
    nodes, cells = fill(np.asarray(points, np.float64), np.asarray(sides, np.int64), edge)
    corners, barycentric, distance = boundary(nodes, cells, vertices)
    farthest = distance.max() / np.linalg.norm(np.ptp(vertices, axis=0))
    if farthest > AWAY:
        raise PeerError(f"cannot be filled with tetrahedra: parts stay {100 * farthest:.0f} % of the diagonal away")
    return Tetrahedra(nodes, cells, corners, barycentric, time.perf_counter() - begin)
