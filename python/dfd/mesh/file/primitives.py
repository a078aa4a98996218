"""What a scene shows: geometries of one material each, in their places, as parts with names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

# trimesh takes most of a second to import; what has no looks is read without.
if TYPE_CHECKING:
    import trimesh

__all__ = ["BareGeometry", "Geometry", "MeshInstance", "MovedPrimitive", "Primitive", "UniqueNames", "place"]

# Rows and faces that a scene may place: a file of a few kilobytes can name any number of them.
_MOST_ROWS = 10**8


@dataclass(frozen=True, eq=False)
class BareGeometry:
    """What a trimesh geometry is to a scene, of a shape without materials, textures and colors."""

    vertices: NDArray[np.float64]  # (N, 3)
    faces: NDArray[np.int64]  # (F, 3)
    normals: NDArray[np.float64] | None  # (N, 3) the file's own

    visual = None

    def to_trimesh(self) -> trimesh.Trimesh:
        """Return the same shape as trimesh has it."""
        import trimesh

        return trimesh.Trimesh(self.vertices, self.faces, vertex_normals=self.normals, process=False)


Geometry: TypeAlias = "trimesh.Trimesh | BareGeometry"


@dataclass(frozen=True)
class MeshInstance:
    """One geometry of one material, and where the scene shows it; one that is shown twice is placed twice."""

    part: str  # the scene's part that it belongs to; equal names that follow each other are one part
    name: str  # the geometry's own name
    geometry: Geometry
    transform: NDArray[np.float64] | None = None  # (4, 4) from the geometry's coordinates to the scene's
    source: tuple[int, int, int] = (0, 0, 0)  # node, mesh and primitive of a glTF file


@dataclass(frozen=True)
class Primitive:
    """A placing with its share of the rows and faces of the file."""

    part: str
    name: str
    geometry: Geometry
    transform: NDArray[np.float64]  # (4, 4) from the geometry's own coordinates to the scene's
    source: tuple[int, int, int]
    rows: slice  # its vertices among all rows of the file
    faces: slice  # its faces among all faces

    @property
    def normals(self) -> NDArray[np.float64] | None:
        """(rows, 3) the file's normals, in the geometry's own coordinates; None where it has none."""
        if isinstance(self.geometry, BareGeometry):
            return self.geometry.normals
        # trimesh would make normals up when asked for `vertex_normals`; only those it was given are in its cache
        normals = self.geometry._cache.cache.get("vertex_normals")
        return None if normals is None else np.asarray(normals)


@dataclass(frozen=True)
class MovedPrimitive:
    """A primitive with its new shape, in its geometry's own coordinates."""

    primitive: Primitive
    vertices: NDArray[np.float64]  # (rows of the primitive, 3)
    normals: NDArray[np.float64] | None  # (rows of the primitive, 3), None where the file had none
    file_normals: NDArray[np.float64] | None  # those it had
    moved: bool  # whether any row differs from the file's


def place(path: Path, instances: Sequence[MeshInstance]) -> tuple[tuple[Primitive, ...], NDArray[np.float64]]:
    """Return the primitives that have faces and the positions (R, 3) of their rows in the scene.

    Raises
    ------
    ValueError
        If there are no faces, or coordinates are not finite, or a face names a vertex that is not there.
    """
    primitives: list[Primitive] = []
    positions: list[NDArray[np.float64]] = []
    row_count = face_count = 0
    checked: dict[int, tuple[NDArray[np.float64], int]] = {}
    identity = np.eye(4)
    for each in instances:
        geometry = each.geometry
        if id(geometry) not in checked:
            checked[id(geometry)] = _checked(path, each.name, geometry)
        vertices, size = checked[id(geometry)]
        if size == 0:
            continue
        if each.transform is not None and not np.isfinite(each.transform).all():
            raise ValueError(
                f"load: `path` {path} must place its parts by finite transforms, got {each.part!r} without"
            )
        rows = slice(row_count, row_count + len(vertices))
        faces = slice(face_count, face_count + size)
        row_count, face_count = rows.stop, faces.stop
        if max(row_count, face_count) > _MOST_ROWS:
            raise ValueError(f"load: `path` {path} places more than {_MOST_ROWS} vertices or faces")
        transform = identity if each.transform is None else each.transform
        primitives.append(Primitive(each.part, each.name, geometry, transform, each.source, rows, faces))
        positions.append(vertices if transform is identity else _transformed(vertices, transform))
    if not primitives:
        raise ValueError(f"load: `path` {path} holds no faces")
    stacked = np.concatenate(positions)
    if not np.isfinite(stacked).all():
        raise ValueError(f"load: `path` {path} places vertices so far away that their coordinates are not finite")
    return tuple(primitives), stacked


def _checked(path: Path, name: str, geometry: Geometry) -> tuple[NDArray[np.float64], int]:
    """Return the vertices and the number of faces of a geometry.

    Coordinates that are not finite and faces of vertices that are not there are refused.
    """
    vertices, faces = geometry.vertices.view(np.ndarray), geometry.faces.view(np.ndarray)
    if len(faces) == 0:
        return vertices, 0
    finite = np.isfinite(vertices)
    if not finite.all():
        row, axis = np.argwhere(~finite)[0]
        raise ValueError(
            f"load: `path` {path} must hold finite coordinates, got {vertices[row, axis]} at vertex {row} of {name!r}"
        )
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(vertices):
        raise ValueError(
            f"load: `path` {path} must have faces between vertices 0 … {len(vertices) - 1} of {name!r}, "
            f"got {low if low < 0 else high}"
        )
    return vertices, len(faces)


def _transformed(points: NDArray[np.float64], transform: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(over="ignore", invalid="ignore"):  # judged afterwards, for the whole scene at once
        return points @ transform[:3, :3].T + transform[:3, 3]


class UniqueNames:
    """Makes names unique in constant time, however many are alike."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._next: dict[str, int] = {}

    def unique(self, name: str) -> str:
        """Return `name`, with a number where it has been given out."""
        found = name
        while found in self._taken:
            self._next[name] = self._next.get(name, 0) + 1
            found = f"{name}_{self._next[name]}"
        self._taken.add(found)
        return found
