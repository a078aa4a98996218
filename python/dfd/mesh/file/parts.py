"""The parts of a scene: which geometry stands where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

__all__ = ["MovedPart", "Part", "place"]

# More corners than this cannot be numbered with 32 bits once each face has three.
_MOST_ROWS = 2**31 // 3


@dataclass(frozen=True)
class Part:
    """One placing of one geometry in the scene; a geometry placed twice is two parts."""

    node: str
    name: str  # the geometry's name in the scene
    geometry: trimesh.Trimesh
    transform: NDArray[np.float64]  # (4, 4) from the geometry's own coordinates to the scene's
    rows: slice  # its vertices among all rows of the file
    faces: slice  # its faces among all faces

    @property
    def normals(self) -> NDArray[np.float64] | None:
        """(rows, 3) the file's normals, in the geometry's own coordinates; None where it has none."""
        # trimesh would make normals up when asked for `vertex_normals`; only those it read are in its cache
        normals = self.geometry._cache.cache.get("vertex_normals")
        return None if normals is None else np.asarray(normals)


@dataclass(frozen=True)
class MovedPart:
    """A part with its new shape, in its geometry's own coordinates."""

    part: Part
    vertices: NDArray[np.float64]  # (rows of the part, 3)
    normals: NDArray[np.float64] | None  # (rows of the part, 3), None where the file had none
    file_normals: NDArray[np.float64] | None  # those it had
    moved: bool  # whether any row differs from the file's


def place(path: Path, scene: trimesh.Scene, order: Mapping[str, Any]) -> tuple[tuple[Part, ...], NDArray[np.float64]]:
    """Return the parts with faces and the positions (R, 3) of their rows in the scene.

    `order` gives each node that shows a geometry a key to sort by.
    """
    parts: list[Part] = []
    positions: list[NDArray[np.float64]] = []
    row_count = face_count = 0
    for name, node, transform in _in_order(scene, order):
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh) or len(geometry.faces) == 0:
            continue
        _check(path, name, geometry, transform)
        rows = slice(row_count, row_count + len(geometry.vertices))
        faces = slice(face_count, face_count + len(geometry.faces))
        row_count, face_count = rows.stop, faces.stop
        if row_count > _MOST_ROWS:
            raise ValueError(f"load: `path` {path} must place at most {_MOST_ROWS} vertices, got {row_count} and more")
        parts.append(Part(str(node), name, geometry, transform, rows, faces))
        positions.append(_transformed(geometry.vertices.view(np.ndarray), transform))
    if not parts:
        raise ValueError(f"load: `path` {path} holds no faces")
    stacked = np.concatenate(positions)
    if not np.isfinite(stacked).all():
        raise ValueError(f"load: `path` {path} places vertices so far away that their coordinates are not finite")
    return tuple(parts), stacked


def _in_order(scene: trimesh.Scene, order: Mapping[str, Any]) -> list[tuple[str, str, NDArray[np.float64]]]:
    """Return (geometry, node, transform) in the file's order: trimesh's order turns round at every round trip."""
    nodes = sorted((node for node in scene.graph.nodes_geometry if node in order), key=lambda node: order[node])
    with np.errstate(over="ignore", invalid="ignore"):  # judged afterwards, part by part
        placed = [(node, *scene.graph[node]) for node in nodes]
    return [(name, node, transform) for node, transform, name in placed]


def _check(path: Path, name: str, geometry: trimesh.Trimesh, transform: NDArray[np.float64]) -> None:
    """Refuse coordinates that are not finite and faces of vertices that are not there."""
    vertices, faces = geometry.vertices.view(np.ndarray), geometry.faces.view(np.ndarray)
    finite = np.isfinite(vertices)
    if not finite.all():
        row, axis = np.argwhere(~finite)[0]
        raise ValueError(
            f"load: `path` {path} must hold finite coordinates, got {vertices[row, axis]} "
            f"at vertex {row} of part {name!r}"
        )
    if not np.isfinite(transform).all():
        raise ValueError(f"load: `path` {path} must place its parts by finite transforms, got part {name!r} without")
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        raise ValueError(
            f"load: `path` {path} must have faces between vertices 0 … {len(vertices) - 1} of part {name!r}, "
            f"got {low if low < 0 else high}"
        )


def _transformed(points: NDArray[np.float64], transform: NDArray[np.float64]) -> NDArray[np.float64]:
    if np.array_equal(transform, np.eye(4)):
        return points
    with np.errstate(over="ignore", invalid="ignore"):  # judged afterwards, for the whole scene at once
        return points @ transform[:3, :3].T + transform[:3, 3]
