"""The scene of a mesh file: its primitives, the mesh vertex of each primitive vertex, and the source file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Bool, Float64, Int32, Int64, UInt8
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.file.primitives import Geometry, MeshInstance, Primitive, place
from dfd.mesh.weld import weld

if TYPE_CHECKING:
    from dfd.mesh.file.gltf.data import GltfData

_DEFAULT = Material(is_default=True)
_ADVICE = (
    ", only {} points, as scans and splats do: `dfd.bind` and `dfd.pose` move points (see 'Points without faces' in "
    "the docs), or make a surface first"
)


@dataclass(frozen=True)
class FileSource:
    """The content of an OBJ, PLY, STL or OFF file. To save moved positions, the content is parsed again."""

    data: UInt8  # (N,) the bytes of the file; an array, because processes can share arrays
    numbers: Int64 | None = None  # (R,) the file's vertex for each row of `SceneFile`; None for STL files
    root: Path | None = None  # the folder in which its materials may be, if this is not the folder of the file
    corner_rows: Int32 | None = None  # (C,) row of each face corner of an OBJ file; −1 in faces of one or two corners


@dataclass(frozen=True)
class SceneFile:
    """The scene of a file or of a trimesh object. A mesh gets its colors from the scene, and is saved with the scene.

    *Rows* are the concatenated vertices of all primitives. Along seams of texture or normals, a vertex of the file has
    several rows. All rows at one position belong to the first mesh vertex at this position.
    """

    path: Path | None
    primitives: tuple[Primitive, ...]
    corner_faces: Int32  # (F, 3) row of each face corner
    vertices: Float64  # (V, 3) positions of the mesh vertices in the scene
    representative: Int32  # (V,) for each vertex, the first vertex at its position
    vertex: Int32  # (R + L,) mesh vertex of each row; −1 at positions that no face uses
    appearance: Appearance | None  # the colors of the faces; None if unknown
    gltf: GltfData | None = None  # the source file, if it is a glTF file
    source: FileSource | None = None  # the source file, if it has another format
    # Lines and points of a glTF file. Their rows, L in all, come after the rows of faces. In place of a mesh vertex,
    # `vertex` gives the nearest one, which they follow.
    strands: tuple[Primitive, ...] = ()
    unplaced: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))  # mesh vertices without a position: at 0

    def local_faces(self, primitive: Primitive) -> Int32:
        """Return the faces (F, 3) of a primitive as indices of its own vertices, with their winding in the scene."""
        return self.corner_faces[primitive.faces] - np.int32(primitive.rows.start)

    @property
    def faces(self) -> Int32:
        """Return the faces (F, 3) as indices of mesh vertices."""
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
        """Return the scene with these `instances`, and number the vertices of the mesh.

        `own_vertices` (V, 3) is the file's list of vertices. `source.numbers` maps rows to this list; without these
        numbers, row i is vertex i. Without `own_vertices`, the vertices are the distinct positions that faces use, in
        the order of the rows.

        Raises ArgumentError if there are no faces or fewer than three distinct vertices, or a coordinate is not finite.
        """
        if not any(len(each.geometry.faces) for each in instances):
            count = (
                sum(len(each.geometry.vertices) for each in instances) if own_vertices is None else len(own_vertices)
            )
            raise ArgumentError("path", f"holds no faces{_ADVICE.format(count) if count else ''}")
        primitives, strands, positions = place(instances)
        numbered = []
        for each in primitives:
            faces = each.geometry.faces.astype(np.int32) + np.int32(each.rows.start)
            # A mirroring transform reverses the winding of triangles: glTF 2.0, section 3.7.4.
            numbered.append(faces[:, [0, 2, 1]] if each.mirrored else faces)
        corner_faces = np.concatenate(numbered)
        unplaced = np.zeros(0, np.int64)
        if own_vertices is not None:
            numbers = np.arange(len(positions)) if source is None or source.numbers is None else source.numbers
            unplaced = np.flatnonzero(~np.isfinite(own_vertices).all(axis=1))
            vertices = own_vertices.copy()
            vertices[unplaced] = 0
            representative = np.arange(len(vertices), dtype=np.int32)
            known = np.delete(representative, unplaced)
            first, distinct = weld(vertices[known])
            representative[known] = known[first[distinct]]
            vertex = representative[numbers]
        else:
            finite: Bool = np.logical_and.reduce(np.isfinite(positions), axis=1)
            finite[primitives[-1].rows.stop :] = False
            first, distinct = weld(positions[finite])
            of_known = np.zeros(len(finite), np.int64)
            of_known[finite] = distinct
            used = np.bincount(of_known[corner_faces].ravel(), minlength=len(first)) > 0
            vertices = positions[finite][first[used]]
            representative = np.arange(len(vertices), dtype=np.int32)
            numbers = np.where(used, np.cumsum(used, dtype=np.int32) - np.int32(1), np.int32(-1))
            vertex = np.where(finite, numbers[of_known], np.int32(-1))
            _follow(vertex, positions, vertices, strands)
        used_count = np.count_nonzero(np.bincount(vertex[corner_faces].ravel()))
        if used_count < 3:
            raise ArgumentError("path", f"must hold at least 3 distinct vertices, got {used_count}")
        primitives = _without_gaps(primitives, vertex, path)
        look = _appearance(primitives, vertex[: primitives[-1].rows.stop], corner_faces)
        mesh = corner_faces, vertices, representative, vertex, look
        return cls(path, primitives, *mesh, gltf, source, strands, unplaced)


def _follow(vertex: Int32, positions: Float64, vertices: Float64, strands: Sequence[Primitive]) -> None:
    """Let rows of lines and points follow the nearest of `vertices` (V, 3): write its index to `vertex` (R + L,)."""
    if strands:
        from scipy.spatial import cKDTree

        rows = strands[0].rows.start + np.flatnonzero(np.isfinite(positions[strands[0].rows.start :]).all(axis=1))
        vertex[rows] = cKDTree(vertices).query(positions[rows])[1]


def _appearance(primitives: Sequence[Primitive], vertex: Int32, corner_faces: Int32) -> Appearance | None:
    """Return the appearance of all faces; None if all are default gray. `vertex` (R,) is each row's mesh vertex."""
    numbers: dict[tuple[int, bool], int] = {}  # index in `known`, by material id and whether the surface has colors
    known: list[Material] = []
    of_primitive: list[int] = []
    colored, by_corner = False, False
    for each in primitives:
        geometry = each.geometry
        has_colors = geometry.colors is not None or geometry.face_colors is not None
        colored, by_corner = colored or has_colors, by_corner or geometry.face_colors is not None
        material = geometry.material or _DEFAULT
        of_primitive.append(numbers.setdefault((id(material), has_colors), len(known)))
        if of_primitive[-1] == len(known):
            known.append(material.shown(has_colors=has_colors))
    textured = any(each.texture is not None for each in known)
    if not colored and not textured and all(replace(each, name="", is_default=False) == Material() for each in known):
        return None
    uv = colors = None
    if textured and any(each.geometry.uv is not None for each in primitives):
        uv = np.concatenate([_placed_uv(each) for each in primitives])
        uv = uv.clip(-1e6, 1e6).astype(np.float32)
    if colored:
        colors = np.concatenate([_or_fill(each.geometry.colors, each, 1.0, 4) for each in primitives])
    if colors is not None and by_corner:  # each corner gets its own row: faces of different colors can share rows
        rows = corner_faces.ravel()
        vertex, colors, uv = vertex[rows], colors[rows], None if uv is None else uv[rows]
        corner_faces = np.arange(len(rows), dtype=np.int32).reshape(-1, 3)
        for each in primitives:
            if each.geometry.face_colors is not None:
                colors[corner_faces[each.faces]] = each.geometry.face_colors[:, None]
    return Appearance(
        corners=vertex,
        corner_faces=corner_faces,
        face_material=np.repeat(np.array(of_primitive, np.int32), [len(each.geometry.faces) for each in primitives]),
        materials=tuple(known),
        uv=uv,
        colors=colors,
    )


