"""Measure a deformed surface: its distortion as in Fig. 22, gaps between its components, and its asymmetry."""

import igl
import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float64, Int64, distinct_pairs, group_sums, unit
from dfd.geometry.topology import even_points, face_areas, face_components, face_sides, first_at_place
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import face_normals

FOLD = -0.5  # A face is folded if the cosines between its normal and its neighbors' normals sum to less than this.

CONTACT = 0.005  # Components touch where a surface sample of one is nearer to the other; a fraction of the diagonal.
CUT = 0.001  # A vertex on a boundary edge is on a cut if another such edge is nearer to it; a fraction of the diagonal.
SAMPLES = 20_000  # number of surface samples for contacts
SYMMETRIC = 0.01  # largest mean distance of mirror images from the vertices at rest; a fraction of the diagonal


def surface_metrics(mesh: Mesh, vertices: ArrayLike) -> dict[str, float | None]:
    """Return table columns for the distortion of `mesh` if its vertices move to `vertices` (V, 3), in mesh units.

    Area, angle and edge are mean absolute changes, weighted by areas or lengths at rest. Volume is the change of the
    enclosed volume, or None if the surface is open or encloses nothing. Flipped faces are faces that are folded
    after the deformation, but not at rest. A rigid motion changes no value. Faces without area at rest are ignored.

    Raises ValueError if `vertices` is not finite or not of the array shape (V, 3), or if no face has an area.
    """
    moved = check.array("surface_metrics", "vertices", vertices, mesh.vertices.shape, dtype=np.float64)
    # Both shapes are scaled to unit size, which keeps the precision for very small and very large shapes.
    center, size = mesh.bounds.mean(axis=0), max(mesh.diagonal, np.finfo(float).tiny)
    both = [np.ascontiguousarray(each - center) / size for each in (mesh.vertices, moved)]
    faces = first_at_place(mesh)[mesh.faces].astype(np.int64)
    faces = faces[face_areas(both[0], faces) > 0]
    if len(faces) == 0:
        raise ValueError("surface_metrics: `mesh` must have a face with an area, got none")
    resting, after = (trimesh.Trimesh(each, faces, process=False) for each in both)
    area, moved_area = (face_areas(each, faces) for each in both)
    angles, moved_angles = (np.nan_to_num(np.degrees(igl.internal_angles(each, faces))) for each in both)
    edges, edge = distinct_pairs(face_sides(faces), len(moved))
    length, moved_length = (np.linalg.norm(each[edges[:, 0]] - each[edges[:, 1]], axis=1) for each in both)
    folded, moved_folded = (_folded(each, faces, edge) for each in both)
    closed = resting.is_watertight and resting.is_winding_consistent and abs(resting.volume) > 1e-12
    return {
        "area %": 100 * float(np.abs(moved_area - area).sum() / area.sum()),
        "angle °": float(area / area.sum() @ np.abs(moved_angles - angles).mean(axis=1)),
        "edge %": 100 * float(np.abs(moved_length - length).sum() / length.sum()),
        "volume %": 100 * float(after.volume / resting.volume - 1) if closed else None,
        "flipped faces": int((moved_folded & ~folded).sum()),
    }


def contact_gap(mesh: Mesh, vertices: NDArray[np.floating]) -> float | None:
    """Return the largest gap that opens where surface of `mesh` touches, if its vertices move to `vertices` (V, 3).

    Points of two components can touch, and points on both sides of a cut in one component. A gap is the distance
    between the displacements of two touching points, in % of the largest displacement of a vertex. None: nothing
    touches.
    """
    faces = first_at_place(mesh)[mesh.faces].astype(np.int64)
    corners, shares = even_points(mesh.vertices, faces.astype(np.int32), SAMPLES)
    points, moves = np.einsum("nk,nkd->nd", shares, mesh.vertices[corners]), vertices - mesh.vertices
    of_face, gaps = face_components(faces.astype(np.int32)), _cut_gaps(mesh, faces, moves)
    of_vertex = np.full(len(mesh.vertices), -1)
    of_vertex[faces] = of_face[:, None]
    for component in np.unique(of_face) if of_face.max(initial=0) else ():
        own, others = of_vertex[corners[:, 0]] == component, faces[of_face != component]
        squared, hit, closest = igl.point_mesh_squared_distance(points[own], mesh.vertices, others)
        near = squared < (CONTACT * mesh.diagonal) ** 2
        there = others[hit[near]]
        at = igl.barycentric_coordinates(closest[near], *(np.ascontiguousarray(mesh.vertices[c]) for c in there.T))
        here = np.einsum("nk,nkd->nd", shares[own][near], moves[corners[own][near]])
        gaps.append(np.linalg.norm(here - np.einsum("nk,nkd->nd", at, moves[there]), axis=1).max(initial=-1.0))
    largest = max(gaps, default=-1.0)
    return None if largest < 0 else 100 * float(largest / max(np.linalg.norm(moves, axis=1).max(), 1e-300))


def _cut_gaps(mesh: Mesh, faces: Int64, moves: Float64) -> list[float]:
    """Return the distance, in mesh units, by which each vertex on a cut moves apart from the other side of the cut."""
    edges, edge = distinct_pairs(face_sides(faces), len(mesh.vertices))
    gaps, edges = [], edges[np.bincount(edge) == 1]
    start, along = mesh.vertices[edges[:, 0]], np.diff(mesh.vertices[edges], axis=1)[:, 0]
    for vertex in np.unique(edges):
        from_start = mesh.vertices[vertex] - start
        share = ((from_start * along).sum(axis=1) / np.square(along).sum(axis=1)).clip(0, 1)
        apart = np.linalg.norm(from_start - share[:, None] * along, axis=1)
        apart[(edges == vertex).any(axis=1)] = np.inf
        if apart[nearest := int(apart.argmin())] < CUT * mesh.diagonal:
            one, other = moves[edges[nearest]]
            gaps.append(float(np.linalg.norm(moves[vertex] - one - share[nearest] * (other - one))))
    return gaps


def asymmetry(mesh: Mesh, vertices: NDArray[np.floating]) -> float | None:
    """Return how far the displacements to `vertices` (V, 3) are from being mirror images: 0 % to 100 % on average.

    A displacement is compared with that of the vertex nearest to the mirror image at rest. 0: both sides move alike;
    100: only one side moves. The plane is that of the coordinate planes through the center of the bounding box with the
    lowest value, among those in which the shape at rest is symmetric. None: there is no such plane, or nothing moves.
    """
    moves, tree, found = vertices - mesh.vertices, KDTree(mesh.vertices), []
    total = 2 * np.linalg.norm(moves, axis=1).sum()
    for axis in range(3):
        sign = np.where(np.arange(3) == axis, -1.0, 1.0)
        off, image = tree.query((mesh.vertices - mesh.bounds.mean(axis=0)) * sign + mesh.bounds.mean(axis=0))
        if off.mean() < SYMMETRIC * mesh.diagonal and total > 0:
            found.append(100 * float(np.linalg.norm(moves * sign - moves[image], axis=1).sum() / total))
    return min(found, default=None)


def _folded(vertices: Float64, faces: NDArray[np.integer], edge: Int64) -> Bool:
    """Return the mask (F,) of folded faces, see `FOLD`; `edge` (3 F,) are the edge indices of the faces' sides."""
    normals = unit(face_normals(vertices, faces))
    around = group_sums(edge, np.repeat(normals, 3, axis=0), edge.max() + 1)
    others = around[edge].reshape(-1, 3, 3).sum(axis=1) - 3 * normals
    return (others * normals).sum(axis=1) < FOLD
