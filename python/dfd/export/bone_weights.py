"""Bone weights from feature similarity and distance to the bones."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import dijkstra

from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.editing.influence.handle_features import HandleFeatures
from dfd.export.bones import Bones
from dfd.field.field import Field
from dfd.geometry.surface_graph import surface_graph
from dfd.mesh.mesh import Mesh
from dfd.weights.bind import bind

# Chosen on five rigs, four of them animals, to match the artists' weights best.
POWER = 6  # of inverse distance
ALONG = 0.2  # factor of the surface distance, which is added to the straight one
SIMILARITY_POWER = 2  # of the weight of Eq. 5
FLOOR = 1e-3  # added to distances in diagonals and to similarities
MOST_SAMPLES = 256  # vertices whose features stand for those around a bone


class BoneDistances:
    """Distances of vertices from bones, as parts of the diagonal of the box around the skinned parts.

    Parts without the skin, such as objects that a character holds, are ignored.
    """

    straight: Float64  # (V, J) through space, to the nearest of a joint's bones
    surface: list[Int64]  # (J) for each joint, the nearer half of the vertices nearest to it
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
        # Disconnected vertices: the straight distance, plus 1 so that it exceeds all others.
        self.along = np.stack(along, axis=1)
        self.along = np.where(np.isinf(self.along), 1.0 + self.straight, self.along)

    def _around(self, nearest: Int64, joint: int) -> Int64:
        distance = self.straight[:, joint]
        own = np.flatnonzero((nearest == joint) & self._skinned)
        if len(own) == 0:
            return np.array([np.where(self._skinned, distance, np.inf).argmin()])
        return own[distance[own] <= np.median(distance[own])]


def bone_weights(mesh: Mesh, field: Field, distances: BoneDistances, joints: Int64) -> Float64:
    """(V, J) weights of `joints`, and 0 of all others; the rows sum to 1.

    A joint's feature is the mean over the surface around its bones; vertices follow it by similarity (Eq. 5) and by
    nearness, both through space and along the surface.
    """
    rows = HandleFeatures(mesh, field, None)
    points = np.stack([_feature(mesh, field, distances.surface[joint]) for joint in joints])
    similarity = bind(rows.features, points).astype(np.float64)
    distance = distances.straight[:, joints] + ALONG * distances.along[:, joints]
    weights = np.power(similarity + FLOOR, SIMILARITY_POWER) / np.power(distance + FLOOR, POWER)
    return _spread(weights, joints, distances)


def straight_weights(distances: BoneDistances, joints: Int64) -> Float64:
    """(V, J) weights by the distance to bones through space alone: the baseline."""
    return _spread(1.0 / np.power(distances.straight[:, joints] + FLOOR, POWER), joints, distances)


def _spread(weights: Float64, joints: Int64, distances: BoneDistances) -> Float64:
    result = np.zeros_like(distances.straight)
    result[:, joints] = weights / weights.sum(axis=1, keepdims=True)
    return result


def _feature(mesh: Mesh, field: Field, around: Int64) -> Float32:
    """(D,) the normalized mean feature of the vertices `around`."""
    some = around[np.linspace(0, len(around) - 1, min(len(around), MOST_SAMPLES)).astype(np.int64)]
    mean = np.asarray(field(mesh.vertices[some]), np.float64).mean(axis=0)
    return (mean / max(float(np.linalg.norm(mean)), 1e-12)).astype(np.float32)


def _from_line(points: Float64, start: Float64, end: Float64) -> Float64:
    """(N,) distances of points from a line between two."""
    along = end - start
    length = float(along @ along)
    part = np.clip((points - start) @ along / length, 0.0, 1.0) if length > 0 else np.zeros(len(points))
    return np.linalg.norm(points - start - part[:, None] * along, axis=1)
