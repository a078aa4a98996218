"""Triangle geometries, each with a single material, and their instances in a scene."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64, unit
from dfd.mesh.appearance import Material
from dfd.mesh.file.text import shortened

MOST_ROWS = 10**8  # largest number of vertices or faces in a scene; a small file with many instances can exceed it
MOST_PRIMITIVES = 20_000  # largest number of primitives that are read from a glTF file; to read more would take seconds
MOST_INSTANCES = 100_000  # largest number of instances of primitives in the scene of a glTF file

IDENTITY = np.eye(4)  # the default transform; code recognizes this object with `is`
IDENTITY.setflags(write=False)


@dataclass(frozen=True, eq=False)
class Geometry:
    """Triangles of one material, in local coordinates."""

    vertices: Float64  # (N, 3)
    faces: Int64  # (F, 3)
    normals: Float64 | None = None  # (N, 3) the normals in the file; None if the file has none
    uv: Float64 | None = None  # (N, 2) texture coordinates; v points up
    colors: Float32 | None = None  # (N, 4) display-referred RGBA in [0, 1]
    face_colors: Float32 | None = None  # (F, 4) RGBA of each face, in place of vertex colors
    material: Material | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)  # further vertex attributes of the file
    # (F,) the smoothing group of each face: 0 is flat; None if the file does not say how faces without normals look
    smoothing: Int64 | None = None
    stored: Float64 | None = None  # (N, 3) the file's positions, if morph targets move them to `vertices`


@dataclass(frozen=True)
class MeshInstance:
    """One occurrence of a geometry in the scene."""

    part: str  # name of a part of the scene; consecutive instances with equal names form one part
    name: str  # name of the geometry
    geometry: Geometry
    transform: Float64 = field(default_factory=lambda: IDENTITY)  # (4, 4) local to scene; (N, 4, 4) with a skin
    source: tuple[int, int, int] = (0, 0, 0)  # indices of node, mesh and primitive in a glTF file


@dataclass(frozen=True, kw_only=True)
class Primitive(MeshInstance):
    """An instance with its place in the scene's arrays. A *row* of these arrays is a vertex of one primitive."""

    rows: slice  # the primitive's vertices among all rows of the scene
    faces: slice  # the primitive's faces among all faces of the scene
    vertices: Float64  # (N, 3) positions in local coordinates; equal to the geometry's, unless `moved`
    normals: Float64 | None  # (N, 3) in local coordinates; None if the file has none
    moved: bool = False  # whether any vertex has moved
    baked: bool = False  # whether the transform was applied, because it is singular

    def to_scene(self, points: Float64) -> Float64:
        """Convert points (N, 3), one for each vertex, from local to scene coordinates."""
        if self.transform is IDENTITY:
            return points
        with np.errstate(over="ignore", invalid="ignore"):  # `place` checks finiteness for the whole scene
            return _applied(self.transform[..., :3, :3], points) + self.transform[..., :3, 3]

    def vectors_to_scene(self, vectors: Float64) -> Float64:
        """Convert displacements (N, 3), one for each vertex, from local to scene coordinates."""
        return _applied(self._linear(slice(None)), vectors)

    def vectors_from_scene(self, vectors: Float64, rows: Any = slice(None)) -> Float64:
        """Convert displacements (K, 3) of the vertices `rows` from scene to local coordinates."""
        return _applied(np.linalg.pinv(self._linear(rows)), vectors)  # a singular transform has no inverse

    def from_scene(self, points: Float64, rows: Any = slice(None)) -> Float64:
        """Convert positions (K, 3) of the vertices `rows` from scene to local coordinates."""
        shift = self.transform[..., :3, 3]
        return self.vectors_from_scene(points - (shift[rows] if shift.ndim > 1 else shift), rows)

    def normals_to_scene(self, normals: Float64) -> Float64:
        """Convert local normals (N, 3) to unit normals in the scene, by the inverse transpose of the transform."""
        return unit(_applied(np.swapaxes(np.linalg.pinv(self._linear(slice(None))), -1, -2), normals))

    def normals_from_scene(self, normals: Float64, rows: Any = slice(None)) -> Float64:
        """Convert scene normals (K, 3) of the vertices `rows` to unit normals in local coordinates."""
        return unit(_applied(np.swapaxes(self._linear(rows), -1, -2), normals))

    @cached_property
    def mirrored(self) -> bool:
        """Return whether the transform reverses orientation; with a skin, whether most vertex transforms do so."""
        with np.errstate(over="ignore", invalid="ignore"):
            return bool(np.mean(np.linalg.det(self.transform[..., :3, :3]) < 0) > 0.5)

    def _linear(self, rows: Any) -> Float64:
        return self.transform[:3, :3] if self.transform.ndim == 2 else self.transform[rows, :3, :3]


