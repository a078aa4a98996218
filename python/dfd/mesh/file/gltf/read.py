"""What a glTF file shows: the triangles of its meshes, at the nodes of its scene.

The format: Khronos Group, "glTF 2.0 Specification", 2021.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.visual import TextureVisuals

from dfd.mesh.appearance import Material
from dfd.mesh.file.assets import AssetFolder, shortened
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import Header, is_index, objects, primitives
from dfd.mesh.file.gltf.materials import GltfMaterials
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.primitives import MeshInstance, UniqueNames

__all__ = ["from_below", "read", "triangles", "world_transforms"]

_STRIP, _FAN = 5, 6


def read(header: Header, data: GltfData, assets: AssetFolder) -> tuple[list[MeshInstance], dict[int, Material]]:
    """Return what the scene places, node after node in the file's order, and how it looks.

    The looks are those of the geometries' materials, by the materials' ids.

    Raises
    ------
    ValueError, OSError
        If a primitive that is shown cannot be read.
    """
    shown = world_transforms(header)
    materials = GltfMaterials(header, data, ImageCache(), assets.unreadable)
    looks: dict[int, Material] = {}
    geometries: dict[int, list[tuple[int, str, trimesh.Trimesh]]] = {}
    meshes, names, taken = objects(header, "meshes"), UniqueNames(), UniqueNames()
    of_mesh: dict[int, list[tuple[int, Header]]] = {}
    for mesh, number, primitive in primitives(header):
        of_mesh.setdefault(mesh, []).append((number, primitive))
    instances: list[MeshInstance] = []
    for node in sorted(shown):
        content = header["nodes"][node]
        mesh = content.get("mesh")
        if not is_index(mesh, len(meshes)):
            continue
        mesh_name = str(meshes[mesh].get("name") or "")
        if mesh not in geometries:
            geometries[mesh] = []
            for number, primitive in of_mesh.get(mesh, []):
                geometry = _geometry(primitive, data, materials, looks)
                geometries[mesh].append((number, names.unique(mesh_name or "mesh"), geometry))
        part = taken.unique(str(content.get("name") or mesh_name or f"node {node}"))
        transform = None if np.array_equal(shown[node], np.eye(4)) else shown[node]
        for number, name, geometry in geometries[mesh]:
            instances.append(MeshInstance(part, name, geometry, transform, (node, mesh, number)))
    return instances, looks


def _geometry(
    primitive: Header, data: GltfData, materials: GltfMaterials, looks: dict[int, Material]
) -> trimesh.Trimesh:
    attributes = primitive["attributes"]
    packed = data.draco(primitive) or {}

    def values(name: str, width: int) -> NDArray[Any] | None:
        """Return an attribute, None where there is none of that width for every vertex."""
        if name not in packed and name not in attributes:
            return None
        found = packed[name] if name in packed else data.accessor(attributes[name])
        fits = found.shape == (len(vertices), width) if width else len(found) == len(vertices)
        return found if fits else None

    vertices = packed["POSITION"] if packed else data.accessor(attributes["POSITION"])
    if vertices.shape[1] != 3:
        raise ValueError(f"the positions of a primitive have {vertices.shape[1]} coordinates")
    if "indices" in packed:
        indices = packed["indices"].ravel()
    elif "indices" in primitive:
        indices = data.accessor(primitive["indices"]).ravel()
    else:
        indices = np.arange(len(vertices))
    surface = materials.of(primitive)
    colors, normals = values("COLOR_0", 0), values("NORMAL", 3)
    options: dict[str, Any] = {}
    if surface is not None:
        looks[id(surface.material)] = surface.look
        uv = values(f"TEXCOORD_{surface.uv_set}", 2)
        visual = TextureVisuals(
            uv=None if uv is None else from_below(uv, surface.uv_transform), material=surface.material
        )
        if colors is not None:
            visual.vertex_attributes["color"] = np.array(colors)
        options["visual"] = visual
    elif colors is not None and colors.shape[1] in (3, 4):
        options["vertex_colors"] = np.array(colors)
    if normals is not None:
        options["vertex_normals"] = normals.astype(np.float64)
    own = {name: values(name, 0) for name in attributes if name.startswith("_")}
    return trimesh.Trimesh(
        vertices.astype(np.float64),
        triangles(indices, primitive.get("mode", 4)),
        vertex_attributes={name: np.array(each) for name, each in own.items() if each is not None},
        process=False,
        **options,
    )


def triangles(indices: NDArray[Any], mode: int) -> NDArray[np.int64]:
    """Return the triangles (F, 3) of a list, a strip or a fan."""
    numbers = indices.astype(np.int64)
    if mode == _STRIP:
        faces = np.stack([numbers[:-2], numbers[1:-1], numbers[2:]], axis=1)
        faces[1::2] = faces[1::2, [1, 0, 2]]
        return faces
    if mode == _FAN:
        return np.stack([np.repeat(numbers[:1], max(len(numbers) - 2, 0)), numbers[1:-1], numbers[2:]], axis=1)
    if len(numbers) % 3:
        raise ValueError(f"a primitive of triangles has {len(numbers)} corners")
    return numbers.reshape(-1, 3)


def from_below(uv: NDArray[Any], transform: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return texture coordinates with v upwards of glTF's, which point down."""
    with np.errstate(invalid="ignore", over="ignore"):
        placed = uv.astype(np.float64)
        if transform is not None:
            placed = placed @ transform[:, :2].T + transform[:, 2]
        placed[:, 1] = 1 - placed[:, 1]
    return placed


