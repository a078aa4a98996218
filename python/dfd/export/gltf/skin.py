"""Add a skin to a glTF file, with joints for the handles of a session.

The format: Khronos Group, "glTF 2.0 Specification", 2021, section 3.7.3. Vertices, normals and inverse bind matrices
are in the coordinates of the scene, because viewers ignore the transform of a node that has a skin.
"""

import numpy as np

from dfd.common.linear_algebra import Float32, Int64
from dfd.export.gltf.document import GltfDocument
from dfd.export.gltf.scene_space import bring_to_scene
from dfd.export.rig import Rig
from dfd.export.skinning import Skin
from dfd.mesh.file.gltf.header import Header, animated_nodes, objects, parents
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.mesh import Mesh

MOST_JOINTS = 65_535  # the attributes JOINTS_n store 16-bit indices
SET = 4  # number of influences in each pair of attributes JOINTS_n and WEIGHTS_n


def parts_with_deformers(mesh: Mesh) -> tuple[str | None, str | None]:
    """Return the names of the first part with a skin and the first part with morph targets; None if there is none."""
    if mesh.scene is None or mesh.scene.gltf is None:
        return None, None
    nodes, meshes = (objects(mesh.scene.gltf.header, name) for name in ("nodes", "meshes"))
    morphed = [any("targets" in primitive for primitive in each.get("primitives", [])) for each in meshes]
    names = [(each.part, each.source) for each in mesh.scene.primitives]
    return (
        next((part for part, (node, _, _) in names if "skin" in nodes[node]), None),
        next((part for part, (_, number, _) in names if morphed[number]), None),
    )


def left_behind(document: GltfDocument) -> list[str]:
    """Return the names of scene parts that animated nodes move. With a skin, these parts ignore the animations."""
    parent = parents(document.header)
    moved = animated_nodes(document.header)
    found = []
    for node, primitives in document.parts().items():
        above: int | None = node
        while above is not None and above not in moved:
            above = parent.get(above)
        if above is not None:
            found.append(primitives[0].part)
    return found


def add_skin(document: GltfDocument, rig: Rig, skin: Skin) -> list[int]:
    """Add a node for each joint of a rig, bind all displayed meshes to the joints, and return the new nodes' indices.

    The root joint is a root of the scene, at the rig's origin. All other joints are its children.
    """
    joints = []
    for joint, local in zip(rig.joints, skin.moments[0], strict=True):
        content: Header = {"name": joint.name}
        if joint is not rig.joints[0]:
            parts = (("translation", local.translation), ("rotation", local.rotation), ("scale", local.scale))
            content |= {name: values.tolist() for name, values in parts}
        elif rig.origin.any():
            content["translation"] = rig.origin.tolist()
        joints.append(document.append("nodes", content))
    if joints[1:]:
        document.header["nodes"][joints[0]]["children"] = joints[1:]
    content = {"name": "dfd", "joints": joints, "skeleton": joints[0]}
    number = document.append("skins", content | {"inverseBindMatrices": document.accessor(skin.binds)})
    shift = np.eye(4)
    shift[:3, 3] = -rig.origin
    for node, primitives in document.parts().items():
        bring_to_scene(document, node, shift @ primitives[0].transform)
        _weigh(document, node, primitives, skin, rig)
    for node in document.parts():
        document.header["nodes"][document.stand_alone(node)]["skin"] = number
    document.header["scenes"][document.header["scene"]]["nodes"].append(joints[0])
    return joints


def _weigh(document: GltfDocument, node: int, primitives: list[Primitive], skin: Skin, rig: Rig) -> None:
    """Write the joints and weights of a node's primitives. Vertices without faces follow the joint `rig.default`."""
    dtype = "u1" if len(rig.joints) <= 256 else "<u2"
    contents = document.own_mesh(node)["primitives"]
    done: dict[int, dict[str, int]] = {}
    for position, vertex in document.vertex_of_positions(primitives).items():
        joints, weights = _at(skin, vertex, rig.default)
        done[position] = {}
        for first in range(0, joints.shape[1], SET):
            some = slice(first, first + SET)
            own = (("JOINTS", joints[:, some].astype(dtype)), ("WEIGHTS", weights[:, some]))
            done[position] |= {
                f"{name}_{first // SET}": document.accessor(values, attribute=True) for name, values in own
            }
    for each in primitives:
        attributes = contents[each.source[2]]["attributes"]
        for name in [name for name in attributes if name.startswith(("JOINTS_", "WEIGHTS_"))]:
            del attributes[name]
        attributes |= done[int(attributes["POSITION"])]


def _at(skin: Skin, vertex: Int64, default: int) -> tuple[Int64, Float32]:
    """Return joints and weights (R, K) of R rows; K is a multiple of 4. `vertex` (R,) has each row's vertex, or −1."""
    count = skin.joints.shape[1]
    joints = np.zeros((len(vertex), -(-count // SET) * SET), np.int64)
    weights = np.zeros(joints.shape, np.float32)
    there = vertex >= 0
    joints[there, :count], weights[there, :count] = skin.joints[vertex[there]], skin.weights[vertex[there]]
    joints[~there, 0], weights[~there, 0] = default, 1.0
    return joints, weights
