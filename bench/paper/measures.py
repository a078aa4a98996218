"""Numbers about shapes, and finer copies of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree

import dfd
from bench.quality.measures import components_of
from dfd.common.linear_algebra import Int64
from dfd.geometry.topology import face_areas, face_components, first_at_place

NEAR = 0.005  # of the diagonal: vertices of two components as near as that belong together


def edges(faces: NDArray[np.integer]) -> tuple[Int64, Int64]:
    """The distinct edges (E, 2) of faces (F, 3) that have three different corners, and how many faces each has (E,)."""
    proper = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)].astype(np.int64)
    ends = np.sort(proper[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    size = int(ends.max(initial=0)) + 1
    key, uses = np.unique(ends[:, 0] * size + ends[:, 1], return_counts=True)
    return np.stack(np.divmod(key, size), axis=1), uses


@dataclass(frozen=True)
class Defects:
    """What is wrong with a surface, vertices that share a position counted as one."""

    non_manifold: int  # edges of more than two faces, and vertices around which faces do not form one fan
    holes: int
    boundary: Int64  # (B, 2) edges of one face
    crowded: Int64  # (N, 2) edges of more than two faces


def defects(mesh: dfd.Mesh) -> Defects:
    """Count what the paper reports under its scans (Fig. 18)."""
    faces = first_at_place(mesh)[mesh.faces]
    ends, uses = edges(faces)
    boundary, crowded = ends[uses == 1], ends[uses > 2]
    return Defects(len(crowded) + _split_vertices(faces, ends, uses), holes(boundary), boundary, crowded)


def holes(boundary: NDArray[np.integer]) -> int:
    """How many holes the edges (B, 2) of one face enclose: the components that these edges form.

    Two holes that meet in a vertex count as one.
    """
    if len(boundary) == 0:
        return 0
    used, number = np.unique(boundary, return_inverse=True)
    return int(components_of(number.reshape(-1, 2), len(used)).max()) + 1


def _split_vertices(faces: NDArray[np.integer], ends: Int64, uses: Int64) -> int:
    """How many vertices have faces in more than one fan, faces being of one fan when an edge at the vertex joins them.

    Vertices of an edge of more than two faces are left to that edge.
    """
    proper = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)].astype(np.int64)
    corner = np.arange(3 * len(proper)).reshape(-1, 3)
    # Each side joins, at both of its ends, its face's corner there with that of the face on the other side.
    tails, heads = proper, np.roll(proper, -1, axis=1)
    at_tail, at_head = corner, np.roll(corner, -1, axis=1)
    low = np.minimum(tails, heads).ravel()
    key = low * (int(proper.max(initial=0)) + 1) + np.maximum(tails, heads).ravel()
    order = np.argsort(key, kind="stable")
    forward = (tails.ravel() == low)[order]
    first = np.where(forward, at_tail.ravel()[order], at_head.ravel()[order])  # the corner at the lower vertex
    second = np.where(forward, at_head.ravel()[order], at_tail.ravel()[order])
    same = key[order][1:] == key[order][:-1]
    links = np.concatenate([np.stack([side[:-1][same], side[1:][same]], axis=1) for side in (first, second)])
    fan = components_of(links, proper.size)
    fans = np.unique(np.stack([proper.ravel(), fan], axis=1), axis=0)[:, 0]
    vertices, count = np.unique(fans, return_counts=True)
    return int((~np.isin(vertices[count > 1], ends[uses > 2])).sum())


def roughness(mesh: dfd.Mesh, weights: NDArray[np.floating]) -> float:
    """How much weights (V,) change along the surface: the mean of |∇W|, in weight per diagonal of the box.

    The gradient is that of the linear function on each face, faces count by their areas.
    """
    corners = mesh.vertices[mesh.faces]
    area = face_areas(mesh.vertices, mesh.faces)
    along, aside = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(along, aside)
    rises = weights[mesh.faces].astype(np.float64)
    gradient = np.cross(normal, aside) * -(rises[:, 1] - rises[:, 0])[:, None]
    gradient += np.cross(normal, along) * (rises[:, 2] - rises[:, 0])[:, None]
    squared = (normal**2).sum(axis=1)
    some = squared > 0
    length = np.linalg.norm(gradient[some], axis=1) / squared[some]
    return float((length * area[some]).sum() / area.sum() * mesh.diagonal)


def gap(mesh: dfd.Mesh, moved: NDArray[np.floating]) -> float | None:
    """The mean change of distance, mesh units, between near vertices of different components; None without any."""
    faces = first_at_place(mesh)[mesh.faces]
    component = np.full(len(mesh.vertices), -1)
    component[faces] = face_components(faces.astype(np.int32))[:, None]
    used = np.flatnonzero(component >= 0)
    pairs = used[KDTree(mesh.vertices[used]).query_pairs(NEAR * mesh.diagonal, output_type="ndarray")]
    first, second = pairs[component[pairs[:, 0]] != component[pairs[:, 1]]].T
    if len(first) == 0:
        return None
    before, after = mesh.vertices[first] - mesh.vertices[second], moved[first] - moved[second]
    return float(np.linalg.norm(after - before, axis=1).mean())


def subdivided(mesh: dfd.Mesh, times: int) -> dfd.Mesh:
    """The mesh with every face cut into four, `times` times over; holes stay, appearance goes."""
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(times):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return mesh if times == 0 else dfd.Mesh(vertices, faces)