def _or_fill(values: NDArray[np.floating] | None, each: Primitive, missing: float, width: int) -> NDArray[np.floating]:
    return np.full((len(each.vertices), width), missing, np.float32) if values is None else values


def _placed_uv(each: Primitive) -> Float64:
    """Return the texture coordinates (N, 2) of a primitive, scaled and shifted as its material says."""
    if each.geometry.uv is None:
        return np.zeros((len(each.vertices), 2))
    scale_u, scale_v, offset_u, offset_v = (each.geometry.material or _DEFAULT).placement
    return each.geometry.uv * (scale_u, scale_v) + (offset_u, offset_v)


def _without_gaps(primitives: Sequence[Primitive], vertex: Int32, path: Path | None) -> tuple[Primitive, ...]:
    """Return the primitives with a value in place of each missing color and texture coordinate, and warn of them.

    In the arrays of a geometry, the row of a missing value is not finite. A missing color becomes white, and a missing
    texture coordinate 0. Missing normals stay: `complete` computes them if a file needs them. `vertex` (R,) is the mesh
    vertex of each row.
    """
    filled: dict[int, Geometry] = {}
    colorless, faceless, unplaced = list[Int32](), 0, list[Int32]()
    for each in primitives:
        old = each.geometry
        if id(old) in filled:
            continue
        used = np.zeros(len(old.vertices), bool)
        used[old.faces] = True
        gaps = {name: _gaps(getattr(old, name)) for name in ("colors", "face_colors", "uv")}
        rows = vertex[each.rows]
        if old.face_colors is None:
            colorless.append(rows[gaps["colors"] & used] if old.colors is not None else rows[:0])
        faceless += int(gaps["face_colors"].sum())
        if old.uv is not None and old.material is not None and old.material.texture is not None:
            unplaced.append(rows[gaps["uv"] & used])
        values = {"colors": 1.0, "face_colors": 1.0, "uv": 0.0}
        changed = {name: _filled(getattr(old, name), gaps[name], values[name]) for name in gaps if gaps[name].any()}
        filled[id(old)] = replace(old, **changed) if changed else old
    vertices = sum(len(np.unique(each)) for each in colorless)
    coordinates = sum(len(np.unique(each)) for each in unplaced)
    found = [f"{_counted(vertices, 'vertex', 'vertices')} without a color"] if vertices else []
    found += [f"{_counted(faceless, 'face', 'faces')} without a color"] if faceless else []
    said = [f"{' and '.join(found)}: white is used"] if found else []
    if coordinates:
        said.append(f"{_counted(coordinates, 'textured vertex', 'textured vertices')} without coordinates: 0 is used")
    if said:
        check.warn(f"load: `path` {path} has {', and '.join(said)}", UserWarning)
    return tuple(
        each if filled[id(each.geometry)] is each.geometry else replace(each, geometry=filled[id(each.geometry)])
        for each in primitives
    )


def _gaps(values: Any) -> Bool:
    """Return which rows (N,) of an array are not finite; for None, no row."""
    return np.zeros(1, bool) if values is None else ~np.isfinite(values).all(axis=1)


def _filled(values: Any, gaps: Bool, value: float) -> Any:
    return np.where(gaps[:, None], np.asarray(value, values.dtype), values)


def _counted(count: int, one: str, several: str) -> str:
    return f"{count} {one if count == 1 else several}"
