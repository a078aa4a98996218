"""What a mesh file holds: its scene as trimesh reads it, and where each part's own vertices lie in the whole."""

from __future__ import annotations

import codecs
import errno
import io
import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from dfd.mesh.appearance import Appearance
from dfd.mesh.file import gltf_header, gltf_patch, obj_read
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.materials import read_appearance
from dfd.mesh.file.parts import Part, place
from dfd.mesh.weld import weld

__all__ = ["ENDINGS", "SceneFile"]

ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")


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
    gltf: gltf_patch.GltfSource | None  # what a glTF file holds beside what trimesh reads of it
    appearance: Appearance | None  # what colours the parts; None where nothing is known

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Read `path`; raises what `dfd.load` raises."""
        self.path = Path(path)
        ending = self.path.suffix.lower()
        if ending not in ENDINGS:
            raise ValueError(f"load: `path` must end in {', '.join(ENDINGS)}, got {self.path}")
        data = _read_bytes(self.path)
        if ending == ".gltf":
            data = data.removeprefix(codecs.BOM_UTF8)
        assets = AssetFolder(self.path)
        self.header = gltf_header.read(self.path, data) if ending in (".glb", ".gltf") else None
        self.scene = _parse(self.path, data, ending, assets)
        places = gltf_patch.places(self.header, self.scene) if self.header is not None else None
        self.parts, positions = place(self.path, self.scene, places or _geometry_order(self.scene, ending))
        own_order = None
        if ending == ".obj" and len(self.parts) > 1:  # its parts share one list of vertices, in an order of its own
            own_order = obj_read.positions(data)
        self.corner_faces = np.concatenate(
            [part.geometry.faces.astype(np.int32) + np.int32(part.rows.start) for part in self.parts]
        )
        self.vertices, self.vertex = _weld_used(positions, self.corner_faces, own_order)
        if len(self.vertices) < 3:
            raise ValueError(
                f"load: `path` {self.path} must hold at least 3 distinct vertices, got {len(self.vertices)}"
            )
        self.appearance = read_appearance(self.scene, self.header, self.parts, self.vertex, assets.unreadable)
        self.gltf = None
        if self.header is not None and places is not None:
            of_parts = [places[part.node] for part in self.parts]
            self.gltf = gltf_patch.GltfSource.of(self.header, data, assets, of_parts)
        if assets.unreadable:
            names = ", ".join(sorted(assets.unreadable))
            warnings.warn(
                f"load: `path` {self.path} names {names}, which could not be read; what it would colour is grey",
                stacklevel=3,
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
    if ending == ".obj" and (found := obj_read.malformed(data)):
        raise ValueError(f"load: `path` {path} is not a well-formed OBJ file: {found}")
    options = {"split_objects": True} if ending == ".obj" else {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", message=".*could not be read to its end.*")  # NumPy, of cut-off numbers
            stream = io.BytesIO(data)
            scene = trimesh.load_scene(stream, file_type=ending[1:], resolver=assets, process=False, **options)
    except MemoryError as error:
        raise OSError(errno.ENOMEM, f"load: `path` {path} needs more memory than there is") from error
    except Exception as error:  # trimesh raises ten different types on malformed files
        reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise ValueError(f"load: `path` {path} is not a well-formed {kind} file ({reason})") from error
    return scene


def _geometry_order(scene: trimesh.Scene, ending: str) -> dict[str, tuple[int, str]]:
    """Return a key for each node that shows a geometry: trimesh lists those of an OBJ file from last to first."""
    names = list(scene.geometry)[:: -1 if ending == ".obj" else 1]
    number = {name: i for i, name in enumerate(names)}
    shown = {node: scene.graph.transforms.node_data[node]["geometry"] for node in scene.graph.nodes_geometry}
    return {node: (number[name], str(node)) for node, name in shown.items() if name in number}


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
