"""Weights of bones by looks and nearness, and how much of any weights lies far from its bone along the surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from dfd.editing.influence.handle_features import HandleFeatures
from dfd.geometry.surface_graph import surface_graph
from dfd.mesh.mesh import Mesh
from dfd.weights.bind import bind

if TYPE_CHECKING:
    from dfd.export.bones import Bones
    from dfd.field.field import Field

__all__ = ["BoneDistances", "bone_weights", "straight_weights"]

# Chosen on five rigs, four of them animals, as those whose weights are nearest to the artists' own.
POWER = 6  # of nearness
ALONG = 0.2  # how much of the way along the surface counts beside the straight one to the bone
LOOKS = 2  # power of the weight of Eq. 5
LEAST = 1e-3  # of nearness in diagonals and of looks: below, differences are none
MOST_SAMPLES = 256  # vertices whose features stand for those around a bone

Float64 = NDArray[np.float64]


class BoneDistances:
    """How far vertices are from bones; distances are parts of the diagonal of the box around what has the skin.

    Parts without the skin, such as what a character holds, are no way from one bone to another and around none.
    """

    straight: Float64  # (V, J) through space, to the nearest of a joint's bones
    surface: list[NDArray[np.int64]]  # (J) around each joint's bones: of the vertices nearest to it the nearer half
    along: Float64  # (V, J) along the surface, from those

    def __init__(self, bones: Bones) -> None:
        mesh = bones.mesh
        skin = Mesh(mesh.vertices, np.concatenate([mesh.faces[each.faces] for each in bones.primitives]))
        self._skinned = bones.skinned
        size = float(np.linalg.norm(np.ptp(mesh.vertices[bones.skinned], axis=0))) or 1.0
        count = len(bones.names)
        self.straight = np.full((len(mesh.vertices), count), np.inf)
        for start, end, joint in zip(bones.starts, bones.ends, bones.joint, strict=True):
            distance = _from_line(mesh.vertices, start, end) / size
            np.minimum(self.straight[:, joint], distance, out=self.straight[:, joint])
        nearest = self.straight.argmin(axis=1)
        self.surface = [self._around(nearest, joint) for joint in range(count)]
        graph = surface_graph(skin)
        along = [dijkstra(graph, indices=around, min_only=True) / size for around in self.surface]
        # Where no way leads along the surface, it is the straight one and farther than any other.
        self.along = np.stack(along, axis=1)
        self.along = np.where(np.isinf(self.along), 1.0 + self.straight, self.along)

    def _around(self, nearest: NDArray[np.int64], joint: int) -> NDArray[np.int64]:
        distance = self.straight[:, joint]
        own = np.flatnonzero((nearest == joint) & self._skinned)
        if len(own) == 0:
            return np.array([np.where(self._skinned, distance, np.inf).argmin()])
        nearer: NDArray[np.int64] = own[distance[own] <= np.median(distance[own])]
        return nearer


def bone_weights(mesh: Mesh, field: Field, distances: BoneDistances, joints: NDArray[np.int64]) -> Float64:
    """(V, J) weights of `joints`, and 0 of all others; the rows sum to 1.

    A joint's feature is the mean of those of the surface around its bones; what looks like it (Eq. 5) and is near, both
    through space and along the surface, follows it.
    """
    rows = HandleFeatures(mesh, field, None)
    points = np.stack([_feature(mesh, field, distances.surface[joint]) for joint in joints])
    looks = bind(rows.features, points).astype(np.float64)
    distance = distances.straight[:, joints] + ALONG * distances.along[:, joints]
    return _spread(np.power(looks + LEAST, LOOKS) / np.power(distance + LEAST, POWER), joints, distances)


def straight_weights(distances: BoneDistances, joints: NDArray[np.int64]) -> Float64:
    """(V, J) weights by the distance to bones through space alone, what others are compared with."""
    return _spread(1.0 / np.power(distances.straight[:, joints] + LEAST, POWER), joints, distances)


def _spread(weights: Float64, joints: NDArray[np.int64], distances: BoneDistances) -> Float64:
    result = np.zeros_like(distances.straight)
    result[:, joints] = weights / weights.sum(axis=1, keepdims=True)
    return result


def _feature(mesh: Mesh, field: Field, around: NDArray[np.int64]) -> NDArray[np.float32]:
    """(D,) the unit feature of a piece of the surface."""
    some = around[np.linspace(0, len(around) - 1, min(len(around), MOST_SAMPLES)).astype(np.int64)]
    mean = np.asarray(field(mesh.vertices[some]), np.float64).mean(axis=0)
    unit: NDArray[np.float32] = (mean / max(float(np.linalg.norm(mean)), 1e-12)).astype(np.float32)
    return unit


def _from_line(points: Float64, start: Float64, end: Float64) -> Float64:
    """(N,) distances of points from a line between two."""
    along = end - start
    length = float(along @ along)
    part = np.clip((points - start) @ along / length, 0.0, 1.0) if length > 0 else np.zeros(len(points))
    distance: Float64 = np.linalg.norm(points - start - part[:, None] * along, axis=1)
    return distance
