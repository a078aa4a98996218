"""Intersect rays with triangles by Embree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Int32, Int64
from dfd.geometry.topology import are_distinct


@dataclass(frozen=True, eq=False)
class Hits:
    """The first intersection of each ray that hits the surface."""

    ray: Int64  # (K,) indices of the rays, ascending
    face: Int32  # (K,) indices of the faces that the rays hit
    barycentric: Float32  # (K, 3) weights of the face's corners, at least 0 and with sum 1
    distance: Float32  # (K,) distance from the origin to the hit, divided by the length of the ray's direction vector

    def where(self, chosen: NDArray[np.bool_ | np.integer]) -> Hits:
        """Return the hits that `chosen` selects by a mask (K,) or by indices."""
        return Hits(self.ray[chosen], self.face[chosen], self.barycentric[chosen], self.distance[chosen])


class Scene:
    """The search tree of triangles. Rays hit a face from both sides. They never hit a face without area.

    Several threads can cast rays in parallel. `vertices` (V, 3) must lie near the origin, in a box of about unit size,
    because Embree computes in float32 and misses hits far from the origin. `faces` (F, 3) must be valid indices. Rays
    hit the first of several faces with the same corners.
    """

    def __init__(self, vertices: NDArray[np.floating[Any]], faces: NDArray[np.integer[Any]]) -> None:
        # Without `robust`, more rays slip between neighboring faces, at edges and vertices.
        self._scene = EmbreeScene(robust=True)
        self._face = np.flatnonzero(are_distinct(faces)).astype(np.int32)
        corners = np.ascontiguousarray(faces if len(self._face) == len(faces) else faces[self._face], dtype=np.int32)
        TriangleMesh(self._scene, np.ascontiguousarray(vertices, dtype=np.float32), corners)
        # The first query builds the search tree, so it must not run in parallel with another query.
        self.cast(np.zeros(3), np.ones((1, 3)))

    def cast(self, origins: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]]) -> Hits:
        """Return the hits of rays along `directions` (N, 3) from `origins` (N, 3), or from a single origin (3,)."""
        directions = np.ascontiguousarray(directions, dtype=np.float32)
        origins = np.ascontiguousarray(np.broadcast_to(origins, directions.shape), dtype=np.float32)
        if len(directions) == 0:
            nothing = np.zeros(0, np.float32)
            return Hits(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 3), np.float32), nothing)
        found = self._scene.run(origins, directions, query="INTERSECT", output=1)
        ray = np.flatnonzero(found["primID"] >= 0)
        u, v = found["u"][ray], found["v"][ray]  # weights of the second and the third corner
        barycentric = np.stack([1 - u - v, u, v], axis=1).clip(0, 1)
        first, second, third = barycentric.T
        barycentric /= (first + second + third)[:, None]
        return Hits(ray, self._face.take(found["primID"][ray]), barycentric, found["tfar"][ray])

    def hides(self, eye: NDArray[np.floating[Any]], points: NDArray[np.floating[Any]], tolerance: float) -> Bool:
        """Return a mask (N,) of the `points` (N, 3) that the surface hides from `eye` (3,).

        To ignore the surface at the point itself, the last fraction `tolerance` of the way to each point is not tested.
        """
        if len(points) == 0:
            return np.zeros(0, bool)
        eyes = np.ascontiguousarray(np.broadcast_to(eye, points.shape), dtype=np.float32)
        ends = np.full(len(points), 1 - tolerance, np.float32)
        hit = self._scene.run(eyes, np.asarray(points - eye, np.float32, order="C"), dists=ends, query="OCCLUDED")
        return hit >= 0
