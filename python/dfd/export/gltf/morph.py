"""Make a morph target for each handle that moves. With key poses, make one for the edit and one for each pose instead.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 3.7.2.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64, Int64
from dfd.editing.edit import Edit
from dfd.export.gltf.document import GltfDocument
from dfd.export.gltf.scene_space import bring_to_scene
from dfd.export.rig import Rig
from dfd.mesh.file.gltf.header import Header, objects
from dfd.mesh.file.moved import moved_normals
from dfd.mesh.file.primitives import IDENTITY, Primitive
from dfd.posing.transforms import Transform


@dataclass(frozen=True, eq=False)
class MorphTargets:
    """Morph targets of a mesh, and their weights over time."""

    names: Sequence[str]
    shapes: Sequence[Float64]  # T arrays (V, 3), mesh units: the vertices if this target has weight 1 and all others 0
    weights: Float64  # (M, T) weights of the targets, in the edit and then at each key pose

    def shown(self, moment: int, rig: Rig) -> Float64:
        """Return the vertices (V, 3) for row `moment` of `weights`: resting positions plus weighted displacements."""
        rest = rig.mesh.vertices
        result = (rest - rig.origin).astype(np.float32) + rig.origin
        for weight, shape in zip(self.weights[moment], self.shapes, strict=True):
            if weight:
                result += weight * (shape - rest).astype(np.float32).astype(np.float64)
        return result


def targets_of(rig: Rig) -> MorphTargets:
    """Return the targets of a rig: one for each handle that moves, and one for the default transform D₀ if it moves.

    If the rig has key poses, return one target for the edit and one for each key pose instead. Raises ValueError if
    nothing moves and there is no key pose.
    """
    if rig.poses:
        poses = list(rig.moments())
        return MorphTargets([name for name, _ in poses], [rig.posed(edit) for _, edit in poses], np.eye(len(poses)))
    names = {joint.handle: joint.name for joint in reversed(rig.joints)}  # a handle has the name of its first joint
    moving = [each.id for each in rig.edit.handles if each.id in names and not each.transform.rests]
    edits = {names[handle]: _alone(rig.edit, handle) for handle in moving}
    if rig.edit.default is not None and not rig.edit.default.rests:
        edits["default"] = replace(_alone(rig.edit, None), default=rig.edit.default)
    if not edits:
        why = "must have a handle that moves, because morph targets store displacements, but all are at rest"
        raise ArgumentError("session", why, "export_rig")
    return MorphTargets(list(edits), [rig.posed(edit) for edit in edits.values()], np.ones((1, len(edits))))


def add_targets(document: GltfDocument, rig: Rig, targets: MorphTargets) -> list[int]:
    """Add targets and the edit's weights to all displayed meshes, which must have no targets. Return their nodes."""
    rest = _document_positions(document, rig.mesh.vertices)
    moved = [_document_positions(document, shape) for shape in targets.shapes]
    normals = [moved_normals(each, rest, document.scene) for each in moved]
    of_faces = {id(each): number for number, each in enumerate(document.scene.primitives)}
    nodes = []
    for node, primitives in document.parts().items():
        flat = primitives[0].transform.ndim == 2 and np.linalg.matrix_rank(primitives[0].transform[:3, :3]) < 3
        if flat:  # local coordinates cannot store displacements out of a plane
            bring_to_scene(document, node, primitives[0].transform)
            primitives = [replace(each, transform=IDENTITY) for each in primitives]
        mesh = document.own_mesh(node)
        rows = document.vertex_of_positions(primitives)
        done: dict[tuple[int, int | None], list[Header]] = {}
        for each, old in zip(primitives, document.parts()[node], strict=True):
            content = mesh["primitives"][each.source[2]]
            attributes = content["attributes"]
            key = (int(attributes["POSITION"]), attributes.get("NORMAL"))
            number = of_faces.get(id(old))
            if key not in done:
                done[key] = [
                    _target(
                        document,
                        each,
                        (shape - rig.mesh.vertices),
                        rows[key[0]],
                        None if number is None else new[number],
                    )
                    for shape, new in zip(targets.shapes, normals, strict=True)
                ]
            content["targets"] = [dict(target) for target in done[key]]
        mesh["weights"] = targets.weights[0].tolist()
        extras = mesh.setdefault("extras", {})
        if isinstance(extras, dict):
            extras["targetNames"] = list(targets.names)  # Blender, three.js and others read names from here
        objects(document.header, "nodes")[node].pop("weights", None)
        nodes.append(document.stand_alone(node) if flat else node)
    return nodes


def _alone(edit: Edit, handle: int | None) -> Edit:
    """Return `edit` without D₀, and with all handles at rest except `handle`, which may be None."""
    rest = Transform()
    handles = tuple(each if each.id == handle else replace(each, transform=rest) for each in edit.handles)
    return replace(edit, handles=handles, default=None)


def _target(document: GltfDocument, primitive: Primitive, moved: Float64, vertex: Int64, new: Float64 | None) -> Header:
    """Return a morph target of a primitive: displacements of its positions and normals, in local coordinates.

    `moved` (V, 3) are the displacements of the mesh vertices, `vertex` (N,) is the mesh vertex of each of the
    primitive's rows, or −1, and `new` (N, 3) are its new normals.
    """
    old = primitive.geometry.normals
    local = primitive.vectors_from_scene(np.where(vertex[:, None] >= 0, moved[vertex], 0.0))
    target = {"POSITION": document.zeros(len(vertex))}
    if local.any():
        target = {"POSITION": document.accessor(local.astype("<f4"), attribute=True, bounds=True)}
    if old is not None and new is not None and (new != old).any():
        target["NORMAL"] = document.accessor((new - old).astype("<f4"), attribute=True)
    return target


def _document_positions(document: GltfDocument, vertices: Float64) -> Float64:
    """Return the positions of the vertices of `document.scene` if the mesh moves to `vertices` (V, 3)."""
    scene = document.scene
    result = scene.vertices.copy()
    known = (scene.vertex >= 0) & (document.vertex >= 0)
    result[scene.vertex[known]] = vertices[document.vertex[known]]
    return result
