"""The mesh: distinct positions, triangles between them, and what is needed to look at it and to save it again."""

from __future__ import annotations

import hashlib
import os
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.mesh.appearance import Appearance
from dfd.mesh.file.parts import Part
from dfd.mesh.file.read import SceneFile
from dfd.mesh.file.write import write
from dfd.mesh.normals import smooth_normals

__all__ = ["Mesh", "load"]


class Mesh:
    """A triangle mesh that never changes: its arrays are read-only, and a moved mesh is another array of positions.

    A mesh that comes from a file (see `load`) holds each position once, whatever seams its texture or normals have.
    """

    vertices: NDArray[np.float64]  # (V, 3) positions in the file's units
    faces: NDArray[np.int32]  # (F, 3) corners as indices into `vertices`
    appearance: Appearance | None  # what colours the surface; None where nothing is known
    source: Path | None  # the file it was read from

    def __init__(
        self,
        vertices: Any,
        faces: Any,
        *,
        appearance: Appearance | None = None,
        scene: SceneFile | None = None,
    ) -> None:
        """Check and keep the arrays.

        Parameters
        ----------
        vertices
            (V, 3) finite positions, at least three.
        faces
            (F, 3) vertex indices, at least one face; faces without area and repeated faces are kept.
        appearance
            Colours and textures of the faces.
        scene
            The file's own scene, which `save` writes again.

        Raises
        ------
        ValueError
            If an array has another shape or type, a coordinate is not finite or an index is out of range.
        """
        self.vertices = _frozen(check.array("Mesh", "vertices", vertices, ("V", 3), dtype=np.float64))
        if len(self.vertices) < 3:
            raise ValueError(f"Mesh: `vertices` must hold at least 3 vertices, got {len(self.vertices)}")
        self.faces = _frozen(_checked_faces(faces, len(self.vertices)))
        self.appearance = appearance
        self.source = scene.path if scene else None
        self._scene = scene

    def __repr__(self) -> str:
        name = f"{self.source.name}: " if self.source else ""
        return f"Mesh({name}{len(self.vertices)} vertices, {len(self.faces)} faces)"

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) smallest and largest coordinates."""
        return _frozen(np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)]))

    @cached_property
    def extents(self) -> NDArray[np.float64]:
        """(3,) lengths of the sides of the box around the mesh."""
        return _frozen(self.bounds[1] - self.bounds[0])

    @property
    def scene(self) -> SceneFile | None:
        """The scene of the file it was read from; None for a mesh made from arrays."""
        return self._scene

    @property
    def part_count(self) -> int:
        """How many parts the scene of its file has; 1 for a mesh made from arrays."""
        return len(self._scene.parts) if self._scene else 1

    @property
    def part_names(self) -> tuple[str, ...]:
        """The names of the parts of its file's scene, in their order, once each; none for a mesh made from arrays."""
        return tuple(dict.fromkeys(name for part in self._parts for name in (part.node, part.name)))

    def part_vertices(self, name: str) -> NDArray[np.int64]:
        """(N,) ascending, the vertices of the parts of that name: a node of the scene, or a geometry wherever it is.

        Raises
        ------
        ValueError
            If the scene has no part of that name; the message lists those it has.
        """
        named = [part for part in self._parts if name in (part.node, part.name)]
        if not named or self._scene is None:
            known = ", ".join(self.part_names[:20]) or "none"
            raise ValueError(f"Mesh.part_vertices: `name` must be a part of the scene ({known}), got {name!r}")
        rows = np.concatenate([self._scene.vertex[part.rows] for part in named])
        return np.unique(rows[rows >= 0]).astype(np.int64)

    @property
    def _parts(self) -> tuple[Part, ...]:
        return self._scene.parts if self._scene else ()

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of the box around the mesh."""
        return float(np.linalg.norm(self.extents))

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """(V, 3) smooth unit normals, faces weighted by area; zero where a vertex has no face with an area."""
        return _frozen(smooth_normals(self.vertices, self.faces))

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of vertices, faces and appearance, as 64 hexadecimal digits: what a cache may key on."""
        digest = hashlib.sha256()
        for values in (self.vertices, self.faces):
            digest.update(f"{values.shape}".encode())
            digest.update(values.data)
        if self.appearance is not None:
            self.appearance.update_hash(digest)
        return digest.hexdigest()

    def save(self, path: str | os.PathLike[str], vertices: Any | None = None) -> None:
        """Write the mesh, with its vertices moved to `vertices` (V, 3) when given, in the format of the ending.

        A mesh that came from a file keeps that file's parts, names, materials, UVs, textures, colours and units as far
        as the format has room for them; normals follow the moved surface. The file is whole or absent.

        Raises
        ------
        ValueError
            If the ending is none of .obj, .ply, .stl, .off, .glb and .gltf, or `vertices` has another shape or is not
            finite.
        OSError
            If the file cannot be written; what was there before stays.
        """
        moved = self.vertices
        if vertices is not None:
            moved = check.array("Mesh.save", "vertices", vertices, self.vertices.shape, dtype=np.float64)
        write(path, moved, self.faces, appearance=self.appearance, scene=self._scene)


def load(path: str | os.PathLike[str]) -> Mesh:
    """Read a mesh from an OBJ, PLY, STL, OFF, GLB or glTF file.

    All parts of a scene are taken, in their places; vertices that share a position become one, in the order in which
    the file has them, and vertices no face uses are left out. Nothing else is changed: units, orientation, faces
    without area and repeated faces stay.

    Raises
    ------
    OSError
        If the file cannot be opened.
    ValueError
        If the file is empty, malformed, in an unknown format, or holds no faces, a face index out of range or a
        coordinate that is not finite.

    Warns
    -----
    UserWarning
        If a texture or materials file cannot be read; what it would colour is shown grey.
    """
    scene = SceneFile(path)
    return Mesh(scene.vertices, scene.vertex[scene.corner_faces], appearance=scene.appearance, scene=scene)


def _checked_faces(faces: Any, vertex_count: int) -> NDArray[np.int32]:
    indices = np.asarray(faces)
    if indices.dtype.kind not in "iu" or indices.ndim != 2 or indices.shape[1] != 3:
        raise ValueError(
            f"Mesh: `faces` must be whole numbers of shape (F, 3), got {indices.dtype} of shape {indices.shape}"
        )
    if len(indices) == 0:
        raise ValueError("Mesh: `faces` must hold at least one face, got none")
    low, high = int(indices.min()), int(indices.max())
    if low < 0 or high >= vertex_count:
        raise ValueError(f"Mesh: `faces` must name vertices 0 … {vertex_count - 1}, got {low if low < 0 else high}")
    return np.ascontiguousarray(indices, dtype=np.int32)


def _frozen(values: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy."""
    values = values.copy()
    values.flags.writeable = False
    return values
