"""The scene of a mesh file: its parts, the mesh vertex of each row, and the source for rewriting the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64, Int32, Int64, UInt8
from dfd.mesh.appearance import Appearance
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.materials import read_appearance
from dfd.mesh.file.primitives import MeshInstance, Primitive, place, require_finite
from dfd.mesh.weld import weld


@dataclass(frozen=True)
class FileSource:
    """The source for rewriting an OBJ, PLY, STL or OFF file with other positions; rewriting parses it again."""

    data: UInt8  # (N,) its bytes; processes can share an array
    numbers: Int64 | None = None  # (R,) the file's own vertex of each row; None for STL files, which number no vertices
    corner_rows: Int32 | None = None  # (C,) row of each corner of an OBJ file's faces; −1 in a face of too few corners


@dataclass(frozen=True)
class SceneFile:
    """A file's scene, kept for coloring and rewriting.

    Rows are the concatenated vertices of the primitives: the file's own vertices, split along seams of texture or
    normals. A vertex of the mesh represents all rows at its position.
    """

    path: Path | None
    primitives: tuple[Primitive, ...]
    corner_faces: Int32  # (F, 3) corners as row numbers
    vertices: Float64  # (V, 3) positions in the scene
    representative: Int32  # (V,) the first vertex at each vertex's position
    vertex: Int32  # (R,) the vertex that represents each row, -1 without one
    appearance: Appearance | None  # the colors of the faces; None if unknown
    gltf: GltfData | None = None  # the source glTF file
    source: FileSource | None = None  # the source file of another format

    @property
    def ending(self) -> str:
        """The ending of the file's name in lower case; "" for a scene without a file."""
        return self.path.suffix.lower() if self.path else ""

    def local_faces(self, primitive: Primitive) -> Int32:
        """Return the faces (F, 3) of a primitive as indices of its own rows, with the winding of the scene."""
        return self.corner_faces[primitive.faces] - np.int32(primitive.rows.start)

    @property
    def faces(self) -> Int32:
        """Return the corners (F, 3) of faces as vertices of the mesh."""
        return self.vertex[self.corner_faces]

    @classmethod
    def of(
        cls,
        path: Path | None,
        instances: Sequence[MeshInstance],
        *,
        own_vertices: Float64 | None = None,
        gltf: GltfData | None = None,
        source: FileSource | None = None,
    ) -> SceneFile:
        """Return the scene of a file's instances, with numbered vertices.

        `own_vertices` (V, 3) is the file's own list of vertices. `source.numbers` maps rows to this list; without a
        `source`, every row is a vertex. Without a list, distinct positions that faces use are numbered in the order of
        the rows.

        Raises ArgumentError if there are no faces or fewer than three distinct vertices, or a number is not finite.
        """
        primitives, positions = place(instances)
        numbered = []
        for each in primitives:
            faces = each.geometry.faces.astype(np.int32) + np.int32(each.rows.start)
            # A mirroring transform reverses the winding of triangles: glTF 2.0, section 3.7.4.
            numbered.append(faces[:, [0, 2, 1]] if each.mirrored else faces)
        corner_faces = np.concatenate(numbered)
        if own_vertices is not None:
            require_finite(own_vertices)
            first, distinct = weld(own_vertices)
            representative = first.astype(np.int32)[distinct]
            numbers = slice(None) if source is None or source.numbers is None else source.numbers
            vertices, vertex = own_vertices, representative[numbers]
        else:
            vertices, vertex = _weld_used(positions, corner_faces)
            representative = np.arange(len(vertices), dtype=np.int32)
        used = np.zeros(len(vertices), bool)
        used[vertex[corner_faces]] = True
        if used.sum() < 3:
            raise ArgumentError("path", f"must hold at least 3 distinct vertices, got {used.sum()}")
        appearance = read_appearance(primitives, vertex, corner_faces)
        return cls(path, primitives, corner_faces, vertices, representative, vertex, appearance, gltf, source)


def _weld_used(positions: Float64, corner_faces: Int32) -> tuple[Float64, Int32]:
    """Return the distinct positions (V, 3) that faces use, and the vertex (R,) of each row, -1 for unused rows."""
    first, vertex = weld(positions)
    used = np.zeros(len(first), bool)
    used[vertex[corner_faces]] = True
    if used.all():
        return positions[first], vertex
    number = np.where(used, np.cumsum(used, dtype=np.int32) - np.int32(1), np.int32(-1))
    return positions[first[used]], number[vertex]
