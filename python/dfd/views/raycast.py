"""Rays against triangles, by Embree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Int32, Int64


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays first meet the surface: only of the rays that do."""

    ray: Int64  # (K,) index of the ray, increasing
    face: Int32  # (K,) the face it meets
    barycentric: Float32  # (K, 3) float32 weights of the face's corners, each at least 0, their sum 1
    distance: Float32  # (K,) float32 along the ray, in lengths of its direction

    def where(self, chosen: NDArray[np.bool_ | np.integer]) -> Hits:
        """The chosen of them; `chosen` is (K,) bool, or their numbers in the order wanted."""
        return Hits(self.ray[chosen], self.face[chosen], self.barycentric[chosen], self.distance[chosen])


class Scene:
    """Triangles in normalized coordinates, ready to be hit; front and back faces alike.

    Several threads may cast at once, and do so in parallel. `vertices` (V, 3) are in normalized coordinates, since
    Embree computes in float32 and loses hits far from the origin; `faces` (F, 3) are checked by `dfd.Mesh`, and those
    without area are never hit.
    """

    def __init__(self, vertices: NDArray[np.floating[Any]], faces: NDArray[np.integer[Any]]) -> None:
        # Robust: of rays aimed at a common edge or vertex every seventh is lost otherwise, and one in 200 so.
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(
            self._scene, np.ascontiguousarray(vertices, dtype=np.float32), np.ascontiguousarray(faces, dtype=np.int32)
        )
        # The first query builds the search tree, and must not run beside a second one.
        self.cast(np.zeros(3), np.ones((1, 3)))

    def cast(self, origins: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]]) -> Hits:
        """Cast N rays; `directions` is (N, 3), `origins` (N, 3) or one point (3,) for all."""
        directions = np.ascontiguousarray(directions, dtype=np.float32)
        origins = np.ascontiguousarray(np.broadcast_to(origins, directions.shape), dtype=np.float32)
        if len(directions) == 0:
            nothing = np.zeros(0, np.float32)
            return Hits(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 3), np.float32), nothing)
        found = self._scene.run(origins, directions, query="INTERSECT", output=1)
        ray = np.flatnonzero(found["primID"] >= 0)
        u, v = found["u"][ray], found["v"][ray]  # shares of the second corner and the third
        barycentric = np.stack([1 - u - v, u, v], axis=1).clip(0, 1)
        first, second, third = barycentric.T
        barycentric /= (first + second + third)[:, None]
        return Hits(ray, found["primID"][ray], barycentric, found["tfar"][ray])

    def hides(self, eye: NDArray[np.floating[Any]], points: NDArray[np.floating[Any]], tolerance: float) -> Bool:
        """Return whether the surface stands between `eye` (3,) and each of `points` (N, 3).

        What is met by less than a share `tolerance` of the distance before a point is the surface it lies on.
        """
        if len(points) == 0:
            return np.zeros(0, bool)
        eyes = np.ascontiguousarray(np.broadcast_to(eye, points.shape), dtype=np.float32)
        reach = np.full(len(points), 1 - tolerance, np.float32)
        met = self._scene.run(eyes, np.asarray(points - eye, np.float32, order="C"), dists=reach, query="OCCLUDED")
        return met >= 0
