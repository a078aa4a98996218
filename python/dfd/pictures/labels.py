"""Draw marks and text on pictures: dots at handles, squares at fixed points, labels and the axes of coordinates."""

import unicodedata
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from dfd.common.linear_algebra import Float32, Float64
from dfd.views.cameras import Camera
from dfd.views.raycast import Scene

# Replacements of letters that the typeface lacks.
_SPELLED = {"λ": "lambda", "→": "->", "×": "x", "−": "-", "≥": ">=", "≤": "<="}


@lru_cache(maxsize=32)
def font(size: int) -> ImageFont.FreeTypeFont:
    """Return Pillow's own typeface, `size` pixels high.

    Raises RuntimeError if Pillow was built without FreeType; all wheels of Pillow contain FreeType.
    """
    loaded = ImageFont.load_default(size)
    if not isinstance(loaded, ImageFont.FreeTypeFont):
        raise RuntimeError("pictures with text need a Pillow that was built with FreeType")
    return loaded


def spelled(text: str) -> str:
    """Replace letters that the typeface lacks by similar letters; a letter without a similar one becomes "?"."""
    return "".join(_letter(letter) for letter in text)


def wrapped(text: str, typeface: ImageFont.FreeTypeFont, width: float) -> list[str]:
    """Divide `spelled(text)` at spaces into lines of at most `width` pixels; a wider word gets a line of its own."""
    lines: list[str] = []
    for word in spelled(text).split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and typeface.getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


@lru_cache(maxsize=1024)
def _letter(letter: str) -> str:
    """Return `letter`, or a replacement if the typeface lacks it."""
    if letter.isspace() or _drawable(letter):
        return letter
    plain = _SPELLED.get(letter) or "".join(
        part for part in unicodedata.normalize("NFKD", letter) if not unicodedata.combining(part)
    )
    plain = plain.replace("⁄", "/").replace("−", "-")
    return plain if plain and all(_drawable(part) for part in plain) else "?"


def _drawable(letter: str) -> bool:
    """Return whether the typeface has the letter. It draws the same box for all letters that it lacks."""
    typeface = font(20)
    mask, box = typeface.getmask(letter), typeface.getmask("\uffff")
    return mask.size != box.size or bytes(mask) != bytes(box)


INK, HALO = (20, 22, 28), (255, 255, 255)
AXES = (("x", (204, 44, 44)), ("y", (38, 140, 54)), ("z", (36, 84, 200)))


def draw_labels(page: Image.Image, camera: Camera, positions: Float64, labels: Sequence[str]) -> None:
    """Write a label beside each of `positions` (H, 3), which are in the same coordinates as the camera."""
    draw, size = ImageDraw.Draw(page), max(11, page.height // 30)
    for row, column, text in zip(*camera.project(positions, page.height), labels, strict=True):
        top = max(float(row) - 0.7 * size, 0.7 * size)  # the label stays inside the page
        _write(draw, (float(column) + 0.7 * size, top), text, size, "lm")


def draw_axes(page: Image.Image, camera: Camera) -> None:
    """Draw the x, y and z axes in the lower left corner. The axis that points most towards the camera is on top."""
    resolution = page.height
    length, size = max(14.0, 0.07 * resolution), max(10, resolution // 36)
    draw = ImageDraw.Draw(page)
    origin = np.array([1.7 * length, resolution - 1.7 * length])
    for axis in np.argsort(camera.back):
        name, ink = AXES[axis]
        along = np.array([camera.right[axis], -camera.up[axis]])
        end = origin + length * along
        draw.line([*origin, *end], fill=ink, width=max(2, resolution // 200))
        beside = end + 0.7 * size * along
        _write(draw, (float(beside[0]), float(beside[1])), name, size, "mm", ink)


def _write(
    draw: ImageDraw.ImageDraw,
    place: tuple[float, float],
    text: str,
    size: int,
    anchor: str,
    ink: tuple[int, int, int] = INK,
) -> None:
    draw.text(place, spelled(text), ink, font(size), anchor=anchor, stroke_width=max(1, size // 8), stroke_fill=HALO)


BLUE, DARK = (0.10, 0.36, 0.86), (0.13, 0.14, 0.17)
RADIUS, SMALLEST = 0.013, 2.0  # radius of a mark, as a fraction of the picture's side; smallest radius, in pixels
RIM = 1.4  # outer radius of the white rim around a mark, divided by the radius of the mark
HIDDEN = 0.3  # opacity of a mark that the shape hides
INSIDE = 0.02  # a mark is hidden if a surface lies more than this distance in front of it; the shape lies in [−1, 1]³


def draw_marks(image: Float32, scene: Scene, camera: Camera, positions: Float64, *, square: bool) -> None:
    """Draw dots or squares with white rims into `image` (R, R, 3), at `positions` (H, 3) in the scene's coordinates.

    Hidden marks are faint. Marks behind the camera are left out.
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
        # Only pixels around the mark change.
        margin = int(radius * RIM) + 2
        top, left = max(0, int(row) - margin), max(0, int(column) - margin)
        patch = image[top : max(0, int(row) + margin + 1), left : max(0, int(column) + margin + 1)]
        down, across = np.arange(top, top + patch.shape[0]) - row, np.arange(left, left + patch.shape[1]) - column
        distance = np.hypot(down[:, None], across)
        if square:  # the factor makes a square look as large as a dot
            distance = np.maximum(np.abs(down)[:, None], np.abs(across)) * 1.1
        for edge, ink in ((radius * RIM, (1.0, 1.0, 1.0)), (radius, DARK if square else BLUE)):
            cover = (edge - distance + 0.5).clip(0, 1) * (HIDDEN if behind else 1)
            patch += (cover[:, :, None] * (np.array(ink) - patch)).astype(np.float32)
