"""What a skinned glTF file says about its vertices: the joint that moves each the most."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pygltflib

COMPONENTS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def strongest_joints(path: Path) -> tuple[NDArray[np.float64], list[str]]:
    """Positions (N, 3) of all skinned vertices of a GLB file, where its scene puts them, and each one's joint by name.

    Both are empty where nothing is skinned.

    Raises
    ------
    ValueError
        If the file's numbers are stored in a way that is not read here.
    """
    import pygltflib

    try:
        document = pygltflib.GLTF2().load_binary(str(path))
    except struct.error as error:
        raise ValueError(f"strongest_joints: {path.name} is cut short: {error}") from None
    places, joints = [np.empty((0, 3))], []
    for transform, node in nodes_in_place(document):
        if node.mesh is None or node.skin is None:
            continue
        names = [document.nodes[joint].name or "" for joint in document.skins[node.skin].joints]
        for primitive in document.meshes[node.mesh].primitives:
            position = read(document, primitive.attributes.POSITION).astype(np.float64)
            places.append(position @ transform[:3, :3].T + transform[:3, 3])
            joints += [names[index] for index in _strongest(document, primitive.attributes)]
    return np.concatenate(places), joints


def nodes_in_place(document: pygltflib.GLTF2) -> list[tuple[NDArray[np.float64], pygltflib.Node]]:
    """All nodes of the scene, each with its matrix (4, 4) to the scene's coordinates."""
    found = []
    waiting = [(np.eye(4), index) for index in document.scenes[document.scene or 0].nodes]
    while waiting:
        outer, index = waiting.pop()
        node = document.nodes[index]
        transform = outer @ _local(node)
        found.append((transform, node))
        waiting += [(transform, child) for child in node.children or []]
    return found


def read(document: pygltflib.GLTF2, index: int) -> NDArray[np.generic]:
    """The numbers of an accessor, one row an element."""
    accessor = document.accessors[index]
    if accessor.bufferView is None or accessor.sparse is not None or accessor.componentType not in COMPONENTS:
        raise ValueError("strongest_joints: sparse or compressed accessors are not read here")
    view = document.bufferViews[accessor.bufferView]
    dtype, width = np.dtype(COMPONENTS[accessor.componentType]), WIDTHS[accessor.type]
    start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
    stride = view.byteStride or dtype.itemsize * width
    blob = np.frombuffer(document.binary_blob(), np.uint8)
    if start + stride * (accessor.count - 1) + dtype.itemsize * width > len(blob):
        raise ValueError("strongest_joints: an accessor reaches past the end of the file")
    rows = np.lib.stride_tricks.as_strided(blob[start:], (accessor.count, dtype.itemsize * width), (stride, 1))
    return np.ascontiguousarray(rows).view(dtype)


def _strongest(document: pygltflib.GLTF2, attributes: pygltflib.Attributes) -> NDArray[np.integer]:
    """Index (N,) into the skin's joints of the one with the largest weight, over all sets of four."""
    weights, joints = [], []
    for number in range(8):
        weight, joint = (getattr(attributes, f"{kind}_{number}", None) for kind in ("WEIGHTS", "JOINTS"))
        if weight is None or joint is None:
            break
        weights.append(read(document, weight))
        joints.append(read(document, joint))
    if not weights:
        raise ValueError("strongest_joints: a skinned part has no WEIGHTS_0 and JOINTS_0")
    all_weights, all_joints = np.concatenate(weights, axis=1), np.concatenate(joints, axis=1)
    return np.take_along_axis(all_joints, all_weights.argmax(axis=1)[:, None], axis=1)[:, 0]


def _local(node: pygltflib.Node) -> NDArray[np.float64]:
    if node.matrix is not None:
        return np.array(node.matrix, np.float64).reshape(4, 4).T
    x, y, z, w = node.rotation or (0.0, 0.0, 0.0, 1.0)
    transform = np.eye(4)
    transform[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    transform[:3, :3] *= np.array(node.scale or (1.0, 1.0, 1.0))
    transform[:3, 3] = node.translation or (0.0, 0.0, 0.0)
    return transform
