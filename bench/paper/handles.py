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
SAME = 1e-4  # of the diagonal: positions as near as that are one
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


@dataclass(frozen=True)
class Found:
    """A case that lies on disk; `read` raises ValueError or OSError, with the file and the line, if it does not fit."""

    name: str
    mesh: Path
    read: Callable[[], Case]


def find(folder: Path) -> list[Found]:
    """Return the cases of `folder`, which is that of one shape or holds those of several, in the order of their names.

    Raises OSError if there is no such folder. Raises ValueError if no folder has a shape in one of the layouts.
    """
    found = _in_shape(folder.resolve())
    for shape in sorted(each for each in folder.iterdir() if each.is_dir()):
        found += _in_shape(shape)
    if not found:
        raise ValueError(
            f"{folder} must hold folders with {APAP_MESH} and {USER}, or with {META_MESH} and {KEY_POINTS}; found none"
        )
    return found


def _in_shape(shape: Path) -> list[Found]:
    found = []
    mesh = shape / APAP_MESH
    if mesh.is_file():
        sets = sorted(each.parent for each in shape.glob(f"keypoints/*/{USER}"))
        if (shape / USER).is_file() or not sets:  # without any the missing file is what is told
            found.append(Found(shape.name, mesh, partial(read_apap, mesh, shape)))
        found += [Found(f"{shape.name} {each.name}", mesh, partial(read_apap, mesh, each)) for each in sets]
    if (shape / META_MESH).is_file():
        found.append(Found(shape.name, shape / META_MESH, partial(read_meta_handles, shape)))
    return found


def read_apap(path: Path, texts: Path) -> Case:
    """Read a case of APAP-Bench 3D: its mesh, and the folder of its two texts.

    Raises ValueError, which names file and line, if a line is not a vertex and its position, a vertex is not of a face
    or is to be at two positions, or a fixed point lies elsewhere than its vertex; OSError if a file cannot be read.
    """
    mesh = dfd.load(path)
    handles, targets, _ = _read_text(texts / USER, mesh, {})
    if not len(handles):
        raise ValueError(f"{texts / USER} must name at least one handle, got none")
    taken = {int(mesh.representative[vertex]): f"a handle of {USER}" for vertex in handles}
    fixed, positions, lines = _read_text(texts / FIXED, mesh, taken)
    for vertex, position, line in zip(fixed, positions, lines, strict=True):
        if np.linalg.norm(mesh.vertices[vertex] - position) > NEAR * mesh.diagonal:
            raise ValueError(
                f"{texts / FIXED}, line {line}: vertex {vertex} must stay at {_point(mesh.vertices[vertex])}, where it "
                f"is in {path.name}, got {_point(position)}: the file is of another mesh or order of vertices"
            )
    held = np.concatenate([handles, fixed])
    return Case(mesh, handles, targets, fixed, held, np.concatenate([targets, mesh.vertices[fixed]]))


def _read_text(path: Path, mesh: dfd.Mesh, taken: dict[int, str]) -> tuple[Int64, Float64, list[int]]:
    """Vertices (N,), their positions (N, 3) and the lines; `taken` says what vertices already are."""
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    taken = dict(taken)
    vertices: list[int] = []
    positions: list[list[float]] = []
    lines: list[int] = []
    for line, text in enumerate(path.read_text("utf-8", errors="replace").splitlines(), 1):
        if not text.strip():
            continue
        where = f"{path}, line {line}"
        words = text.split()
        try:
            vertex, position = int(words[0]), [float(word) for word in words[1:]]
        except ValueError:
            position = []
        if len(position) != 3 or not np.isfinite(position).all():
            raise ValueError(f"{where}: must read 'vertex x y z', got {text.strip()[:80]!r}")
        if not 0 <= vertex < len(mesh.vertices):
            raise ValueError(f"{where}: vertex must be one of 0 … {len(mesh.vertices) - 1}, got {vertex}")
        same = int(mesh.representative[vertex])
        if not used[same]:
            raise ValueError(f"{where}: vertex {vertex} must be a corner of a face, but no face of the mesh uses it")
        if (
            same in vertices
            and np.linalg.norm(np.subtract(positions[vertices.index(same)], position)) <= SAME * mesh.diagonal
        ):
            continue  # said twice, or once for each side of a seam
        if same in taken:
            raise ValueError(f"{where}: vertex {vertex} must go to one place, but it is {taken[same]}")
        taken[same] = f"that of line {line}, which goes elsewhere"
        vertices.append(same)
        positions.append(position)
        lines.append(line)
    return np.array(vertices, np.int64), np.array(positions, np.float64).reshape(-1, 3), lines


