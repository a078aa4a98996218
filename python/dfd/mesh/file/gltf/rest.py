"""The resting shape of a glTF file, as viewers show it: morph targets at their default weights, then the skin.

The format: Khronos Group, "glTF 2.0 Specification", 2021, sections 3.7.2.2 and 3.7.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.mesh.file.assets import shortened
from dfd.mesh.file.gltf.data import GltfData
from dfd.mesh.file.gltf.header import Header, are_numbers, is_index, item, objects
from dfd.mesh.weld import weld

_SEAM = 1e-4  # largest gap, relative to the longest side, between rows that skinning keeps at one vertex


def morph_weights(node: Header, mesh: Header) -> tuple[float, ...]:
    """Return the default weights of morph targets, of the node or else of its mesh."""
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
    """Return the skinning matrices (J, 4, 4) of a skin's joints; None if there is no such skin."""
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
    with np.errstate(over="ignore", invalid="ignore"):  # `place` checks finiteness
        return placed @ inverse[: len(joints)].reshape(-1, 4, 4).swapaxes(1, 2).astype(np.float64)


def skin_transforms(primitive: Header, data: GltfData, rows: int, matrices: Float64) -> Float64 | None:
    """Return the transform (rows, 4, 4) from each vertex to the scene; None for a primitive without weights.

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
    """Return the transforms (rows, 4, 4), with equal ones for rows at one position that differ only by rounding.

    Exporters round the weights of each row separately, which would open seams of texture or normals.
    """
    finite = np.isfinite(positions).all() and np.isfinite(transforms).all()
    if not finite:
        return transforms  # `place` raises an error for them
    first, vertex = weld(positions)
    placed = np.einsum("nij,nj->ni", transforms[:, :3, :3], positions) + transforms[:, :3, 3]
    leader = first[vertex]
    near = np.abs(placed - placed[leader]).max(axis=1) <= _SEAM * np.ptp(placed, axis=0).max()
    return transforms[np.where(near, leader, np.arange(len(leader)))]
