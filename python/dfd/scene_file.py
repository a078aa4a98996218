"""What a mesh file holds: its scene as trimesh reads it, and where each part's own vertices lie in the whole."""

from __future__ import annotations

import errno
import io
import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from dfd import gltf_header, obj_text
from dfd.asset_folder import AssetFolder
from dfd.weld import weld

__all__ = ["ENDINGS", "Part", "SceneFile"]

ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")

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


class SceneFile:
    """A file's scene, kept as it was read so that it can be coloured and written again.

    `rows` are the vertices of the parts, one after the other: the file's own vertices, split where a seam of texture
    or normals splits them. Distinct positions among them become the vertices of the mesh.
    """

    path: Path
    scene: trimesh.Scene
    header: dict[str, Any] | None  # the JSON header of a glTF file
    parts: tuple[Part, ...]
    corner_faces: NDArray[np.int32]  # (F, 3) corners as row numbers
    vertices: NDArray[np.float64]  # (V, 3) distinct positions in the scene, each used by a face
    vertex: NDArray[np.int32]  # (R,) the vertex each row is at, -1 for a row that no face uses

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Read `path`; raises what `dfd.load` raises."""
        self.path = Path(path)
        ending = self.path.suffix.lower()
        if ending not in ENDINGS:
            raise ValueError(f"load: `path` must end in {', '.join(ENDINGS)}, got {self.path}")
        data = _read_bytes(self.path)
        assets = AssetFolder(self.path)
        self.header = gltf_header.read(self.path, data) if ending in (".glb", ".gltf") else None
        self.scene = _parse(self.path, data, ending, assets)
        self.parts, positions = _place(self.path, self.scene)
        own_order = None
        if ending == ".obj" and len(self.parts) > 1:  # its parts share one list of vertices, in an order of its own
            own_order = obj_text.positions(data)
        self.corner_faces = np.concatenate(
            [part.geometry.faces.astype(np.int32) + np.int32(part.rows.start) for part in self.parts]
        )
        self.vertices, self.vertex = _weld_used(positions, self.corner_faces, own_order)
        if len(self.vertices) < 3:
            raise ValueError(
                f"load: `path` {self.path} must hold at least 3 distinct vertices, got {len(self.vertices)}"
            )
        if assets.unreadable:
            names = ", ".join(sorted(assets.unreadable))
            warnings.warn(
                f"load: `path` {self.path} names {names}, which could not be read; what it would colour is grey",
                stacklevel=4,
            )


def _read_bytes(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file():
            raise OSError(errno.EINVAL, "it is not a file")
        data = path.read_bytes()
    except OSError as error:
        raise OSError(error.errno, f"load: `path` {path} could not be read: {error.strerror}") from error
    if not data:
        raise ValueError(f"load: `path` {path} is empty")
    return data


def _parse(path: Path, data: bytes, ending: str, assets: AssetFolder) -> trimesh.Scene:
    """Let trimesh read the file; whatever it trips over becomes one ValueError."""
    kind = ending[1:].upper()
    if ending == ".obj" and (found := obj_text.malformed(data)):
        raise ValueError(f"load: `path` {path} is not a well-formed OBJ file: {found}")
    options = {"split_objects": True} if ending == ".obj" else {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", message=".*could not be read to its end.*")  # NumPy, of cut-off numbers
            scene = trimesh.load_scene(io.BytesIO(data), file_type=ending[1:], resolver=assets, process=False, **options)
    except MemoryError as error:
        raise OSError(errno.ENOMEM, f"load: `path` {path} needs more memory than there is") from error
    except Exception as error:  # trimesh raises ten different types on malformed files
        reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise ValueError(f"load: `path` {path} is not a well-formed {kind} file ({reason})") from error
    return scene


def _place(path: Path, scene: trimesh.Scene) -> tuple[tuple[Part, ...], NDArray[np.float64]]:
    """Return the parts with faces, in the scene's order, and the positions (R, 3) of their rows in the scene."""
    parts: list[Part] = []
    positions: list[NDArray[np.float64]] = []
    row_count = face_count = 0
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
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


def _weld_used(
    positions: NDArray[np.float64], corner_faces: NDArray[np.int32], own_order: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return the distinct positions (V, 3) that faces use and the vertex (R,) of each row, -1 where none uses it.

    They keep the order in which they first occur in `own_order`, when it is given, and then in `positions`.
    """
    stacked = positions if own_order is None else np.concatenate([own_order, positions])
    first, vertex = weld(stacked)
    vertex = vertex[len(stacked) - len(positions) :]
    used = np.zeros(len(first), bool)
    used[vertex[corner_faces]] = True
    if used.all():
        return stacked[first], vertex
    number = np.where(used, np.cumsum(used, dtype=np.int32) - np.int32(1), np.int32(-1))
    return stacked[first[used]], number[vertex]