def world_transforms(header: Header) -> dict[int, NDArray[np.float64]]:
    """Return the nodes of the scene with their transforms (4, 4)."""
    nodes, scenes = objects(header, "nodes"), objects(header, "scenes")
    if scenes:
        index = header.get("scene", 0)
        if not is_index(index, len(scenes)):
            raise ValueError(f"its scene is {shortened(index)}, but there are {len(scenes)}")
        roots = scenes[index].get("nodes", [])
        if not isinstance(roots, list) or not all(is_index(each, len(nodes)) for each in roots):
            raise ValueError("its scene has nodes that are not there")
    else:
        below = {child for node in nodes for child in node.get("children", [])}
        roots = [i for i in range(len(nodes)) if i not in below]
    found: dict[int, NDArray[np.float64]] = {}
    layer = [(int(root), np.eye(4)) for root in roots]
    with np.errstate(over="ignore", invalid="ignore"):  # judged where something is shown
        while layer:
            node, parent = layer.pop()
            if node not in found:
                found[node] = parent @ _local_transform(nodes[node], node)
                layer.extend((child, found[node]) for child in nodes[node].get("children", []))
    return found


def _local_transform(node: Header, index: int) -> NDArray[np.float64]:
    """Return the transform (4, 4) of a node from its parent's coordinates: its matrix, or T · R · S."""

    def numbers(name: str, default: list[float]) -> NDArray[np.float64]:
        values = node.get(name, default)
        if not isinstance(values, list) or len(values) != len(default):
            raise ValueError(f"node {index} has {name} {shortened(values)}")
        if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in values):
            raise ValueError(f"node {index} has {name} {shortened(values)}")
        return np.array(values, np.float64)

    if "matrix" in node:
        return cast("NDArray[np.float64]", numbers("matrix", [0.0] * 16).reshape(4, 4).T)
    result = np.eye(4)
    result[:3, :3] = _rotation(numbers("rotation", [0.0, 0.0, 0.0, 1.0])) * numbers("scale", [1.0, 1.0, 1.0])
    result[:3, 3] = numbers("translation", [0.0, 0.0, 0.0])
    return result


def _rotation(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix (3, 3) of a quaternion x, y, z, w of any length; the identity for one of none."""
    length = float(np.linalg.norm(quaternion))
    if not 0 < length < np.inf:
        return np.eye(3)
    x, y, z, w = quaternion / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