def read_meta_handles(folder: Path) -> Case:
    """Read a case of DeepMetaHandles, its handle being the control point with the largest offset of all.

    Raises ValueError if an array has another shape than the mesh and the control points ask for, or is not finite, or a
    control point lies away from the surface's vertices; the message names the file, and the line where it has lines.
    Raises OSError if a file cannot be read.
    """
    mesh = dfd.load(folder / META_MESH)
    corners = np.unique(mesh.faces)
    tree = KDTree(mesh.vertices[corners])
    positions = []
    lines = (folder / KEY_POINTS).read_text("utf-8", errors="replace").splitlines()
    for line, text in enumerate(lines, 1):
        words = text.split()
        if not words or words[0] != "v":
            continue
        where = f"{folder / KEY_POINTS}, line {line}"
        try:
            position = np.array([float(word) for word in words[1:4]])
        except ValueError:
            position = np.empty(0)
        if len(position) != 3 or not np.isfinite(position).all():
            raise ValueError(f"{where}: must read 'v x y z', got {text.strip()[:80]!r}")
        if tree.query(position)[0] > NEAR * mesh.diagonal:
            raise ValueError(f"{where}: must lie at a vertex of {META_MESH}, got {_point(position)}, away from all")
        positions.append(position)
    if not positions:
        raise ValueError(f"{folder / KEY_POINTS} must hold control points as 'v x y z', got none")
    held = corners[tree.query(np.array(positions))[1]].astype(np.int64)
    offsets = _largest(folder, len(positions))
    weights = folder / "w_mesh.npy"
    coordinates = _array(weights, (len(mesh.vertices), len(positions))) if weights.is_file() else None
    chosen = np.linalg.norm(offsets, axis=1).argmax()
    held_to = mesh.vertices[held] + offsets
    return Case(mesh, held[[chosen]], held_to[[chosen]], np.empty(0, np.int64), held, held_to, coordinates, dense=True)


def _largest(folder: Path, count: int) -> Float64:
    """(K, 3) offsets of the basis vector, at the end of its range, that takes a control point the farthest."""
    path = folder / "basis.npy"
    basis = _array(path, None)
    if basis.shape[1:] not in ((3 * count,), (count, 3)) or len(basis) == 0:
        raise ValueError(f"{path} must have shape (B, {3 * count}) or (B, {count}, 3), got {basis.shape}")
    basis = basis.reshape(len(basis), 1, count, 3)
    if (folder / "coef_range.npy").is_file():
        basis = basis * _array(folder / "coef_range.npy", (len(basis), 2))[:, :, None, None]
    ends = basis.reshape(-1, count, 3)
    return ends[np.linalg.norm(ends, axis=2).max(axis=1).argmax()]


def _array(path: Path, shape: tuple[int, ...] | None) -> Float64:
    try:
        with path.open("rb") as stream:
            values = np.lib.format.read_array(stream, allow_pickle=False).astype(np.float64)
    except (ValueError, TypeError, EOFError) as error:
        raise ValueError(f"{path} must be an .npy file of numbers, but is not: {error}") from None
    if shape is not None and values.shape != shape:
        raise ValueError(f"{path} must have shape {shape}, got {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError(f"{path} must be finite, got {values[~np.isfinite(values)][0]}")
    return values


def _point(position: Float64) -> str:
    return "(" + ", ".join(f"{each:.4g}" for each in position) + ")"
