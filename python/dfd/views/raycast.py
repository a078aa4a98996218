"""Intersect rays with triangles, by Embree."""

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
    """The first intersections of rays with the surface, for the rays that hit it."""

    ray: Int64  # (K,) index of the ray, increasing
    face: Int32  # (K,) the face that the ray hits
    barycentric: Float32  # (K, 3) weights of the face's corners, each at least 0, of sum 1
    distance: Float32  # (K,) along the ray, in lengths of its direction

    def where(self, chosen: NDArray[np.bool_ | np.integer]) -> Hits:
        """Return some of the hits; `chosen` is a mask (K,), or indices in the order of the result."""
        return Hits(self.ray[chosen], self.face[chosen], self.barycentric[chosen], self.distance[chosen])


class Scene:
    """The search tree of triangles in normalized coordinates; rays hit the front and the back of a face.

    Several threads may cast rays in parallel. `vertices` (V, 3) are normalized, because Embree computes in float32 and
    loses hits far from the origin. `faces` (F, 3) are checked by `dfd.Mesh`. Rays never hit a face without area.
    """

    def __init__(self, vertices: NDArray[np.floating[Any]], faces: NDArray[np.integer[Any]]) -> None:
        # Of rays at a common edge or vertex, one in 200 is lost with `robust`, and one in seven without it.
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(
            self._scene, np.ascontiguousarray(vertices, dtype=np.float32), np.ascontiguousarray(faces, dtype=np.int32)
        )
        # The first query builds the search tree, and must not run in parallel with another.
        self.cast(np.zeros(3), np.ones((1, 3)))

    def cast(self, origins: NDArray[np.floating[Any]], directions: NDArray[np.floating[Any]]) -> Hits:
        """Cast rays along `directions` (N, 3) from `origins`, (N, 3) or one point (3,) for all."""
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
        return Hits(ray, found["primID"][ray], barycentric, found["tfar"][ray])

    def hides(self, eye: NDArray[np.floating[Any]], points: NDArray[np.floating[Any]], tolerance: float) -> Bool:
        """Return a mask (N,) of `points` (N, 3) that the surface hides from `eye` (3,).

        A hit closer to the point than the fraction `tolerance` of the distance is the surface on which the point lies.
        """
        if len(points) == 0:
            return np.zeros(0, bool)
        eyes = np.ascontiguousarray(np.broadcast_to(eye, points.shape), dtype=np.float32)
        reach = np.full(len(points), 1 - tolerance, np.float32)
        met = self._scene.run(eyes, np.asarray(points - eye, np.float32, order="C"), dists=reach, query="OCCLUDED")
        return met >= 0
