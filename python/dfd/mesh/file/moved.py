"""The primitives of a scene after its mesh moves: positions and normals in local coordinates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dfd.common.linear_algebra import Bool, Float64, Int32, Int64, nearest_rotations, unit
from dfd.mesh.appearance import Appearance
from dfd.mesh.file.edits import SAME
from dfd.mesh.file.primitives import IDENTITY, Primitive
from dfd.mesh.file.scene_file import FileSource, SceneFile
from dfd.mesh.normals import mean_gradients, turned_normals
from dfd.mesh.weld import weld

_FLAT = 1e-6  # a transform that loses more of a position than this fraction of the shape's size cannot hold the edit


@dataclass(frozen=True, eq=False)
class Saving:
    """A mesh that is being saved."""

    target: Path
    vertices: Float64  # (V, 3) new positions
    faces: Int32  # (F, 3)
    look: Appearance | None
    scene: SceneFile | None  # the source of the mesh
    moved: Sequence[Primitive]  # the primitives of `scene` at the new positions
    strands: Sequence[Primitive] = ()  # its lines and points

    @property
    def file(self) -> SceneFile:
        """The scene of the source file."""
        assert self.scene is not None
        return self.scene

    @property
    def source(self) -> FileSource:
        """The source file, if it is no glTF file."""
        assert self.file.source is not None
        return self.file.source

    def of_vertices(self) -> tuple[Float64, Float64]:
        """Return positions and normals (V, 3) for the file's list of vertices; NaN keeps the number of the file."""
        positions, normals = self.vertices.copy(), np.full(self.vertices.shape, np.nan)
        positions[self.file.unplaced] = np.nan
        normals[self.source.numbers] = self.of_rows()
        return positions, normals

    def of_rows(self) -> Float64:
        """Return the normals (R, 3) of all rows; NaN for a missing normal."""
        missing = [
            np.full(each.vertices.shape, np.nan) if each.normals is None else each.normals for each in self.moved
        ]
        return np.concatenate(missing)


def moved_primitives(vertices: Float64, scene: SceneFile | None) -> tuple[Sequence[Primitive], Sequence[Primitive]]:
    """Return the primitives, and the lines and points, after the mesh moves to `vertices` (V, 3).

    Unmoved vertices keep their exact values. If a node's transform flattens its meshes, so that local positions cannot
    hold the edit, its primitives are `baked`: their transforms are applied and become the identity.
    """
    if scene is None:
        return (), ()
    if np.array_equal(vertices, scene.vertices):
        return scene.primitives, scene.strands
    tolerance = _FLAT * float(np.ptp(vertices, axis=0).max())
    normals = [*moved_normals(vertices, scene.vertices, scene), *(each.normals for each in scene.strands)]
    result: list[Primitive] = []
    flat: set[str] = set()
    for each, own_normals in zip([*scene.primitives, *scene.strands], normals, strict=True):
        wanted, here = placed(each, vertices, scene)
        local = each.vertices
        if here.any():
            local = local.copy()
            local[here] = each.from_scene(wanted[here], here)
            if not np.abs(each.to_scene(local)[here] - wanted[here]).max() <= tolerance:
                flat.add(each.part)
        result.append(replace(each, vertices=local, normals=own_normals, moved=bool(here.any())))
    result = [_baked(each, placed(each, vertices, scene)[0]) if each.part in flat else each for each in result]
    return result[: len(scene.primitives)], result[len(scene.primitives) :]


def placed(each: Primitive, vertices: Float64, scene: SceneFile) -> tuple[Float64, Bool]:
    """Return the positions of a primitive's rows in the scene, (N, 3), and which of them the mesh moves (N,).

    Lines and points keep their distance from the vertices that they follow.
    """
    rows = scene.vertex[each.rows]
    there = rows >= 0
    here: Bool = there & (vertices != scene.vertices).any(axis=1)[rows]
    wanted = each.to_scene(each.vertices).copy()
    if len(each.geometry.faces):
        wanted[there] = vertices[rows[there]]
    else:
        wanted[here] += vertices[rows[here]] - scene.vertices[rows[here]]
    return wanted, here


def _baked(each: Primitive, wanted: Float64) -> Primitive:
    """Return a primitive without a transform, at the positions `wanted` (N, 3) of the scene."""
    normals = None if each.normals is None else each.normals_to_scene(each.normals)
    if normals is not None:
        normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)  # glTF requires unit length
    return replace(each, vertices=wanted, normals=normals, transform=IDENTITY, moved=True, baked=True)


