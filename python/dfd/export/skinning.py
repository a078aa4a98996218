"""Linear blend skinning as readers of a file do it, and its deviation from `dfd.pose`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from dfd.common.linear_algebra import Float32, Float64
from dfd.export.influences import Influences, influences_of
from dfd.export.joints import Joint, Local
from dfd.export.rig import BATCH, Rig


@dataclass(frozen=True)
class Difference:
    """The deviation of a file from `dfd.pose`, over the edit and all key poses."""

    # largest, mean: distances of vertices, mesh units; the mean is that of the pose where it is largest
    largest: float
    mean: float
    at: str  # where the largest is: "the edit", or the name of a key pose


@dataclass(frozen=True, eq=False)
class Skin:
    """The skin of a rig as a file stores it."""

    influences: Influences
    binds: Float32  # (J, 4, 4) inverse binds
    moments: list[list[Local]]  # (M, J) each joint as seen from its parent, in the edit and then at each key pose
    difference: Difference


def inverse_binds(joints: Sequence[Joint]) -> Float32:
    """(J, 4, 4) from the mesh's coordinates to each joint's own, as a file stores them.

    Raises ValueError if a joint is so far away that its inverse overflows 32-bit floats.
    """
    frames = np.array([joint.frame for joint in joints])
    with np.errstate(over="ignore", invalid="ignore"):
        inverse = np.linalg.inv(frames).astype(np.float32)
    wrong = ~np.isfinite(inverse).all(axis=(1, 2))
    if wrong.any():
        joint = joints[int(wrong.argmax())]
        raise ValueError(f"export_rig: joint {joint.name!r} has a pivot too far away to be inverted in 32-bit floats")
    return inverse


def skin_of(rig: Rig, most: int | None, stored: Callable[[Local], Local] = lambda local: local) -> Skin:
    """The skin of a rig with at most `most` influences a vertex; `stored` rounds a pose to the precision of a format.

    Raises ValueError if a joint scales along other axes than its own.
    """
    influences, binds = influences_of(rig, most), inverse_binds(rig.joints)
    moments: list[list[Local]] = []
    for _, edit in rig.moments():
        placed = []
        for number, (joint, transform) in enumerate(zip(rig.joints, rig.transforms(edit), strict=True)):
            local = joint.placed(joint.local(transform))
            parts = (np.asarray(part, np.float32) for part in (local.translation, local.rotation, local.scale))
            translation, rotation, scale = (part.astype(np.float64) for part in parts)
            if moments and rotation @ moments[-1][number].rotation < 0:
                rotation = -rotation
            placed.append(stored(Local(translation, rotation, scale)))
        moments.append(placed)
    points = rig.mesh.vertices.astype(np.float32).astype(np.float64)
    shown = [partial(skinned, points, influences, binds, each) for each in moments]
    return Skin(influences, binds, moments, differences(rig, shown))


def skinned(points: Float64, influences: Influences, binds: Float32, locals_: Sequence[Local]) -> Float64:
    """(V, 3) Σ_k w_k M_k B_k v of points (V, 3), with joints at M and inverse binds B; their sums in 64 bits."""
    matrices = np.array([_matrix(local) for local in locals_]) @ binds.astype(np.float64)
    result = np.empty_like(points)
    for start in range(0, len(points), BATCH):
        rows = slice(start, start + BATCH)
        blended = np.zeros((len(points[rows]), 3, 4))
        for joint, weight in zip(influences.joints[rows].T, influences.weights[rows].T, strict=True):
            blended += weight[:, None, None].astype(np.float64) * matrices[joint, :3]
        result[rows] = np.einsum("nij,nj->ni", blended[:, :, :3], points[rows]) + blended[:, :, 3]
    return result


def differences(rig: Rig, shown: Sequence[Callable[[], Float64]]) -> Difference:
    """The deviation from `dfd.pose` of the shapes (V, 3) that a file shows at each of the rig's moments."""
    found = Difference(0.0, 0.0, "the edit")
    for (name, edit), show in zip(rig.moments(), shown, strict=True):
        distance = np.linalg.norm(show() - rig.posed(edit), axis=1)
        if distance.max() > found.largest:
            found = Difference(float(distance.max()), float(distance.mean()), name)
    return found


def _matrix(local: Local) -> Float64:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(local.rotation).as_matrix() * local.scale
    matrix[:3, 3] = local.translation
    return matrix
