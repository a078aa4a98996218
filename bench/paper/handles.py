"""Sets of handles as they lie on disk: APAP-Bench 3D, and DeepMetaHandles with what its network predicted.

APAP-Bench 3D, one folder a shape::

    axe/mesh.obj
    axe/keypoints/000/user_single_keypoints.txt         or both texts beside mesh.obj
    axe/keypoints/000/constraint_single_keypoints.txt

Each line of a text is `vertex x y z`: the index of a `v` line of mesh.obj, counted from 0, and where that vertex is to
be; a line may come twice. The user's are handles and their targets, the constraints fixed points, which lie where they
are to be.

DeepMetaHandles, one folder a shape, as its demo has them::

    104256/manifold.obj, 104256/key_point_50.obj        the shape, and its control points as `v` lines
    104256/w_mesh.npy                                   (V, K) biharmonic coordinates; may be absent
    104256/basis.npy                                    (B, 3 K) or (B, K, 3) offsets of the control points
    104256/coef_range.npy                               (B, 2) from and to which factor of each; may be absent

Its files hold no deformations: basis.npy and coef_range.npy are assumed to be what its network returns for the shape,
saved by whoever ran it. As in the paper (Sec. 4) the largest offset is taken: the one control point that goes farthest,
at the far end of its basis vector, is our handle; the other methods are given all control points of that vector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

import dfd
from dfd.common.linear_algebra import Float64, Int64

USER, FIXED = "user_single_keypoints.txt", "constraint_single_keypoints.txt"
APAP_MESH, META_MESH, KEY_POINTS = "mesh.obj", "manifold.obj", "key_point_50.obj"
NEAR = 0.01  # of the diagonal: farther away a point of a file does not belong to the mesh


@dataclass(frozen=True)
class Case:
    """One shape and what is to be done to it."""

    mesh: dfd.Mesh
    handles: Int64  # (H,) vertices
    targets: Float64  # (H, 3) where they are to be, mesh units
    fixed: Int64  # (K,) vertices that stay
    held: Int64  # (C,) vertices that methods with constraints are given
    held_to: Float64  # (C, 3) where those are to be, mesh units
    coordinates: Float64 | None = None  # (V, C) biharmonic coordinates of the set's own
    dense: bool = False  # whether `held` is enough as it is, without the neighbors of its points


def find(folder: Path) -> dict[str, Callable[[], Case]]:
    """Return the cases of `folder`, which is that of one shape or holds those of several, by name.

    Each reads its case, or raises ValueError or OSError, with the file's name, if it does not fit.

    Raises OSError if there is no such folder. Raises ValueError if no folder has a shape in one of the layouts.
    """
    found: dict[str, Callable[[], Case]] = {}
    for shape in (folder.resolve(), *sorted(each for each in folder.iterdir() if each.is_dir())):
        mesh = shape / APAP_MESH
        if mesh.is_file():
            sets = sorted(each.parent for each in shape.glob(f"keypoints/*/{USER}"))
            if (shape / USER).is_file() or not sets:  # without any the missing file is what is told
                found[shape.name] = partial(read_apap, mesh, shape)
            found |= {f"{shape.name} {each.name}": partial(read_apap, mesh, each) for each in sets}
        if (shape / META_MESH).is_file():
            found[shape.name] = partial(read_meta_handles, shape)
    if not found:
        raise ValueError(
            f"{folder} must hold folders with {APAP_MESH} and {USER}, or with {META_MESH} and {KEY_POINTS}; found none"
        )
    return found


def read_apap(path: Path, texts: Path) -> Case:
    """Read a case of APAP-Bench 3D: its mesh, and the folder of its two texts.

    Raises ValueError, which names the file, if a line is not a vertex and its position, a vertex is not of a face or is
    to be at two positions, or a fixed point lies elsewhere than its vertex; OSError if a file cannot be read.
    """
    mesh = dfd.load(path)
    handles, targets = _read_text(texts / USER, mesh)
    if not len(handles):
        raise ValueError(f"{texts / USER} must name at least one handle, got none")
    fixed, positions = _read_text(texts / FIXED, mesh)
    if len(both := np.intersect1d(handles, fixed)):
        raise ValueError(f"{texts / FIXED}: vertex {both[0]} must go to one place, but it is a handle of {USER}")
    away = np.linalg.norm(mesh.vertices[fixed] - positions, axis=1) > NEAR * mesh.diagonal
    if away.any():
        raise ValueError(
            f"{texts / FIXED}: vertex {fixed[away][0]} lies elsewhere in {path.name}, another mesh or order"
        )
    held = np.concatenate([handles, fixed])
    return Case(mesh, handles, targets, fixed, held, np.concatenate([targets, mesh.vertices[fixed]]))


def _read_text(path: Path, mesh: dfd.Mesh) -> tuple[Int64, Float64]:
    """Return the distinct vertices (N,) and their positions (N, 3); sides of a seam are the vertex that faces name."""
    lines = [line.split() for line in path.read_text("utf-8", errors="replace").splitlines() if line.strip()]
    try:
        rows = np.array([[int(line[0]), *map(float, line[1:])] for line in lines]).reshape(-1, 4)
    except ValueError:
        rows = np.full((1, 4), np.nan)
    if not np.isfinite(rows).all():
        raise ValueError(f"{path}: every line must read 'vertex x y z'")
    vertices, positions = rows[:, 0].astype(np.int64), rows[:, 1:]
    if len(rows) and not 0 <= vertices.min() <= vertices.max() < len(mesh.vertices):
        raise ValueError(f"{path}: vertices must be of 0 … {len(mesh.vertices) - 1}, got {vertices.max()}")
    vertices = mesh.representative[vertices].astype(np.int64)
    if not np.isin(vertices, mesh.faces).all():
        raise ValueError(f"{path}: vertices must be corners of faces")
    _, first, group = np.unique(vertices, return_index=True, return_inverse=True)
    if np.abs(positions - positions[first][group]).max(initial=0.0) > 1e-4 * mesh.diagonal:
        raise ValueError(f"{path}: a vertex must go to one place")
    order = np.sort(first)
    return vertices[order], positions[order]


def read_meta_handles(folder: Path) -> Case:
    """Read a case of DeepMetaHandles, its handle being the control point with the largest offset of all.

    Raises ValueError, which names the file, if an array has another shape than the mesh and the control points ask for,
    or is not finite, or a control point lies away from the surface's vertices. Raises OSError if a file cannot be read.
    """
    mesh = dfd.load(folder / META_MESH)
    corners = np.unique(mesh.faces)
    path = folder / KEY_POINTS
    words = (line.split() for line in path.read_text("utf-8", errors="replace").splitlines())
    try:
        points = np.array([list(map(float, each[1:4])) for each in words if each[:1] == ["v"]]).reshape(-1, 3)
    except ValueError:
        points = np.empty((0, 3))
    if not len(points) or not np.isfinite(points).all():
        raise ValueError(f"{path} must hold control points as 'v x y z'")
    distance, nearest = KDTree(mesh.vertices[corners]).query(points)
    if distance.max() > NEAR * mesh.diagonal:
        raise ValueError(f"{path}: control points must lie at vertices of {META_MESH}, got {points[distance.argmax()]}")
    held = corners[nearest].astype(np.int64)
    offsets = _largest(folder, len(points))
    weights = folder / "w_mesh.npy"
    coordinates = _array(weights, (len(mesh.vertices), len(points))) if weights.is_file() else None
    chosen = np.linalg.norm(offsets, axis=1).argmax()
    held_to = mesh.vertices[held] + offsets
    return Case(mesh, held[[chosen]], held_to[[chosen]], np.empty(0, np.int64), held, held_to, coordinates, dense=True)


def _largest(folder: Path, count: int) -> Float64:
    """Return (K, 3) offsets of the basis vector, at the end of its range, that takes a control point the farthest."""
    path = folder / "basis.npy"
    basis = _array(path)
    if basis.shape[1:] not in ((3 * count,), (count, 3)) or len(basis) == 0:
        raise ValueError(f"{path} must have shape (B, {3 * count}) or (B, {count}, 3), got {basis.shape}")
    basis = basis.reshape(len(basis), 1, count, 3)
    if (folder / "coef_range.npy").is_file():
        basis = basis * _array(folder / "coef_range.npy", (len(basis), 2))[:, :, None, None]
    ends = basis.reshape(-1, count, 3)
    return ends[np.linalg.norm(ends, axis=2).max(axis=1).argmax()]


def _array(path: Path, shape: tuple[int, ...] | None = None) -> Float64:
    values = np.load(path, allow_pickle=False).astype(np.float64)
    if (shape is not None and values.shape != shape) or not np.isfinite(values).all():
        raise ValueError(f"{path} must be finite numbers of shape {shape or values.shape}, got {values.shape}")
    return values
