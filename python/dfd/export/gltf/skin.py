"""A skin whose joints are a session's handles.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 3.7.3. Vertices, normals and inverse binds are in the
coordinates of the scene, since a skin ignores node transforms.
"""

from __future__ import annotations

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.export.gltf.document import GltfDocument
from dfd.export.gltf.scene_space import animated_nodes, bring_to_scene, stand_alone
from dfd.export.influences import Influences
from dfd.export.joints import Local
from dfd.export.rig import Rig
from dfd.mesh.file.gltf.header import Header, objects, parents
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.mesh import Mesh

MOST_JOINTS = 65_535  # JOINTS_n has 16 bits
SET = 4  # influences in each pair of attributes


def parts_with_deformers(mesh: Mesh) -> tuple[str | None, str | None]:
    """The names of a part of the mesh's glTF file that has a skin, and of one with morph targets; None for none."""
    source = None if mesh.scene is None else mesh.scene.gltf
    if mesh.scene is None or source is None:
        return None, None
    nodes, meshes = objects(source.header, "nodes"), objects(source.header, "meshes")
    skinned, morphed = None, None
    for each in mesh.scene.primitives:
        node, number, _ = each.source
        skinned = skinned or (each.part if "skin" in nodes[node] else None)
        morphed = morphed or (each.part if any("targets" in one for one in meshes[number]["primitives"]) else None)
    return skinned, morphed


def left_behind(document: GltfDocument) -> list[str]:
    """The parts that animations of the file move by a node of theirs or above, which a skin ignores."""
    parent = parents(document.header)
    moved = animated_nodes(document.header)
    found = []
    for node, primitives in document.parts():
        above: int | None = node
        while above is not None and above not in moved:
            above = parent.get(above)
        if above is not None:
            found.append(primitives[0].part)
    return found


def add_joints(document: GltfDocument, rig: Rig, locals_: list[Local]) -> list[int]:
    """Append a node for each joint, the root to the scene and all others as its children; return their numbers."""
    numbers = []
    for joint, local in zip(rig.joints, locals_, strict=True):
        node: Header = {"name": joint.name}
        if joint is not rig.joints[0]:
            parts = (("translation", local.translation), ("rotation", local.rotation), ("scale", local.scale))
            node |= {name: _plain(values) for name, values in parts}
        numbers.append(document.append("nodes", node))
    if numbers[1:]:
        document.header["nodes"][numbers[0]]["children"] = numbers[1:]
    return numbers


def add_skin(document: GltfDocument, rig: Rig, influences: Influences, binds: Float32, joints: list[int]) -> None:
    """Bind all displayed nodes to the nodes `joints` with inverse binds (J, 4, 4)."""
    skin = document.append(
        "skins",
        {"name": "dfd", "joints": joints, "inverseBindMatrices": document.accessor(binds), "skeleton": joints[0]},
    )
    skinned = []
    for node, primitives in document.parts():
        bring_to_scene(document, node, primitives[0].transform)
        weigh(document, node, primitives, influences, len(rig.joints), rig.default)
        skinned.append(node)
    for node in skinned:
        document.header["nodes"][stand_alone(document, node)]["skin"] = skin
    scene = document.header["scenes"][document.header["scene"]]
    scene["nodes"].append(joints[0])


def weigh(
    document: GltfDocument, node: int, primitives: list[Primitive], influences: Influences, count: int, default: int
) -> None:
    """Write joints and weights of a node's primitives; rows without weights, which no face uses, follow D₀."""
    dtype = "u1" if count <= 256 else "<u2"
    known = {each.source[2]: each for each in primitives}
    done: dict[int, dict[str, int]] = {}
    for number, content in enumerate(document.own_mesh(node)["primitives"]):
        attributes = content["attributes"]
        position = int(attributes["POSITION"])
        if position not in done:
            rows = int(document.header["accessors"][position]["count"])
            vertex = document.rows(known[number]) if number in known else np.full(rows, -1)
            joints, weights = _at(influences, vertex, default)
            done[position] = {}
            for first in range(0, joints.shape[1], SET):
                some = slice(first, first + SET)
                done[position][f"JOINTS_{first // SET}"] = document.accessor(
                    joints[:, some].astype(dtype), attribute=True
                )
                done[position][f"WEIGHTS_{first // SET}"] = document.accessor(weights[:, some], attribute=True)
        for name in [name for name in attributes if name.startswith(("JOINTS_", "WEIGHTS_"))]:
            del attributes[name]
        attributes |= done[position]


def _at(influences: Influences, vertex: Int64, default: int) -> tuple[Int64, Float32]:
    """Joints and weights of rows that are at vertices, -1 for none; in whole sets of four."""
    width = -(-influences.joints.shape[1] // SET) * SET
    joints = np.zeros((len(vertex), width), np.int64)
    weights = np.zeros((len(vertex), width), np.float32)
    there = vertex >= 0
    joints[there, : influences.joints.shape[1]] = influences.joints[vertex[there]]
    weights[there, : influences.joints.shape[1]] = influences.weights[vertex[there]]
    joints[~there, 0] = default
    weights[~there, 0] = 1.0
    return joints, weights


def _plain(values: Float64) -> list[float]:
    return [float(value) for value in values]
