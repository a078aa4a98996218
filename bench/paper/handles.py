"""Sets of handles as they lie on disk: APAP-Bench 3D.

One folder a shape::

    axe/mesh.obj
    axe/keypoints/000/user_single_keypoints.txt         or both texts beside mesh.obj
    axe/keypoints/000/constraint_single_keypoints.txt

Each line of a text is `vertex x y z`: the index of a `v` line of mesh.obj, counted from 0, and where that vertex is to
be; a line may come twice. The user's are handles and their targets, the constraints fixed points, which lie where they
are to be.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import dfd
from dfd.common.linear_algebra import Float64, Int64

USER, FIXED = "user_single_keypoints.txt", "constraint_single_keypoints.txt"
MESH = "mesh.obj"
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
    dense: bool = False  # whether `held` is enough as it is, without the neighbors of its points


def find(folder: Path) -> dict[str, Callable[[], Case]]:
    """Return the cases of `folder`, which is that of one shape or holds those of several, by name.

    Each reads its case, or raises ValueError or OSError, with the file's name, if it does not fit.

    Raises OSError if there is no such folder. Raises ValueError if no folder has a shape.
    """
    found: dict[str, Callable[[], Case]] = {}
    for shape in (folder.resolve(), *sorted(each for each in folder.iterdir() if each.is_dir())):
        mesh = shape / MESH
        if mesh.is_file():
            sets = sorted(each.parent for each in shape.glob(f"keypoints/*/{USER}"))
            if (shape / USER).is_file() or not sets:  # without any the missing file is what is told
                found[shape.name] = partial(read_apap, mesh, shape)
            found |= {f"{shape.name} {each.name}": partial(read_apap, mesh, each) for each in sets}
    if not found:
        raise ValueError(f"{folder} must hold folders with {MESH} and {USER}, found none")
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
