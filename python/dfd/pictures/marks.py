"""Marks on pictures: dots for handles, squares for fixed points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dfd.views.cameras import Camera
from dfd.views.raycast import Scene

__all__ = ["draw_marks"]

BLUE, DARK = (0.10, 0.36, 0.86), (0.13, 0.14, 0.17)
RADIUS, SMALLEST = 0.013, 2.0  # of the picture's side; pixels
RIM = 1.4  # of the radius, white
HIDDEN = 0.3  # opacity of a mark behind the shape
# A mark on the surface is not hidden by that surface, nor is one slightly inside it; normalised coordinates.
INSIDE = 0.02


def draw_marks(
    image: NDArray[np.float32],
    scene: Scene,
    camera: Camera,
    positions: NDArray[np.float64],
    *,
    square: bool,
) -> None:
    """Draw dots or squares with white rims into `image` (R, R, 3), in place.

    Parameters
    ----------
    scene
        What may hide them: such marks are faint.
    positions
        (H, 3) in the scene's coordinates; what is not in front of the camera is left out.
    """
    resolution = len(image)
    radius = max(SMALLEST, RADIUS * resolution)
    offsets = positions - camera.position
    before = offsets @ camera.back < 0
    positions, offsets = positions[before], offsets[before]
    rows, columns = camera.project(positions, resolution)
    hits = scene.cast(camera.position, offsets)
    hidden = np.zeros(len(positions), bool)
    hidden[hits.ray] = hits.distance < 1 - INSIDE / np.linalg.norm(offsets[hits.ray], axis=1)
    for row, column, behind in zip(rows, columns, hidden, strict=True):
        # Only the pixels around the mark are touched.
        reach = int(radius * RIM) + 2
        top, left = max(0, int(row) - reach), max(0, int(column) - reach)
        patch = image[top : max(0, int(row) + reach + 1), left : max(0, int(column) + reach + 1)]
        down, across = np.arange(top, top + patch.shape[0]) - row, np.arange(left, left + patch.shape[1]) - column
        if square:
            distance = np.maximum(np.abs(down)[:, None], np.abs(across)) * 1.1  # looks as large as the dot
        else:
            distance = np.hypot(down[:, None], across)
        for edge, ink in ((radius * RIM, (1.0, 1.0, 1.0)), (radius, DARK if square else BLUE)):
            cover = (edge - distance + 0.5).clip(0, 1) * (HIDDEN if behind else 1)
            patch += (cover[:, :, None] * (np.array(ink) - patch)).astype(np.float32)
