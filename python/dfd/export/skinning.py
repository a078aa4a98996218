"""Compute the skin of a rig, with a limited number of joints for each vertex, and its deviation from `dfd.pose`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.export.joints import Joint, Local
from dfd.export.rig import BATCH, Rig

ROUNDING = 1e-5  # weights down to −ROUNDING and sums of weights up to 1 + ROUNDING count as rounding errors


@dataclass(frozen=True)
class Difference:
    """The deviation of a file from `dfd.pose`, in the pose in which it is largest."""

    largest: float = 0.0  # largest distance of a vertex, in the pose `at`, mesh units
    mean: float = 0.0  # mean distance of the vertices, in the pose `at`, mesh units
    at: str = "the edit"  # the pose with the largest distance: "the edit", or the name of a key pose


@dataclass(frozen=True, eq=False)
class Skin:
    """The skin of a rig as a file stores it; vertices and joints are relative to the rig's origin."""

    joints: Int64  # (V, K) indices of the joints of each vertex, by descending weight; 0 if the weight is 0
    weights: Float32  # (V, K) weights of these joints; the weights of a vertex sum to 1 within 1e-6
    pruned: float  # largest fraction of a vertex's total weight that was left out
    normalized: int  # number of vertices whose weights changed, because they were negative or summed to more than 1
    binds: Float32  # (J, 4, 4) inverse bind matrices
    moments: list[list[Local]]  # for the edit, and then for each key pose, the transforms of the J joints

    def shown(self, moment: int, rig: Rig) -> Float64:
        """Return the vertices (V, 3) that viewers show: Σ_k w_k M_k B_k v, with M = `moments[moment]`, B = `binds`."""
        points = (rig.mesh.vertices - rig.origin).astype(np.float32).astype(np.float64)
        matrices = np.array([local.matrix for local in self.moments[moment]]) @ self.binds.astype(np.float64)
        result = np.empty_like(points)
        for start in range(0, len(points), BATCH):
            rows = slice(start, start + BATCH)
            blended = np.zeros((len(points[rows]), 3, 4))
            for joint, weight in zip(self.joints[rows].T, self.weights[rows].T, strict=True):
                blended += weight[:, None, None].astype(np.float64) * matrices[joint, :3]
            result[rows] = np.einsum("nij,nj->ni", blended[:, :, :3], points[rows]) + blended[:, :, 3]
        return result + rig.origin


def skin_of(rig: Rig, most: int | None) -> Skin:
    """Return the skin of a rig. Each vertex keeps the `most` joints with the largest weights, or all if `most` is None.

    Raises ValueError if a joint scales along axes other than its own, or its pivot is too far away for 32-bit floats.
    """
    joints, weights = [], []
    least, normalized, width = 1.0, 0, 1
    for _, rows in rig.weights():
        normalized += int(((rows.sum(axis=1) > 1.0 + ROUNDING) | (rows.min(axis=1) < -ROUNDING)).sum())
        rows = np.maximum(rows, 0.0)
        order = np.argsort(-rows, axis=1, kind="stable")[:, :most]
        kept = np.take_along_axis(rows, order, axis=1)
        sums = kept.sum(axis=1, keepdims=True)
        least = min(least, float((sums[:, 0] / rows.sum(axis=1)).min()))
        single = _summing_to_one(kept / sums)
        order[single == 0] = 0
        width = max(width, int((single > 0).sum(axis=1).max()))
        joints.append(order)
        weights.append(single)
    return Skin(
        np.concatenate([each[:, :width] for each in joints]),
        np.concatenate([each[:, :width] for each in weights]),
        0.0 if most is None else 1.0 - least,
        normalized,
        _inverse_binds(rig.joints, rig.origin),
        _moments(rig),
    )


def difference_of(rig: Rig, shown: Callable[[int, Rig], Float64]) -> Difference:
    """Return the deviation from `dfd.pose` of a file whose vertices (V, 3) at moment m are `shown(m, rig)`."""
    found = Difference()
    for moment, (name, edit) in enumerate(rig.moments()):
        distance = np.linalg.norm(shown(moment, rig) - rig.posed(edit), axis=1)
        if distance.max() > found.largest:
            found = Difference(float(distance.max()), float(distance.mean()), name)
    return found


def _summing_to_one(weights: Float64) -> Float32:
    """Return 32-bit weights whose rows sum to 1. The first weight, the largest, absorbs the rounding error."""
    single = weights.astype(np.float32)
    single[single < np.finfo(np.float32).tiny] = 0.0  # some readers treat denormal numbers as 0
    single[:, 0] = 1.0 - single[:, 1:].sum(axis=1, dtype=np.float64)
    return single


def _inverse_binds(joints: Sequence[Joint], origin: Float64) -> Float32:
    """Return the maps (J, 4, 4) from the coordinates of the file's vertices to the frame of each joint."""
    frames = np.array([joint.frame for joint in joints])
    frames[:, :3, 3] -= origin
    return np.linalg.inv(frames).astype(np.float32)


def _moments(rig: Rig) -> list[list[Local]]:
    """Return the joints' transforms relative to the root, in the edit and in each key pose, rounded to 32 bits."""
    moments: list[list[Local]] = []
    for _, edit in rig.moments():
        placed = []
        for number, (joint, transform) in enumerate(zip(rig.joints, rig.transforms(edit), strict=True)):
            local = joint.placed(joint.local(transform))
            parts = (local.translation - rig.origin, local.rotation, local.scale)
            translation, rotation, scale = (part.astype(np.float32).astype(np.float64) for part in parts)
            if moments and rotation @ moments[-1][number].rotation < 0:  # −q is the same rotation
                rotation = -rotation
            placed.append(Local(translation, rotation, scale))
        moments.append(placed)
    return moments
