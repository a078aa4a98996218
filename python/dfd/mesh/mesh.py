"""Triangle meshes with their colors and the content of their files, and the function `load`, which makes a mesh."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int32, Int64
from dfd.common.read_only import ReadOnlyArrays
from dfd.common.shown import Shown
from dfd.mesh.appearance import Appearance
from dfd.mesh.file.obj.read import face_groups
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.normals import smooth_normals

# Importing trimesh takes most of a second, and only conversions need it.
if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class MeshPart(ReadOnlyArrays):
    """A named object of a file: a node of a glTF file, an object or group of an OBJ file, or a solid of an STL file."""

    name: str  # unique among the parts of the mesh
    faces: slice  # the part's faces, which are consecutive in the mesh
    vertices: Int64  # (N,) the vertices that these faces use, ascending; parts that touch can share vertices


class Mesh(Shown, ReadOnlyArrays):
    """An immutable triangle mesh with read-only arrays. Moved positions are a separate array (V, 3).

    Vertex i of a mesh from an OBJ, PLY or OFF file is the file's own vertex i, counted from 0. (In an OBJ file, faces
    call this vertex i + 1.) Vertices that no face uses count too. GLB, glTF and STL files have no single list of
    vertices. For these files, the vertices are the distinct positions that faces use, in the order of the file.

    Several vertices may have the same position. The faces of a mesh from a file then use only the first of them, even
    along seams of texture or normals. `representative[i]` is the index of the first vertex at the position of vertex i.
    In a mesh from arrays, `representative[i]` is i.

    Raises ValueError if an array has a wrong shape or type, a coordinate is not finite or an index is out of range.

    Parameters
    ----------
    vertices
        (V, 3) positions in mesh units, at least three.
    faces
        (F, 3) vertex indices, at least one face. Faces without area and repeated faces are kept.
    appearance
        Colors of the faces; None is gray. `dfd.load` reads them from the file.
    scene
        The content of the file, from which `save` keeps everything but positions and normals. `dfd.load` sets it.
    """

    vertices: Float64  # (V, 3) positions in the file's units
    faces: Int32  # (F, 3) corners as indices into `vertices`
    representative: Int32  # (V,) for each vertex, the vertex that faces use in its place (see above)
    appearance: Appearance | None  # the colors of the surface; None if unknown
    source: Path | None  # path of the mesh's file; None for a mesh from memory
    scene: SceneFile | None  # content of the file or trimesh object; None for a mesh from arrays

    def __init__(
        self, vertices: Any, faces: Any, *, appearance: Appearance | None = None, scene: SceneFile | None = None
    ) -> None:
        self.vertices = _frozen(check.array("Mesh", "vertices", vertices, ("V", 3), dtype=np.float64))
        if len(self.vertices) < 3:
            raise ValueError(f"Mesh: `vertices` must hold at least 3 vertices, got {len(self.vertices)}")
        self.faces = _frozen(_checked_faces(faces, len(self.vertices)))
        self.representative = _frozen(
            np.arange(len(self.vertices), dtype=np.int32) if scene is None else scene.representative
        )
        self.appearance = appearance
        self.source = scene.path if scene else None
        self.scene = scene

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise AttributeError if the attribute is already set: other attributes were computed from it."""
        if name in self.__dict__:
            raise AttributeError(f"Mesh: `{name}` cannot be set, because a mesh is immutable: make a new dfd.Mesh")
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"Mesh: `{name}` cannot be deleted, because a mesh is immutable")

    def __repr__(self) -> str:
        name = f"{self.source.name}: " if self.source else ""
        parts = f", {len(self.parts)} parts" if len(self.parts) > 1 else ""
        return f"Mesh({name}{len(self.vertices)} vertices, {len(self.faces)} faces{parts})"

    @cached_property
    def bounds(self) -> Float64:
        """The smallest and largest coordinates, (2, 3); vertices without a face count only in a mesh from arrays."""
        places = self.vertices if self.scene is None else self.vertices[self._corners_of(slice(None))]
        return _frozen(np.stack([places.min(axis=0), places.max(axis=0)]))

    @cached_property
    def extents(self) -> Float64:
        """The lengths (3,) of the sides of the bounding box."""
        return _frozen(self.bounds[1] - self.bounds[0])

    @cached_property
    def parts(self) -> tuple[MeshPart, ...]:
        """The parts of the scene, in the order of their faces; a mesh from arrays has one part with all faces."""
        if self.scene is None:
            return (MeshPart("mesh", slice(0, len(self.faces)), _frozen(self._corners_of(slice(None)))),)
        found = []
        for name, group in groupby(self.scene.primitives, lambda each: each.part):
            first, *others = group
            faces = slice(first.faces.start, (others or [first])[-1].faces.stop)
            found.append(MeshPart(name, faces, _frozen(self._corners_of(faces))))
        return tuple(found)

    def _corners_of(self, faces: slice) -> Int64:
        """Return the vertices (N,), ascending, of the given faces."""
        corners = self.faces[faces].ravel()
        if len(corners) < len(self.vertices):  # sorting a few corners is faster than counting for all vertices
            return np.unique(corners).astype(np.int64)
        return np.flatnonzero(np.bincount(corners))

    @cached_property
    def part_names(self) -> tuple[str, ...]:
        """The names of `parts`, in their order."""
        return tuple(part.name for part in self.parts)

    def part_vertices(self, name: str) -> Int64:
        """Return the vertices (N,), ascending, that the faces of the part `name` use.

        If no part has this name, the geometry with this name is used; if there is none, the material with this name.

        Raises ValueError if nothing in the scene has this name; the message lists the names of the parts.
        """
        for part in self.parts:
            if part.name == name:
                return part.vertices
        primitives = self.scene.primitives if self.scene else ()
        materials = [each for each in primitives if each.geometry.material and each.geometry.material.name == name]
        if used := [each for each in primitives if each.name == name] or (materials if name else []):
            return np.unique(np.concatenate([self.faces[each.faces] for each in used])).astype(np.int64)
        known = _listed(self.part_names)
        raise ArgumentError("name", f"must be a part of the scene ({known}), got {name!r:.60}", "Mesh.part_vertices")

    @property
    def group_names(self) -> tuple[str, ...]:
        """The names of the face groups of an OBJ file: first those of `g` lines, then of `o`, then of `usemtl`."""
        return tuple(self._groups)

    def group_vertices(self, name: str) -> Int64:
        """Return the vertices (N,), ascending, that the faces of a group of an OBJ file use.

        Each word after `g` names a group, and the whole text after `g` names another. An `o` or `usemtl` line names one
        group. If lines of several kinds have the same name, `g` takes precedence, then `o`, then `usemtl`. The groups
        can differ from the parts and materials of the mesh.

        Raises ValueError if no face belongs to that group; the message lists the groups of the file.
        """
        if name in self._groups:
            return np.unique(self.representative[self._groups[name]]).astype(np.int64)
        known = f" of the file ({_listed(self.group_names)})" if self._groups else " of the mesh (it has none)"
        raise ArgumentError("name", f"must be a face group{known}, got {name!r:.60}", "Mesh.group_vertices")

    @cached_property
    def _groups(self) -> dict[str, Int64]:
        """The vertices of each face group, by the group's name; the first access parses the OBJ text again."""
        if self.scene is None or self.scene.source is None or self.scene.source.corner_rows is None:
            return {}
        return face_groups(self.scene.source.data.tobytes())

    @cached_property
    def diagonal(self) -> float:
        """The length of the diagonal of the bounding box."""
        return float(np.linalg.norm(self.extents))

    @cached_property
    def normals(self) -> Float32:
        """The unit normals (V, 3) of vertices: area-weighted means of face normals, or 0 if the face normals cancel."""
        return _frozen(smooth_normals(self.vertices, self.faces)[self.representative])

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 of vertices, faces and appearance, as 64 hexadecimal digits; a cache may use it as a key."""
        digest = hashlib.sha256()
        for values in (self.vertices, self.faces):
            digest.update(f"{values.shape}".encode())
            digest.update(values.data)
        for piece in () if self.appearance is None else self.appearance.content():
            digest.update(piece)
        return digest.hexdigest()

    def save(self, path: str | os.PathLike[str], vertices: Any | None = None) -> None:
        """Write the mesh to `path`, whose ending selects the format. If given, `vertices` (V, 3) are the new positions.

        A mesh from a file keeps the file's parts, names, materials, UVs, textures, colors and units, as far as the
        format can store them. Normals and tangents follow the moved surface. If the format is that of the source file,
        all other data keep their values and number types. Without an edit, all bytes stay, except references to other
        files: in another folder, materials are copied, and data of glTF files is embedded. The file is written
        atomically.

        Warns if rounding to 32-bit floats moves a vertex by more than 0.001 % of the bounding box's diagonal. Only STL
        files, and glTF meshes with a skin or morph targets, store such positions. Warns if a glTF file cannot hold the
        numbers of a further attribute, such as whole numbers above 2²⁴.

        Raises ValueError if the ending is none of .obj, .ply, .stl, .off, .glb and .gltf. Raises ValueError if
        `vertices` has a wrong shape or is not finite. Raises OSError if the file cannot be written; an existing file is
        then unchanged.
        """
        from dfd.mesh.file.write import write

        write(path, self._moved("Mesh.save", vertices), self.faces, self.appearance, self.scene)

    def to_trimesh(self, vertices: Any | None = None) -> trimesh.Trimesh:
        """Return the mesh as a `trimesh.Trimesh` with the same vertices and faces in the same order.

        If given, `vertices` (V, 3) are the new positions. Textures become vertex colors. A vertex on a seam takes the
        color of one side of the seam.

        Raises ValueError if `vertices` has a wrong shape or is not finite.
        """
        import trimesh

        moved = self._moved("Mesh.to_trimesh", vertices)
        result = trimesh.Trimesh(moved.copy(), self.faces.astype(np.int64), process=False)
        if self.appearance is not None:
            result.visual.vertex_colors = np.rint(self.vertex_colors() * 255).astype(np.uint8)
        return result

    def _moved(self, function: str, vertices: Any | None) -> Float64:
        if vertices is None:
            return self.vertices
        return check.array(function, "vertices", vertices, self.vertices.shape, dtype=np.float64)

    def vertex_colors(self) -> Float32:
        """Return the display-referred RGBA (V, 4) in [0, 1] of the surface at each vertex.

        A vertex on a seam takes the color of one side of the seam. A vertex without a face or a known color is white.
        """
        if self.appearance is None:
            return np.ones((len(self.vertices), 4), np.float32)
        return self.appearance.corner_colors(self.faces, len(self.vertices))[self.representative]


_Pose = Literal["rest", "bind"]

MeshLike: TypeAlias = (  # `Sequence[Any]` is a pair of arrays: vertices and faces
    "Mesh | str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene | Sequence[Any]"
)


def load(
    source: str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene | Sequence[Any], *, pose: _Pose = "rest"
) -> Mesh:
    """Read a mesh from an OBJ, PLY, STL, OFF, GLB or glTF file, or convert one from memory.

    All parts of a scene are loaded. Their transforms are applied, and polygons become triangles. The mesh keeps units,
    orientation, the file's numbering of vertices (see `Mesh`), faces without area and repeated faces.

    Raises OSError if the file cannot be opened, or is a pipe or a device. Raises ValueError if `source` or `pose` has
    a wrong type or value. Raises ValueError if the file is empty, malformed, truncated, or in an unknown format or
    compression. Raises ValueError if there are no faces, a face index is out of range or a coordinate is not finite.
    Vertices that no face uses may lack a position; in the mesh, they are at 0.

    Warns if a texture or materials file cannot be read; faces that use it are then gray. Warns if a file has faces with
    fewer than three corners, which the mesh omits. Warns if some colors or texture coordinates are missing, or if an
    option of a texture or a kind of color is not applied; the page "Mesh files" of the documentation lists them.

    Parameters
    ----------
    source
        Path of a file; or a `trimesh.Trimesh` or `trimesh.Scene`; or a pair of vertices (V, 3) and faces (F, 3).
        Arrays are copied.
    pose
        This affects only glTF files with skins or morph targets. ``"rest"`` is the shape that viewers show before any
        animation. ``"bind"`` is the shape of the stored vertices, without skins and morph targets.

    Examples
    --------
    >>> import dfd
    >>> dfd.samples.chair().mesh.save("chair.glb")
    >>> mesh = dfd.load("chair.glb")
    >>> mesh.vertices.shape == (len(mesh.vertices), 3)
    True
    >>> triangle = dfd.load(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    >>> triangle.vertices
    array([[0., 0., 0.],
           [1., 0., 0.],
           [0., 1., 0.]])
    """
    check.choice("load", "pose", pose, _Pose)
    known = sys.modules.get("trimesh")  # None unless the caller has imported trimesh
    if isinstance(source, str | os.PathLike):
        from dfd.mesh.file.read import read

        scene = read(source, at_rest=pose == "rest")
    elif known is not None and isinstance(source, known.Trimesh | known.Scene):
        from dfd.mesh.file.in_trimesh import of_trimesh

        try:
            scene = of_trimesh(source)
        except ArgumentError as error:
            raise ArgumentError("source", error.reason, "load") from None
    elif isinstance(source, tuple | list) and len(source) == 2:
        return Mesh(*source)
    elif hasattr(source, "vertices") and hasattr(source, "triangles"):  # open3d.geometry.TriangleMesh
        return Mesh(np.asarray(source.vertices), np.asarray(source.triangles))
    elif hasattr(source, "points") and hasattr(source, "regular_faces"):  # pyvista.PolyData
        surface: Any = source
        whole = surface if surface.is_all_triangles else surface.triangulate()
        return Mesh(np.asarray(whole.points), np.asarray(whole.regular_faces))
    else:
        raise ValueError(
            "load: `source` must be a path, a trimesh.Trimesh, a trimesh.Scene, a pyvista.PolyData, an "
            f"open3d.geometry.TriangleMesh or a pair (vertices, faces), got {type(source).__name__}"
            f"{': write its bytes to a file first' if hasattr(source, 'read') else ''}"
        )
    return _of_scene(scene)


def load_within(path: Path, root: Path | None) -> Mesh:
    """Read a mesh as `load` does, with materials, images and buffers from anywhere in the folder `root`."""
    from dfd.mesh.file.read import read

    return _of_scene(read(path, root=root))


def _of_scene(scene: SceneFile) -> Mesh:
    return Mesh(scene.vertices, scene.faces, appearance=scene.appearance, scene=scene)


def as_mesh(source: MeshLike) -> Mesh:
    """Return `source` if it is a `Mesh`, else the mesh that `load` makes of it."""
    return source if isinstance(source, Mesh) else load(source)


def _checked_faces(faces: Any, vertex_count: int) -> Int32:
    indices = np.asarray(tensors.shared("Mesh", "faces", faces))
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


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(each[:30] for each in names[:20]) + (", …" if len(names) > 20 else "")


def _frozen(values: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only copy of an array."""
    values = values.copy()
    values.flags.writeable = False
    return values
