"""Apply the transforms of nodes to their meshes, because a skin needs vertices in the coordinates of the scene."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64
from dfd.export.gltf.document import GltfDocument
from dfd.mesh.file.gltf.header import MODES_READ, Header
from dfd.mesh.file.gltf.read import triangles


def bring_to_scene(document: GltfDocument, node: int, transform: Float64) -> None:
    """Apply `transform` (4, 4) to the positions, normals, tangents and morph targets of a node's mesh.

    If the transform mirrors, the order of the corners of each triangle is reversed.
    """
    if np.array_equal(transform, np.eye(4)):
        return
    mesh = document.own_mesh(node)
    done: dict[tuple[str, int], int] = {}
    for number, primitive in enumerate(mesh["primitives"]):
        attributes = primitive["attributes"]
        for name in ("POSITION", "NORMAL", "TANGENT"):
            values = document.values(node, number, name)
            if values is not None:
                key = (name, int(attributes[name]))
                if key not in done:
                    done[key] = _write(document, name, _transformed(name, values, transform))
                attributes[name] = done[key]
        for target in primitive.get("targets", []):
            for name in sorted(target.keys() & {"POSITION", "NORMAL", "TANGENT"}):
                key = (f"target {name}", int(target[name]))
                if key not in done:
                    moved = _turned(name, document.source.accessor(target[name]).astype(np.float64), transform)
                    done[key] = _write(document, name, moved)
                target[name] = done[key]
        if np.linalg.det(transform[:3, :3]) < 0:
            _reverse_corners(document, node, number, primitive)


def _transformed(name: str, values: NDArray[Any], transform: Float64) -> Float64:
    if name == "POSITION":
        return values.astype(np.float64) @ transform[:3, :3].T + transform[:3, 3]
    turned = _turned(name, values[:, :3].astype(np.float64), transform)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    unit: Float64 = np.divide(turned, length, out=values[:, :3].astype(np.float64), where=length > 0)
    if name == "TANGENT":
        side = np.sign(np.linalg.det(transform[:3, :3])) or 1.0
        return np.column_stack([unit, values[:, 3] * side])
    return unit


def _turned(name: str, vectors: Float64, transform: Float64) -> Float64:
    """Apply `transform` to vectors (N, 3): its inverse transpose to normals, its linear part to all other vectors."""
    linear = transform[:3, :3]
    return vectors @ (np.linalg.pinv(linear) if name == "NORMAL" else linear.T)


def _write(document: GltfDocument, name: str, values: Float64) -> int:
    return document.accessor(values.astype("<f4"), attribute=True, bounds=name == "POSITION")


def _reverse_corners(document: GltfDocument, node: int, number: int, primitive: Header) -> None:
    """Reverse the order of the corners of every triangle of a primitive."""
    mode = primitive.get("mode", 4)
    if mode not in MODES_READ:
        return
    faces = triangles(document.corners(node, number), mode)
    primitive["indices"] = document.accessor(faces[:, [0, 2, 1]].astype("<u4").ravel())
    primitive["mode"] = 4
