"""The bones of a character: what the skin of a glTF file says of its joints, and whom the vertices follow.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 3.7.3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.mesh.file.gltf.header import Header, is_index, objects
from dfd.mesh.file.gltf.read import world_transforms

if TYPE_CHECKING:
    from dfd.mesh.file.gltf.data import GltfData
    from dfd.mesh.file.primitives import Primitive
    from dfd.mesh.file.scene_file import SceneFile
    from dfd.mesh.mesh import Mesh

__all__ = ["Bones", "bones_of"]

LEAF = 0.5  # of the bone before it: the length of a bone that ends in no other joint

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bones:
    """The joints of a skin, where the mesh rests.

    Attributes
    ----------
    names
        (J) those of the joints' nodes.
    starts, ends, joint
        (B, 3), (B, 3) and (B,) lines in mesh units, from a joint to the next ones below it, and the joint of each.
    weights
        (V, J) how the file's vertices follow the joints; 0 for vertices of parts without the skin.
    skinned
        (V,) which vertices are of parts with the skin.
    primitives
        Those parts.
    """

    names: tuple[str, ...]
    starts: Float64
    ends: Float64
    joint: NDArray[np.int64]
    weights: Float64
    skinned: NDArray[np.bool_]
    primitives: tuple[Primitive, ...]


def bones_of(mesh: Mesh) -> Bones:
    """The bones of the skin of a mesh's file.

    Raises
    ------
    ValueError
        If the mesh is from no glTF file, its file has no skin, several with other joints, or one that is broken.
    """
    source = None if mesh.scene is None else mesh.scene.gltf
    if mesh.scene is None or source is None:
        raise ValueError("weigh_skin: `mesh` must be from a glTF file with a skin, got one of another kind")
    header, data = source.header, source.data
    nodes = objects(header, "nodes")
    skinned = tuple(each for each in mesh.scene.primitives if "skin" in nodes[each.source[0]])
    if not skinned:
        raise ValueError("weigh_skin: `mesh` must have a skin, got none in its file")
    skins = objects(header, "skins")
    numbers = [nodes[each.source[0]]["skin"] for each in skinned]
    if not all(is_index(number, len(skins)) for number in numbers):
        raise ValueError("weigh_skin: `mesh` names a skin that is not in its file")
    joints = skins[numbers[0]].get("joints")
    if not isinstance(joints, list) or not joints or not all(is_index(each, len(nodes)) for each in joints):
        raise ValueError("weigh_skin: `mesh` has a skin whose joints are not in its file")
    if any(skins[number].get("joints") != joints for number in numbers):
        raise ValueError("weigh_skin: `mesh` must have one skin, got several with other joints")
    starts, ends, joint = _lines(_places(mesh.scene, skins[numbers[0]], skinned[0]), _parents(nodes, joints))
    weights = np.zeros((len(mesh.vertices), len(joints)))
    followed = np.zeros(len(mesh.vertices), bool)
    for each in skinned:
        vertex = mesh.scene.vertex[each.rows]
        there = vertex >= 0
        weights[vertex[there]] = _file_weights(header, data, each, len(joints))[there]
        followed[vertex[there]] = True
    names = tuple(str(nodes[each].get("name") or f"node {each}") for each in joints)
    return Bones(names, starts, ends, joint, weights, followed, skinned)


def _places(scene: SceneFile, skin: Header, primitive: Primitive) -> Float64:
    """(J, 3) where joints stand when the mesh rests, mesh units."""
    assert scene.gltf is not None
    header, data = scene.gltf.header, scene.gltf.data
    count = len(skin["joints"])
    if scene.at_rest:
        world = world_transforms(header)
        found: Float64 = np.stack([world[joint][:3, 3] for joint in skin["joints"]])
        return found
    inverse = np.tile(np.eye(4), (count, 1, 1))
    if "inverseBindMatrices" in skin:
        stored = data.accessor(skin["inverseBindMatrices"])
        if stored.shape != (count, 16):
            raise ValueError(f"weigh_skin: `mesh` has a skin of {count} joints with {len(stored)} inverse binds")
        inverse = stored.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
    try:
        binds = np.linalg.inv(inverse)
    except np.linalg.LinAlgError:
        binds = np.full_like(inverse, np.nan)
    if not np.isfinite(binds).all():
        raise ValueError("weigh_skin: `mesh` has a skin with an inverse bind that cannot be inverted")
    # Loaded as it was bound, the mesh is where its node places it: bones are carried along.
    placed: Float64 = (world_transforms(header)[primitive.source[0]] @ binds)[:, :3, 3]
    return placed


def _parents(nodes: list[Header], joints: list[int]) -> list[int]:
    """(J) the joint that is next above each, -1 for none."""
    above = {child: index for index, node in enumerate(nodes) for child in node.get("children", [])}
    number = {node: index for index, node in enumerate(joints)}
    found = []
    for node in joints:
        parent = above.get(node)
        while parent is not None and parent not in number:
            parent = above.get(parent)
        found.append(-1 if parent is None else number[parent])
    return found


def _lines(places: Float64, parents: list[int]) -> tuple[Float64, Float64, NDArray[np.int64]]:
    """The bones: from each joint to those below it; one with none below goes on as the bone before it did."""
    lines = [(parent, places[parent], places[child]) for child, parent in enumerate(parents) if parent >= 0]
    ends = set(range(len(places))) - set(parents)
    for joint in sorted(ends):
        before = places[joint] - places[parents[joint]] if parents[joint] >= 0 else np.zeros(3)
        lines.append((joint, places[joint], places[joint] + LEAF * before))
    numbers, starts, stops = zip(*lines, strict=True)
    return np.array(starts), np.array(stops), np.array(numbers, np.int64)


def _file_weights(header: Header, data: GltfData, primitive: Primitive, count: int) -> Float64:
    """(rows, J) weights of a primitive's rows, zeros where the file has none."""
    _, mesh, number = primitive.source
    attributes: dict[str, Any] = header["meshes"][mesh]["primitives"][number]["attributes"]
    packed = data.draco(header["meshes"][mesh]["primitives"][number]) or {}
    rows = primitive.rows.stop - primitive.rows.start
    result = np.zeros((rows, count))
    for name in sorted(attributes):
        other = name.replace("WEIGHTS_", "JOINTS_")
        if not name.startswith("WEIGHTS_") or other not in attributes:
            continue
        weights, joints = (
            packed[each] if each in packed else data.accessor(attributes[each]) for each in (name, other)
        )
        if weights.shape != (rows, 4) or joints.shape != (rows, 4):
            raise ValueError(f"weigh_skin: `mesh` has {len(weights)} weights for {rows} vertices of {primitive.part!r}")
        if not np.isfinite(weights).all() or (joints[weights > 0] >= count).any():
            raise ValueError(f"weigh_skin: `mesh` has weights of {primitive.part!r} for joints that are not there")
        known = np.where(weights > 0, joints, 0).astype(np.int64)
        np.add.at(result, (np.arange(rows)[:, None], known), np.maximum(weights, 0.0))
    return result