def place(instances: Sequence[MeshInstance]) -> tuple[tuple[Primitive, ...], tuple[Primitive, ...], Float64]:
    """Return the instances with faces, the instances of lines and points, and the positions (R, 3) of all their rows.

    Rows of lines and points follow the rows of faces. Vertices that no face uses may lack a finite position.

    Raises ArgumentError if there are no faces, too many rows or faces, or invalid coordinates, indices or transforms.
    """
    placed: list[Primitive] = []
    positions: list[Float64] = []
    row_count = face_count = 0
    checked: set[int] = set()
    for each in sorted(instances, key=lambda each: len(each.geometry.faces) == 0):
        geometry, size = each.geometry, len(each.geometry.faces)
        if size and id(geometry) not in checked:
            checked.add(id(geometry))
            last, (low, high) = len(geometry.vertices) - 1, (int(geometry.faces.min()), int(geometry.faces.max()))
            if low < 0 or high > last:
                between = f"must have faces between vertices 0 … {last} of {shortened(each.name)}"
                raise ArgumentError("path", f"{between}, got {low if low < 0 else high}")
            require_finite(geometry.vertices, geometry.faces, f" of {shortened(each.name)}")
        if each.transform is not IDENTITY and not np.isfinite(each.transform).all():
            raise ArgumentError("path", f"places part {shortened(each.part)} by a transform that is not finite")
        rows = slice(row_count, row_count + len(geometry.vertices))
        faces = slice(face_count, face_count + size)
        row_count, face_count = rows.stop, faces.stop
        if max(row_count, face_count) > MOST_ROWS:
            raise ArgumentError("path", f"places more than {MOST_ROWS} vertices or faces")
        finite = np.isfinite(geometry.vertices)
        vertices = geometry.vertices if finite.all() else np.where(finite, geometry.vertices, 0.0)
        placed.append(Primitive(**vars(each), rows=rows, faces=faces, vertices=vertices, normals=geometry.normals))
        positions.append(placed[-1].to_scene(geometry.vertices))
        if size and not np.isfinite(positions[-1][geometry.faces]).all():
            raise ArgumentError("path", "places vertices so far away that their coordinates are not finite")
    if face_count == 0:
        raise ArgumentError("path", "holds no faces")
    count = sum(each.faces.stop > each.faces.start for each in placed)
    return tuple(placed[:count]), tuple(placed[count:]), np.concatenate(positions)


def require_finite(vertices: Float64, faces: NDArray[np.integer], owner: str = "") -> None:
    """Raise ArgumentError if `faces` (F, 3) use a vertex of `vertices` (N, 3) whose coordinates are not finite."""
    wrong = ~np.isfinite(vertices)
    if wrong.any() and wrong[faces].any():
        wrong[np.setdiff1d(np.arange(len(vertices)), faces)] = False
        row, axis = np.argwhere(wrong)[0]
        raise ArgumentError("path", f"must hold finite coordinates, got {vertices[row, axis]} at vertex {row}{owner}")


def _applied(linear: NDArray[np.floating], vectors: Float64) -> Float64:
    """Multiply vectors (N, 3) by `linear`: one matrix (3, 3), or one matrix for each vector, (N, 3, 3)."""
    return vectors @ linear.T if linear.ndim == 2 else np.einsum("nij,nj->ni", linear, vectors)
