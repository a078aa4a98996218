"""Read the scene of a glTF file as viewers show it: the triangles of its nodes, in the rest pose.

The format: Khronos Group, "glTF 2.0 Specification", 2021; morph targets and skins: sections 3.7.2.2 and 3.7.3.
"""

from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64, Int64, unit
from dfd.mesh.colors import rgba, srgb
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import (
    MODES_READ,
    Header,
    are_numbers,
    drop_extension,
    extension,
    is_index,
    item,
    objects,
    parents,
)
from dfd.mesh.file.gltf.materials import Surface, read_surface
from dfd.mesh.file.primitives import IDENTITY, MOST_INSTANCES, MOST_PRIMITIVES, Geometry, MeshInstance
from dfd.mesh.file.scene_file import SceneFile
from dfd.mesh.file.shading import FLAT
from dfd.mesh.file.text import UniqueNames, shortened
from dfd.mesh.weld import weld

_STRIP, _FAN = 5, 6
INSTANCING, _VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_node_visibility"
_PLACING = ("translation", "rotation", "scale")
_SEAM = 1e-4  # widest gap at a seam that is closed, as a fraction of the bounding box's longest side


def read_scene(path: Path, data: bytes, assets: AssetFolder, at_rest: bool) -> SceneFile:
    """Return the scene of a GLB or glTF file, in the bind pose if `at_rest` is False; raise ValueError if malformed."""
    content = GltfData(data, assets)
    return SceneFile.of(path, read(content, at_rest=at_rest), gltf=content)


def read(data: GltfData, *, at_rest: bool = True) -> list[MeshInstance]:
    """Return the mesh instances of the scene, in the order of the file's nodes. Lines and points have no faces.

    With `at_rest`, skins and default morph weights are applied; otherwise both are ignored. In the header of `data`,
    nodes of EXT_mesh_gpu_instancing get a child for each instance.
    """
    expand_instances(data)
    header = data.header
    world = world_transforms(header)
    surface = cache(partial(read_surface, data))
    joints = cache(partial(joint_matrices, data=data, world=world))
    geometries: dict[tuple[int, tuple[float, ...]], list[tuple[int, str, Geometry]]] = {}
    meshes, names, taken = objects(header, "meshes"), UniqueNames(), UniqueNames()
    instances: list[MeshInstance] = []
    read_count = 0
    for node in sorted(shown_nodes(header)):
        content = header["nodes"][node]
        mesh = content.get("mesh")
        if not is_index(mesh, len(meshes)):
            continue
        mesh_name = str(meshes[mesh].get("name") or "")
        weights = morph_weights(content, meshes[mesh]) if at_rest else ()
        if (mesh, weights) not in geometries:
            drawn = [each for each in enumerate(objects(meshes[mesh], "primitives")) if is_read(each[1], data.header)]
            read_count += len(drawn)
            if read_count > MOST_PRIMITIVES:
                raise ValueError(f"its scene shows more than {MOST_PRIMITIVES} primitives")
            geometries[mesh, weights] = [
                (number, names.unique(mesh_name or "mesh"), _geometry(primitive, data, surface, weights))
                for number, primitive in drawn
            ]
        part = taken.unique(str(content.get("name") or mesh_name or f"node {node}"))
        placed = IDENTITY if np.array_equal(world[node], IDENTITY) else world[node]
        matrices = joints(content.get("skin")) if at_rest else None
        skinned = {} if matrices is None else _skinned(geometries[mesh, weights], meshes[mesh], data, matrices)
        for number, name, geometry in geometries[mesh, weights]:
            instances.append(MeshInstance(part, name, geometry, skinned.get(number, placed), (node, mesh, number)))
        if len(instances) > MOST_INSTANCES:
            raise ValueError(f"its scene places more than {MOST_INSTANCES} primitives")
    if not instances and meshes:
        held = f"{len(meshes)} mesh{'' if len(meshes) == 1 else 'es'}"
        what = f"holds {held}, but its scene shows none: no visible node of the scene has a mesh"
        raise ArgumentError("path", f"{what}; export the scene that has it, or set `scene` in the file")
    return instances