def moved_normals(vertices: Float64, before: Float64, scene: SceneFile) -> list[Float64 | None]:
    """Return the new normals of each primitive in local coordinates; None for a primitive without normals in the file.

    The vertices move from `before` (V, 3) to `vertices` (V, 3). Each normal turns with the surface around it, and keeps
    its angle to the surface. Rows, which are vertices of primitives, belong to one smooth surface if they have equal
    positions and equal normals, even on both sides of a texture seam, and turn together. Normals keep the exact numbers
    of the file if the surface does not turn, and if they are missing: zero or not finite.
    """
    own = [each.normals for each in scene.primitives]
    changed = (vertices != before).any(axis=1)
    if not changed.any() or all(normals is None for normals in own):
        return own
    old, first, group = _smooth_rows(scene)
    corners = group[scene.corner_faces]
    touched = np.zeros(len(first), bool)
    touched[corners[changed[scene.faces].any(axis=1)]] = True
    around = touched[corners].any(axis=1)  # the faces at groups whose surface moves
    number = np.where(touched, np.cumsum(touched) - 1, np.count_nonzero(touched))
    new = old[first]
    new[touched] = turned_normals(new[touched], vertices, before, scene.faces[around], number[corners[around]])
    stale = np.abs(new - old[first]).max(axis=1) > SAME
    result: list[Float64 | None] = []
    for each, normals in zip(scene.primitives, own, strict=True):
        if normals is not None:
            here = group[each.rows]
            normals = normals.copy()
            normals[stale[here]] = each.normals_from_scene(new[here[stale[here]]], stale[here])
        result.append(normals)
    return result


def moved_gradients(vertices: Float64, scene: SceneFile) -> list[Float64]:
    """Return the deformation gradient (N, 3, 3) of the surface at each row of each primitive, in scene coordinates.

    Rows that turn together, as in `moved_normals`, have equal gradients.
    """
    _, first, group = _smooth_rows(scene)
    found = mean_gradients(vertices, scene.vertices, scene.faces, group[scene.corner_faces], len(first))
    return [found[group[each.rows]] for each in scene.primitives]


def moved_tangents(tangents: Float64, gradients: Float64, each: Primitive) -> Float64:
    """Return the local tangents (N, 3 or 4) of a moved primitive; a fourth number, the side, stays.

    A tangent follows the deformation gradient (N, 3, 3) of the surface in the scene, and stays at a right angle to the
    normal. Tangents keep the exact numbers of the file if the surface does not turn.
    """
    old = unit(each.vectors_to_scene(tangents[:, :3]))
    new = unit(np.einsum("nij,nj->ni", gradients, old))
    if each.normals is not None:
        up = each.normals_to_scene(_finite(each.normals))
        upright = unit(new - up * np.einsum("ni,ni->n", new, up)[:, None])
        new = np.where(upright.any(axis=1, keepdims=True), upright, new)
    stale = (np.abs(new - old).max(axis=1) > SAME) & new.any(axis=1)
    result = tangents.copy()
    local = unit(each.vectors_from_scene(new[stale], stale))
    result[stale, :3] = np.where(local.any(axis=1, keepdims=True), local, result[stale, :3])
    return result


def turned_displacements(displacements: Float64, gradients: Float64, each: Primitive) -> Float64:
    """Return local displacements (N, 3) of tangents, turned by the rotations nearest to `gradients` (N, 3, 3)."""
    turns = nearest_rotations(gradients)
    stale = np.abs(turns - np.eye(3)).max(axis=(1, 2)) > SAME
    result = displacements.copy()
    turned = np.einsum("nij,nj->ni", turns[stale], each.vectors_to_scene(displacements)[stale])
    result[stale] = each.vectors_from_scene(turned, stale)
    return result


def _smooth_rows(scene: SceneFile) -> tuple[Float64, Int64, Int64]:
    """Return the unit normals (R, 3) of all rows in the scene, the first row (G,) of each group, and each row's group.

    Rows with equal positions and equal normals form a group.
    """
    old = np.concatenate(
        [
            np.zeros(each.vertices.shape) if each.normals is None else each.normals_to_scene(_finite(each.normals))
            for each in scene.primitives
        ]
    )
    _, normal = weld(old)
    key = scene.vertex[: len(old)].astype(np.int64) * (int(normal.max()) + 1) + normal
    first, group = np.unique(key, return_index=True, return_inverse=True)[1:]
    return old, first, group


def _finite(normals: Float64) -> Float64:
    return np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, 0.0)
