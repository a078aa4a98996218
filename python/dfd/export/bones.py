"""The bones of a character: joints and weights of the skin of a glTF file.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 3.7.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.mesh.file.gltf.header import Header, is_index, objects, parents
from dfd.mesh.file.gltf.read import world_transforms
from dfd.mesh.file.gltf.rest import inverse_binds, joints_and_weights
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.mesh import Mesh

LEAF = 0.5  # of the parent bone: the length of a bone that ends in no joint


@dataclass(frozen=True, eq=False)
class Bones:
    """The joints of a skin in its bind pose, in which limbs do not touch, rather than in the file's rest pose."""

    mesh: Mesh  # the vertices and faces of the mesh in its bind pose
    names: tuple[str, ...]  # (J) of the joints' nodes
    starts: Float64  # (B, 3) lines in mesh units, from a joint to the next ones below it
    ends: Float64  # (B, 3)
    joint: Int64  # (B,) the joint of each line
    weights: Float64  # (V, J) the file's weights; 0 for vertices of parts without the skin
    skinned: Bool  # (V,) which vertices are of parts with the skin
    primitives: tuple[Primitive, ...]  # those parts


def bones_of(mesh: Mesh) -> Bones:
    """The bones of the skin of a mesh's file.

    Raises ValueError if the mesh is from no glTF file, its file has no skin, several with other joints, or one that is
    broken.
    """
    source = None if mesh.scene is None else mesh.scene.gltf
    if mesh.scene is None or source is None:
        raise ArgumentError("mesh", "must be from a glTF file with a skin, got one of another kind", "weigh_skin")
    header, data = source.header, source.data
    nodes = objects(header, "nodes")
    skinned = tuple(each for each in mesh.scene.primitives if "skin" in nodes[each.source[0]])
    if not skinned:
        raise ArgumentError("mesh", "must have a skin, got none in its file", "weigh_skin")
    skins = objects(header, "skins")
    numbers = [nodes[each.source[0]]["skin"] for each in skinned]
    if not all(is_index(number, len(skins)) for number in numbers):
        raise ArgumentError("mesh", "names a skin that is not in its file", "weigh_skin")
    joints = skins[numbers[0]].get("joints")
    if not isinstance(joints, list) or not joints or not all(is_index(each, len(nodes)) for each in joints):
        raise ArgumentError("mesh", "has a skin whose joints are not in its file", "weigh_skin")
    if any(skins[number].get("joints") != joints for number in numbers):
        raise ArgumentError("mesh", "must have one skin, got several with other joints", "weigh_skin")
    world = world_transforms(header)
    vertices, weights = mesh.vertices.copy(), np.zeros((len(mesh.vertices), len(joints)))
    followed = np.zeros(len(mesh.vertices), bool)
    try:
        inverse = inverse_binds(skins[numbers[0]], data)
        for each in mesh.scene.primitives:
            node, number, primitive = each.source
            vertex = mesh.scene.vertex[each.rows]
            there = vertex >= 0
            stored = each.geometry.vertices if each.geometry.stored is None else each.geometry.stored
            vertices[vertex[there]] = (stored @ world[node][:3, :3].T + world[node][:3, 3])[there]
            if "skin" in nodes[node]:
                own = np.zeros((len(vertex), len(joints)))
                content = header["meshes"][number]["primitives"][primitive]
                for column, weight in joints_and_weights(content, data, len(vertex), len(joints)):
                    np.add.at(own, (np.arange(len(vertex))[:, None], column), weight)
                weights[vertex[there]] = own[there]
                followed[vertex[there]] = True
    except ValueError as error:
        raise ArgumentError("mesh", f"has a skin that cannot be read: {error}", "weigh_skin") from error
    try:
        positions = (world[skinned[0].source[0]] @ np.linalg.inv(inverse))[:, :3, 3]
    except np.linalg.LinAlgError:
        positions = np.full((len(joints), 3), np.nan)
    if not np.isfinite(positions).all():
        raise ArgumentError("mesh", "has a skin with an inverse bind that cannot be inverted", "weigh_skin")
    starts, ends, joint = _lines(positions, _parents(header, joints))
    names = tuple(str(nodes[each].get("name") or f"node {each}") for each in joints)
    return Bones(Mesh(vertices, mesh.faces), names, starts, ends, joint, weights, followed, skinned)


def _parents(header: Header, joints: list[int]) -> list[int]:
    """(J) the joint that is next above each, -1 for none."""
    above = parents(header)
    number = {node: index for index, node in enumerate(joints)}
    found = []
    for node in joints:
        parent = above.get(node)
        while parent is not None and parent not in number:
            parent = above.get(parent)
        found.append(-1 if parent is None else number[parent])
    return found


def _lines(positions: Float64, parents: list[int]) -> tuple[Float64, Float64, Int64]:
    """The bones: from each joint to its children; one without children extends its parent bone."""
    lines = [(parent, positions[parent], positions[child]) for child, parent in enumerate(parents) if parent >= 0]
    ends = set(range(len(positions))) - set(parents)
    for joint in sorted(ends):
        before = positions[joint] - positions[parents[joint]] if parents[joint] >= 0 else np.zeros(3)
        lines.append((joint, positions[joint], positions[joint] + LEAF * before))
    numbers, starts, stops = zip(*lines, strict=True)
    return np.array(starts), np.array(stops), np.array(numbers, np.int64)