def _skinned(
    primitives: list[tuple[int, str, Geometry]], mesh: Header, data: GltfData, matrices: Float64
) -> dict[int, Float64]:
    """Return, by primitive index, the vertex transforms (rows, 4, 4) of each primitive that has skin weights."""
    found = {}
    for number, _, geometry in primitives:
        transforms = skin_transforms(mesh["primitives"][number], data, len(geometry.vertices), matrices)
        if transforms is not None:
            found[number] = transforms
    kept = [geometry.vertices for number, _, geometry in primitives if number in found]
    if kept and sum(map(len, kept)):
        joined = closed_seams(np.concatenate(kept), np.concatenate(list(found.values())))
        found = dict(zip(found, np.split(joined, np.cumsum([len(each) for each in kept])[:-1]), strict=True))
    return found


def _geometry(
    primitive: Header, data: GltfData, surfaces: Callable[[int], Surface], morph_weights: tuple[float, ...]
) -> Geometry:
    positions = data.attribute(primitive, "POSITION")
    assert positions is not None
    if positions.shape[1] != 3:
        raise ValueError(f"the positions of a primitive have {positions.shape[1]} coordinates")
    vertices = positions.astype(np.float64)
    shown = morphed(vertices, "POSITION", primitive, morph_weights, data)
    stored = None if shown is vertices else vertices
    if primitive.get("mode", 4) not in MODES_READ:
        return Geometry(shown, np.zeros((0, 3), np.int64), stored=stored)

    def values(name: str, *widths: int) -> NDArray[Any] | None:
        """Return the attribute `name`; None if it is missing or has another width. Missing rows are NaN."""
        found = data.attribute(primitive, name)
        if found is None or (widths and found.shape[1] not in widths):
            return None
        if len(found) < len(vertices):
            scale = np.iinfo(found.dtype).max if found.dtype.kind in "iu" and name.startswith("COLOR") else 1
            rest = np.full((len(vertices) - len(found), found.shape[1]), np.nan)
            found = np.concatenate([found / scale, rest])
        return found[: len(vertices)]

    index = primitive.get("material")
    surface = None if item(data.header, "materials", index) is None else surfaces(cast(int, index))
    uv = None if surface is None else values(f"TEXCOORD_{surface.uv_set}", 2)
    color = values("COLOR_0", 3, 4)
    colors = None if color is None else rgba(color)
    if color is not None and colors is not None:
        colors[:, :3] = srgb(colors[:, :3])
        colors[~np.isfinite(color).all(axis=1)] = np.nan  # missing
    normals = values("NORMAL", 3)
    if normals is not None:
        normals = normals.astype(np.float64)
        if (turned := morphed(normals, "NORMAL", primitive, morph_weights, data)) is not normals:
            normals = unit(turned)
    own = {name: values(name) for name in primitive["attributes"] if name.startswith("_")}
    faces = triangles(data.corners(primitive), primitive.get("mode", 4))
    return Geometry(
        shown,
        faces,
        normals,
        None if surface is None or uv is None else from_below(uv, surface.uv_transform),
        colors,
        material=None if surface is None else surface.material,
        attributes={
            name: np.array(each[:, 0] if each.shape[1] == 1 else each) for name, each in own.items() if each is not None
        },
        smoothing=np.full(len(faces), FLAT),  # glTF 2.0, section 3.7.2.1: without normals, faces are flat
        stored=stored,
    )


def triangles(indices: NDArray[Any], mode: int) -> Int64:
    """Return the triangles (F, 3) of a triangle list, strip or fan."""
    numbers = indices.astype(np.int64)
    if mode in (_STRIP, _FAN):
        count = max(len(numbers) - 2, 0)
        first = numbers[:count] if mode == _STRIP else np.repeat(numbers[:1], count)
        faces = np.stack([first, numbers[1 : count + 1], numbers[2:]], axis=1)
        if mode == _STRIP:
            faces[1::2] = faces[1::2, [1, 0, 2]]
        return faces
    if len(numbers) % 3:
        raise ValueError(f"a primitive of triangles has {len(numbers)} corners")
    return numbers.reshape(-1, 3)


def from_below(uv: NDArray[Any], transform: Float64 | None) -> Float64:
    """Apply a texture transform, and flip v, which points down in glTF."""
    with np.errstate(invalid="ignore", over="ignore"):
        placed = uv.astype(np.float64)
        if transform is not None:
            placed = placed @ transform[:, :2].T + transform[:, 2]
        placed[:, 1] = 1 - placed[:, 1]
    return placed


def is_read(primitive: Header, header: Header) -> bool:
    """Return whether a primitive has faces, or is of lines or points with positions that can be read."""
    position = primitive.get("attributes", {}).get("POSITION")
    return primitive.get("mode", 4) in MODES_READ or item(header, "accessors", position) is not None


