"""Skin weights by other people's methods: distances inside the body, and weights bounded and biharmonic within it."""

from __future__ import annotations

from itertools import product

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

import dfd
from bench.paper.peers.tetrahedra import boundary, fill
from bench.quality.baselines import PeerError, bounded_weights, in_child
from dfd.common.linear_algebra import Float64, Int64
from dfd.export.bones import Bones

CELLS = 96  # along the longest side of the voxels' grid
SAMPLES = 32  # points on a bone
EDGE = 0.04  # of the diagonal: the length of tetrahedra's edges
PATIENCE = 900.0  # seconds for one rig


def geodesic_voxels(mesh: dfd.Mesh, bones: Bones, joints: NDArray[np.integer]) -> Float64:
    """(V, J) weights by distances through the body's voxels; Dionne and de Lasa, "Geodesic Voxel Binding", 2013.

    The body is what its surface's voxels close off. A bone outside it counts where the body is nearest. Where no way
    leads to a bone, the weight is 0; a vertex that no way leads to follows the bone nearest through space.
    """
    points, faces = _skin(mesh, bones)
    pitch = float(np.ptp(points, axis=0).max()) / CELLS
    grid = trimesh.Trimesh(points, faces, process=False).voxelized(pitch).fill("holes")
    cells = grid.sparse_indices
    centers = grid.points
    graph, tree = _neighbors(cells, grid.shape), KDTree(centers)
    here = tree.query(mesh.vertices)[1]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    weights = np.zeros((len(mesh.vertices), len(bones.names)))
    straight = np.full(weights.shape, np.inf)
    for joint in joints:
        inside = tree.query(_on_bones(bones, joint))[1]
        steps = dijkstra(graph, indices=np.unique(inside), min_only=True)[here]
        distance = np.maximum(steps, 0.5) * pitch / size
        weights[:, joint] = 1.0 / distance**4  # their α at 1, where the weights are nearest to the artists'
        straight[:, joint] = KDTree(_on_bones(bones, joint)).query(mesh.vertices)[0]
    lost = np.flatnonzero(weights.sum(axis=1) == 0)
    weights[lost, straight[lost].argmin(axis=1)] = 1.0
    return weights / weights.sum(axis=1, keepdims=True)


def bounded_biharmonic(mesh: dfd.Mesh, bones: Bones, joints: NDArray[np.integer]) -> Float64:
    """(V, J) bounded biharmonic weights of libigl, within tetrahedra; Jacobson et al., 2011.

    Rigs are seldom closed and cross themselves: fTetWild fills them with tetrahedra all the same. Bones are the nodes
    nearest to them; a vertex has the weights of the tetrahedra's surface where it is nearest.

    Raises PeerError if libigl or `wildmeshing` is not installed, one of them fails or crashes, or both take too long.
    """
    points, faces = _skin(mesh, bones)
    samples = [_on_bones(bones, joint) for joint in joints]
    weights = np.zeros((len(mesh.vertices), len(bones.names)))
    weights[:, joints] = in_child(_bounded, points, faces, samples, mesh.vertices, seconds=PATIENCE)
    if not np.isfinite(weights).all() or (weights.sum(axis=1) <= 0).any():
        raise PeerError("leaves vertices without weight")
    return weights / weights.sum(axis=1, keepdims=True)


def _skin(mesh: dfd.Mesh, bones: Bones) -> tuple[Float64, Int64]:
    """The vertices and faces of the parts that have the skin."""
    used, faces = np.unique(np.concatenate([mesh.faces[each.faces] for each in bones.primitives]), return_inverse=True)
    return mesh.vertices[used], faces.reshape(-1, 3).astype(np.int64)


def _on_bones(bones: Bones, joint: int) -> Float64:
    """(N, 3) points on the bones of a joint."""
    own = bones.joint == joint
    along = np.linspace(0.0, 1.0, SAMPLES)[:, None, None]
    return ((1.0 - along) * bones.starts[own] + along * bones.ends[own]).reshape(-1, 3)


def _neighbors(cells: NDArray[np.integer], shape: tuple[int, ...]) -> csr_array:
    """The graph of cells (N, 3) with their 26 neighbors, lengths in cells."""
    number = np.full(np.array(shape) + 2, -1, np.int64)
    number[tuple(cells.T + 1)] = np.arange(len(cells))
    rows, columns, lengths = [], [], []
    for step in product((-1, 0, 1), repeat=3):
        if step <= (0, 0, 0):
            continue
        there = number[tuple(cells.T + 1 + np.array(step)[:, None])]
        known = np.flatnonzero(there >= 0)
        rows.append(known)
        columns.append(there[known])
        lengths.append(np.full(len(known), np.linalg.norm(step)))
    half = coo_array(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(len(cells), len(cells))
    ).tocsr()
    return half + half.T


def _bounded(points: Float64, faces: Int64, samples: list[Float64], vertices: Float64) -> Float64:
    """(V, J) weights at `vertices`, of bones that are points (N, 3) each; in a process of its own."""
    nodes, tetrahedra = fill(points, faces, EDGE)
    tree = KDTree(nodes)
    nearest: dict[int, tuple[float, int]] = {}  # of each node that a bone comes near, the distance and the bone
    for bone, each in enumerate(samples):
        for distance, node in zip(*tree.query(each), strict=True):
            nearest[node] = min(nearest.get(node, (np.inf, -1)), (float(distance), bone))
    known = np.array(sorted(nearest), np.int64)
    ones = np.eye(len(samples))[[nearest[node][1] for node in known]]
    there = np.flatnonzero(ones.any(axis=0))  # a bone shorter than an edge may have no node of its own
    solved = bounded_weights(nodes, tetrahedra, known, ones[:, there])
    weights = np.zeros((len(vertices), len(samples)))
    corners, barycentric, _ = boundary(nodes, tetrahedra, vertices)
    weights[:, there] = np.einsum("vk,vkj->vj", barycentric, solved[corners]).clip(0.0, 1.0)
    return weights
