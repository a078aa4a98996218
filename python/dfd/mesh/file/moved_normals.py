"""Recomputation of the normals of a moved surface; smooth and sharp edges of the file stay."""

from __future__ import annotations

import numpy as np

from dfd.common.linear_algebra import Bool, Float64, Int64, group_sums
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.normals import face_normals
from dfd.mesh.weld import weld


def follow(
    vertices: Float64,  # (V, 3) after
    before: Float64,  # (V, 3)
    changed: Bool,  # (V,)
    scene: SceneFile,
) -> list[Float64 | None]:
    """Return each primitive's normals in its own coordinates; None for a primitive without normals in the file.

    Rows with equal position and normal belong to one smooth surface, even on both sides of a texture seam. They get
    one new normal: the area-weighted sum of their faces' normals. Rows with another normal lie across a sharp edge.
    Rows whose faces did not move keep the bits of the file's normals.
    """
    own = [each.geometry.normals for each in scene.primitives]
    if not changed.any() or all(normals is None for normals in own):
        return own
    placed = np.concatenate(
        [
            np.zeros((each.rows.stop - each.rows.start, 3)) if normals is None else each.normals_to_scene(normals)
            for each, normals in zip(scene.primitives, own, strict=True)
        ]
    )
    _, normal = weld(placed)
    key = scene.vertex.astype(np.int64) * (int(normal.max()) + 1) + normal
    first, group = np.unique(key, return_index=True, return_inverse=True)[1:]
    faces = group[scene.corner_faces]
    touched = changed[scene.vertex[scene.corner_faces]].any(axis=1)
    stale = np.zeros(len(first), bool)
    stale[faces[touched]] = True
    new = _sums(vertices, scene, faces, len(first))
    # The file or a mirroring transform may wind faces inward. New normals stay on the side of the old normals.
    inward = np.einsum("ij,ij->i", _sums(before, scene, faces, len(first)), placed[first]) < 0
    new[inward] *= -1
    stale &= np.linalg.norm(new, axis=1) > 0
    result: list[Float64 | None] = []
    for each, normals in zip(scene.primitives, own, strict=True):
        if normals is not None:
            here = group[each.rows]
            followed = normals.copy()
            followed[stale[here]] = each.normals_from_scene(new[here[stale[here]]], stale[here])
            normals = followed
        result.append(normals)
    return result


def _sums(vertices: Float64, scene: SceneFile, faces: Int64, count: int) -> Float64:
    """Return for each group of rows the sum (count, 3) of its faces' normals, each times twice the face's area."""
    return group_sums(faces.ravel(), np.repeat(face_normals(vertices, scene.faces), 3, axis=0), count)
