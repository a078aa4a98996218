"""What is written on pictures: labels of marks, numbers of vertices, the directions of the axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from dfd.pictures.typography import font, spelled
from dfd.views.cameras import Camera
from dfd.views.raycast import Scene

__all__ = ["draw_axes", "draw_labels", "draw_numbers"]

INK, HALO = (20, 22, 28), (255, 255, 255)
AXES = (("x", (204, 44, 44)), ("y", (38, 140, 54)), ("z", (36, 84, 200)))
TOLERANCE = 0.004  # of its distance from the eye: by so much a vertex may lie below the surface and still be seen


def draw_labels(
    image: NDArray[np.uint8], camera: Camera, positions: NDArray[np.float64], labels: Sequence[str]
) -> NDArray[np.uint8]:
    """Return `image` (R, R, 3) with a text beside each of `positions` (H, 3), which are in the camera's coordinates."""
    page = Image.fromarray(image)
    draw = ImageDraw.Draw(page)
    size = max(11, len(image) // 30)
    for row, column, text in zip(*camera.project(positions, len(image)), labels, strict=True):
        beside = (float(column) + 0.7 * size, float(row) - 0.7 * size)
        _write(draw, beside, text, size, "lm")
    return np.asarray(page)


def draw_numbers(
    image: NDArray[np.uint8], scene: Scene, camera: Camera, positions: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """Return `image` (R, R, 3) with the indices of as many visible vertices (V, 3) as fit side by side."""
    resolution = len(image)
    size = max(9, resolution // 64)
    wide = font(size).getlength(str(len(positions))) + 0.8 * size
    before = np.flatnonzero((positions - camera.position) @ camera.back < 0)
    rows, columns = camera.project(positions[before], resolution)
    margin = wide / 2
    inside = (rows > size) & (rows < resolution - size) & (columns > margin) & (columns < resolution - margin)
    inside[inside] = ~scene.hides(camera.position, positions[before[inside]], TOLERANCE)
    vertices, rows, columns = before[inside], rows[inside], columns[inside]
    # One a cell, the one nearest to its middle; and none where a neighbor's would be in its way.
    cell_row, cell_column = np.floor(rows / (1.5 * size)), np.floor(columns / wide)
    off = np.hypot(rows - (cell_row + 0.5) * 1.5 * size, columns - (cell_column + 0.5) * wide)
    order = np.lexsort((off, cell_column, cell_row))
    kept: dict[tuple[int, int], tuple[float, float]] = {}
    page = Image.fromarray(image)
    draw = ImageDraw.Draw(page)
    for index in order:
        place = (int(cell_row[index]), int(cell_column[index]))
        around = [kept.get((place[0] + down, place[1] + across)) for down in (-1, 0, 1) for across in (-1, 0, 1)]
        row, column = float(rows[index]), float(columns[index])
        if any(at and abs(at[0] - row) < 1.2 * size and abs(at[1] - column) < wide for at in around):
            continue
        kept[place] = (row, column)
        draw.ellipse([column - 1.5, row - 1.5, column + 1.5, row + 1.5], fill=INK)
        _write(draw, (column, row - 0.2 * size), str(vertices[index]), size, "mb")
    return np.asarray(page)


def draw_axes(image: NDArray[np.uint8], camera: Camera) -> NDArray[np.uint8]:
    """Return `image` (R, R, 3) with the directions of the axes in its lower left corner, the nearest on top."""
    resolution = len(image)
    length, size = max(14.0, 0.07 * resolution), max(10, resolution // 36)
    page = Image.fromarray(image)
    draw = ImageDraw.Draw(page)
    origin = np.array([1.7 * length, resolution - 1.7 * length])
    for axis in np.argsort(camera.back):
        name, ink = AXES[axis]
        along = np.array([camera.right[axis], -camera.up[axis]])
        end = origin + length * along
        draw.line([*origin, *end], fill=ink, width=max(2, resolution // 200))
        _write(
            draw, (float(end[0] + 0.7 * size * along[0]), float(end[1] + 0.7 * size * along[1])), name, size, "mm", ink
        )
    return np.asarray(page)


def _write(
    draw: ImageDraw.ImageDraw,
    place: tuple[float, float],
    text: str,
    size: int,
    anchor: str,
    ink: tuple[int, int, int] = INK,
) -> None:
    draw.text(place, spelled(text), ink, font(size), anchor=anchor, stroke_width=max(1, size // 8), stroke_fill=HALO)