def expand_instances(data: GltfData) -> None:
    """Give nodes with EXT_mesh_gpu_instancing a child for each instance, in place of their mesh and this extension.

    The format: Khronos Group, "EXT_mesh_gpu_instancing", 2021.
    """
    nodes = data.header.get("nodes", [])
    for node in list(nodes):
        instancing = extension(node, INSTANCING)
        if instancing is None or "mesh" not in node:
            continue
        own = {name: data.accessor(index) for name, index in instancing.get("attributes", {}).items()}
        kept = {name: own[name.upper()].tolist() for name in _PLACING if name.upper() in own}
        counts = {len(values) for values in kept.values()}
        if len(counts) > 1 or max(counts, default=0) + len(nodes) > MOST_INSTANCES:
            raise ValueError(f"a node has {shortened(counts)} instances, and all nodes at most {MOST_INSTANCES}")
        shared = {name: node.pop(name) for name in ("mesh", "skin", "weights") if name in node}
        shared |= {"name": node["name"]} if "name" in node else {}
        first = len(nodes)
        nodes += [
            shared | {name: values[index] for name, values in kept.items()} for index in range(max(counts, default=1))
        ]
        node["children"] = [*node.get("children", []), *range(first, len(nodes))]
        drop_extension(data.header, node, INSTANCING)


def shown_nodes(header: Header) -> set[int]:
    """Return the visible nodes of the default scene; those of the whole file if it has no scene."""
    nodes, scenes = objects(header, "nodes"), objects(header, "scenes")
    hidden = {i for i, node in enumerate(nodes) if (extension(node, _VISIBILITY) or {}).get("visible") is False}
    if not scenes:
        below = parents(header)
        return _reached([i for i in range(len(nodes)) if i not in below], nodes, hidden)
    index = header.get("scene", 0)
    if not is_index(index, len(scenes)):
        raise ValueError(f"its default scene has the index {shortened(index)}, but the file has {len(scenes)} scenes")
    roots = scenes[index].get("nodes", [])
    if not isinstance(roots, list) or not all(is_index(each, len(nodes)) for each in roots):
        raise ValueError("its scene has nodes that do not exist")
    return _reached(roots, nodes, hidden)


def _reached(roots: list[int], nodes: list[Header], hidden: set[int]) -> set[int]:
    """Return the nodes that are reached from the indices `roots` without passing a hidden node."""
    found: set[int] = set()
    layer = set(roots)
    while layer := layer - found - hidden:
        found |= layer
        layer = {child for node in layer for child in nodes[node].get("children", [])}
    return found


def world_transforms(header: Header) -> dict[int, Float64]:
    """Return the transform (4, 4) from each node to the scene, even for nodes outside the scene: they may be joints."""
    nodes, below = objects(header, "nodes"), parents(header)
    found: dict[int, Float64] = {}
    layer = [(i, IDENTITY) for i in range(len(nodes)) if i not in below]
    with np.errstate(over="ignore", invalid="ignore"):  # finiteness is checked later, for displayed nodes
        while layer:
            node, parent = layer.pop()
            own = _local_transform(nodes[node], node)
            found[node] = parent if own is None else own if parent is IDENTITY else parent @ own
            layer.extend((child, found[node]) for child in nodes[node].get("children", []))
    return found


def _local_transform(node: Header, index: int) -> Float64 | None:
    """Return the transform (4, 4) from a node to its parent: the node's matrix or T · R · S, or None without them."""
    if not node.keys() & {"matrix", "translation", "rotation", "scale"}:
        return None

    def numbers(name: str, default: list[float]) -> Float64:
        values = node.get(name, default)
        if not are_numbers(values) or len(values) != len(default):
            raise ValueError(f"node {index} has {name} {shortened(values)}")
        return np.array(values, np.float64)

    if "matrix" in node:
        return cast(Float64, numbers("matrix", [0.0] * 16).reshape(4, 4).T)
    from scipy.spatial.transform import Rotation

    result = np.eye(4)
    if "rotation" in node or "scale" in node:
        turn = numbers("rotation", [0.0, 0.0, 0.0, 1.0])
        if not 0 < np.linalg.norm(turn) < np.inf:
            turn = np.array([0.0, 0.0, 0.0, 1.0])
        result[:3, :3] = Rotation.from_quat(turn).as_matrix() * numbers("scale", [1.0, 1.0, 1.0])
    result[:3, 3] = numbers("translation", [0.0, 0.0, 0.0])
    return result


