"""The slow twins of what pictures are made with: rays, blends of a face's corners, light at the eye, bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from dfd.views.cameras import Camera

__all__ = ["blend", "facing", "paint", "ray_directions"]

Array = NDArray[np.float64]


def blend(values: ArrayLike, rows: ArrayLike, weights: ArrayLike) -> Array:
    """(N, K) three rows (N, 3) of values (R, K) by their weights (N, 3): B·T (paper, Eq. 2)."""
    of_corners = np.asarray(values, np.float64)[np.asarray(rows)]  # (N, 3, K)
    blended: Array = np.einsum("nc,nck->nk", np.asarray(weights, np.float64), of_corners)
    return blended


def facing(
    vertices: ArrayLike,  # (V, 3)
    normals: ArrayLike,  # (V, 3) unit, or zero where unknown
    corners: ArrayLike,  # (N, 3) of the faces that are met
    barycentric: ArrayLike,  # (N, 3)
    directions: ArrayLike,  # (N, 3) unit, of the rays that meet them
) -> Array:
    """(N,) |n · d|: n the unit blend of the corners' normals, or the face's own where that is shorter than 0.2."""
    blended = blend(normals, corners, barycentric)
    light = np.empty(len(blended))
    for hit, (normal, direction) in enumerate(zip(blended, np.asarray(directions, np.float64), strict=True)):
        if np.linalg.norm(normal) < 0.2:
            first, second, third = np.asarray(vertices, np.float64)[np.asarray(corners)[hit]]
            normal = np.cross(second - first, third - first)
        length = np.linalg.norm(normal)
        light[hit] = min(abs(normal @ direction) / length, 1.0) if length > 0 else 0.0
    return light


def paint(colors: ArrayLike, pixels: ArrayLike, count: int) -> NDArray[np.uint8]:
    """(count, 3) bytes, white but for the `pixels` (N,) that have the colors (N, 4) in [0, 1]."""
    image = np.full((count, 3), 255, np.uint8)
    image[np.asarray(pixels)] = np.floor(np.asarray(colors, np.float64)[:, :3] * 255 + 0.5)
    return image


def ray_directions(camera: Camera, resolution: int) -> Array:
    """(resolution², 3) unit directions through the centers of all pixels, row by row from the top left."""
    places = ((np.arange(resolution) + 0.5) / resolution * 2 - 1) * camera.half_width
    directions = np.array([x * camera.right - y * camera.up - camera.back for y in places for x in places])
    unit: Array = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return unit