def morph_weights(node: Header, mesh: Header) -> tuple[float, ...]:
    """Return the default weights of the morph targets, from the node or else from its mesh."""
    values = node.get("weights", mesh.get("weights", []))
    if not are_numbers(values) or not all(np.isfinite(each) for each in values):
        raise ValueError(f"a mesh has morph weights {shortened(values)}")
    return tuple(map(float, values))


def morphed(values: Float64, name: str, primitive: Header, weights: tuple[float, ...], data: GltfData) -> Float64:
    """Return an attribute (N, 3) plus the weighted displacements of the primitive's morph targets."""
    targets = objects(primitive, "targets")
    result = values
    for weight, target in zip(weights, targets, strict=False):
        if weight and name in target:
            displacement = data.accessor(target[name])
            if displacement.shape != values.shape:
                raise ValueError(f"a morph target has {len(displacement)} displacements for {len(values)} vertices")
            result = result + weight * displacement
    return result


def joint_matrices(skin: Any, data: GltfData, world: Mapping[int, Float64]) -> Float64 | None:
    """Return the skinning matrices (J, 4, 4) of the joints of a skin; None if the file has no such skin."""
    content, nodes = item(data.header, "skins", skin), objects(data.header, "nodes")
    if content is None:
        return None
    joints = content.get("joints")
    if not isinstance(joints, list) or not joints or not all(is_index(each, len(nodes)) for each in joints):
        raise ValueError(f"skin {skin} has joints {shortened(joints)}, which are not all in the file")
    placed = np.stack([world[each] for each in joints])
    if "inverseBindMatrices" not in content:
        return placed
    inverse = data.accessor(content["inverseBindMatrices"])
    if inverse.shape[1] != 16 or len(inverse) < len(joints):
        raise ValueError(f"a skin has {len(inverse)} inverse bind matrices for {len(joints)} joints")
    with np.errstate(over="ignore", invalid="ignore"):  # `primitives.place` refuses infinity and NaN
        return placed @ inverse[: len(joints)].reshape(-1, 4, 4).swapaxes(1, 2).astype(np.float64)


def skin_transforms(primitive: Header, data: GltfData, rows: int, matrices: Float64) -> Float64 | None:
    """Return the skinning transform (rows, 4, 4) of each vertex; None for a primitive without weights.

    Weights are divided by their sum; weights that are not positive count as 0. A vertex without weights follows the
    first joint, as in three.js.
    """
    flat, total, blended, weighted = matrices.reshape(-1, 16), np.zeros(rows), np.zeros((rows, 16)), False
    with np.errstate(over="ignore", invalid="ignore"):
        for name in sorted(each for each in primitive["attributes"] if each.startswith("WEIGHTS_")):
            numbers = data.attribute(primitive, name.replace("WEIGHTS_", "JOINTS_"))
            stored = data.attribute(primitive, name)
            if numbers is None or stored is None:
                continue
            if numbers.shape != (rows, 4) or stored.shape != (rows, 4):
                raise ValueError(f"a skinned primitive has {len(stored)} weights for {rows} vertices")
            weights = np.where(np.isfinite(stored), stored, 0).astype(np.float64).clip(min=0)
            joints = np.where(weights > 0, numbers, 0).astype(np.int64)
            if joints.max(initial=0) >= len(flat):
                raise ValueError(f"a skinned primitive follows joint {joints.max()} of a skin of {len(flat)}")
            weighted, total = True, total + weights.sum(axis=1)
            for column in range(4):
                blended += weights[:, column, None] * flat[joints[:, column]]
        if not weighted:
            return None
        blended = np.where(total[:, None] > 0, blended / np.where(total > 0, total, 1)[:, None], flat[0])
    blended[:, 12:] = (0, 0, 0, 1)
    return blended.reshape(-1, 4, 4)


def closed_seams(positions: Float64, transforms: Float64) -> Float64:
    """Return `transforms` (rows, 4, 4), made equal at vertices of one position if they differ only by rounding.

    Exporters round the weights of each vertex separately. Unequal transforms would open seams of texture or normals.
    """
    finite = np.isfinite(positions).all() and np.isfinite(transforms).all()
    if not finite:
        return transforms  # `primitives.place` refuses infinity and NaN
    first, vertex = weld(positions)
    placed = np.einsum("nij,nj->ni", transforms[:, :3, :3], positions) + transforms[:, :3, 3]
    leader = first[vertex]
    near = np.abs(placed - placed[leader]).max(axis=1) <= _SEAM * np.ptp(placed, axis=0).max()
    return transforms[np.where(near, leader, np.arange(len(leader)))]
