"""Pictures for people: a mesh in clay, in heat colours or in its own, ray-cast, with no display needed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from dfd import check
from dfd.cameras import Camera, camera_towards
from dfd.colors import CLAY, weight_colors
from dfd.files import atomic_write
from dfd.render import normalization, surface_points
from dfd.scene import Hits, Scene

if TYPE_CHECKING:
    from dfd.mesh import Mesh

__all__ = ["contact_sheet", "picture", "save_png"]

FIELD_OF_VIEW = 30.0  # degrees: a longer lens than the encoder's, so that proportions look right
_SAMPLES = 2  # along a side of each pixel
_KEY_LIGHT = np.array([-0.35, 0.55, 0.75]) / np.linalg.norm([-0.35, 0.55, 0.75])  # right, up and back of the camera
_INK, _FAINT = (40, 40, 40), (120, 120, 120)


def picture(
    mesh: Mesh,
    *,
    vertices: ArrayLike | None = None,
    colors: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    handles: ArrayLike | None = None,
    fixed: ArrayLike | None = None,
    azimuth: float = 30.0,
    elevation: float = 15.0,
    frame: Sequence[ArrayLike] = (),
    resolution: int = 512,
) -> NDArray[np.uint8]:
    """Draw `mesh`, (resolution, resolution, 3) on white.

    Parameters
    ----------
    vertices
        (V, 3) where its vertices are now, mesh units; its own positions if left out.
    colors, weights
        (V, 3) red, green and blue in [0, 1], or (V,) weights drawn as heat; clay or the mesh's own colours if both are
        left out.
    handles, fixed
        (H, 3) points in mesh units to mark: handles with a blue dot, fixed points with a dark square; a ring where the
        mesh hides them.
    azimuth, elevation
        From where it is seen, degrees: round the y axis from the front (+z) towards +x, and up.
    frame
        Further positions (N, 3) that have to fit into the picture, so that several pictures share one camera.
    resolution
        Pixels along a side.

    Raises
    ------
    ValueError
        If an argument has another shape, or both `colors` and `weights` are given.
    """
    if colors is not None and weights is not None:
        raise ValueError("picture: `colors` and `weights` must not both be given")
    count = len(mesh.vertices)
    center, scale = normalization(mesh)

    def normalized(name: str, points: ArrayLike, rows: int | str) -> NDArray[np.float64]:
        return (check.array("picture", name, points, (rows, 3), dtype=np.float64) - center) * scale

    places = normalized("vertices", mesh.vertices if vertices is None else vertices, count)
    if weights is not None:
        colors = weight_colors(check.array("picture", "weights", weights, (count,), dtype=np.float64))
    vertex_colors = None if colors is None else check.array("picture", "colors", colors, (count, 3), dtype=np.float32)

    around = np.concatenate([places, *(normalized("frame", points, "N") for points in frame)])
    angle, height = np.radians(azimuth), np.radians(np.clip(elevation, -89, 89))
    direction = (np.sin(angle) * np.cos(height), np.sin(height), np.cos(angle) * np.cos(height))
    camera = camera_towards(direction, around, field_of_view=FIELD_OF_VIEW)

    scene = Scene(places, mesh.faces)
    image = Image.fromarray(_draw(scene, mesh, places, vertex_colors, camera, int(resolution)))
    for name, points, square in (("fixed", fixed, True), ("handles", handles, False)):
        if points is not None:
            _mark(image, scene, camera, normalized(name, points, "H"), square=square)
    return np.asarray(image)


def _draw(
    scene: Scene,
    mesh: Mesh,
    places: NDArray[np.float64],
    colors: NDArray[np.float32] | None,
    camera: Camera,
    resolution: int,
) -> NDArray[np.uint8]:
    fine = resolution * _SAMPLES
    directions = camera.ray_directions(fine)
    hits = scene.cast(camera.position, directions)
    light = _light(mesh, places, hits, directions, camera)
    if colors is not None:
        surface = surface_points(colors, mesh.faces, hits)  # blends colours as it blends positions
        opacity = np.ones((len(hits.ray), 1), np.float32)
    elif mesh.appearance is not None:
        rgba = mesh.appearance.albedo(hits.face, hits.barycentric)
        surface, opacity = rgba[:, :3], rgba[:, 3:]
    else:
        surface, opacity = np.broadcast_to(np.float32(CLAY), (len(hits.ray), 3)), np.float32(1)
    canvas = np.ones((fine * fine, 3), np.float32)
    canvas[hits.ray] += opacity * (np.clip(surface * light[:, None], 0, 1) - 1)
    pixels = canvas.reshape(resolution, _SAMPLES, resolution, _SAMPLES, 3).mean(axis=(1, 3))
    return (pixels * 255 + 0.5).astype(np.uint8)


def _light(
    mesh: Mesh, places: NDArray[np.float64], hits: Hits, directions: NDArray[np.float32], camera: Camera
) -> NDArray[np.float32]:
    """Light on each hit, (K,): a key light from the upper left, a fill from the eye, darker towards the outline."""
    from dfd.mesh import smooth_normals

    normals = surface_points(smooth_normals(places, mesh.faces), mesh.faces, hits)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    towards = -np.einsum("kc,kc->k", normals, directions[hits.ray])
    normals *= np.where(towards < 0, -1, 1)[:, None].astype(np.float32)  # light back faces like front ones
    key = normals @ (np.stack([camera.right, camera.up, camera.back], axis=1) @ _KEY_LIGHT).astype(np.float32)
    light = 0.42 + 0.46 * np.maximum(key, 0) + 0.24 * np.abs(towards)
    return light.astype(np.float32)


def _mark(image: Image.Image, scene: Scene, camera: Camera, points: NDArray[np.float64], *, square: bool) -> None:
    resolution = image.width
    row, column = camera.project(points, resolution)
    offset = points - camera.position
    hits = scene.cast(camera.position, offset)
    hidden = np.zeros(len(points), bool)
    hidden[hits.ray] = hits.distance < 1 - 0.02 / np.linalg.norm(offset[hits.ray], axis=1)
    draw = ImageDraw.Draw(image)
    radius = max(3.0, resolution / 80)
    shape = draw.rectangle if square else draw.ellipse
    ink = (30, 30, 30) if square else (30, 90, 200)
    for x, y, behind in zip(column, row, hidden, strict=True):
        shape((x - radius - 1.5, y - radius - 1.5, x + radius + 1.5, y + radius + 1.5), fill=(255, 255, 255))
        box = (x - radius, y - radius, x + radius, y + radius)
        shape(box, fill=None if behind else ink, outline=ink, width=max(2, resolution // 250))


def contact_sheet(
    rows: Sequence[tuple[str, Sequence[tuple[NDArray[np.uint8], str]]]], *, title: str = "", cell: int = 320
) -> Image.Image:
    """Lay captioned pictures out in titled rows.

    Parameters
    ----------
    rows
        Each a title and its pictures, (height, width, 3) 8-bit with a caption; every picture becomes `cell` high.
    title
        Stands over the sheet.
    cell
        Height of a picture, pixels.
    """
    margin, gap, caption, heading = cell // 10, cell // 16, cell // 9, cell // 6
    small, large = ImageFont.load_default(cell // 18), ImageFont.load_default(cell // 13)
    scaled = [
        (
            name,
            [
                (Image.fromarray(image).resize((_width(image, cell), cell), Image.Resampling.LANCZOS), text)
                for image, text in pictures
            ],
        )
        for name, pictures in rows
    ]
    width = max((sum(image.width + gap for image, _ in pictures) - gap for _, pictures in scaled), default=0)
    top = margin + (heading if title else 0)
    sheet = Image.new("RGB", (width + 2 * margin, top + len(rows) * (heading + cell + caption) + margin), "white")
    draw = ImageDraw.Draw(sheet)
    if title:
        draw.text((margin, margin // 2), title, fill=_INK, font=ImageFont.load_default(cell // 9))
    for name, pictures in scaled:
        draw.text((margin, top + heading // 3), name, fill=_INK, font=large)
        left = margin
        for image, text in pictures:
            sheet.paste(image, (left, top + heading))
            draw.text((left + image.width / 2, top + heading + cell), text, fill=_FAINT, font=small, anchor="ma")
            left += image.width + gap
        top += heading + cell + caption
    return sheet


def _width(image: NDArray[np.uint8], height: int) -> int:
    return max(1, round(image.shape[1] * height / image.shape[0]))


def heat_bar(height: int) -> NDArray[np.uint8]:
    """A strip that explains the heat colours, from weight 0 at the bottom to 1 at the top."""
    width = max(60, height // 8)
    strip = Image.new("RGB", (width, height), "white")
    bar = weight_colors(np.linspace(1, 0, height * 8 // 10))[:, None]
    pixels = np.repeat((bar * 255 + 0.5).astype(np.uint8), width // 3, axis=1)
    strip.paste(Image.fromarray(pixels), (0, height // 10))
    draw, font = ImageDraw.Draw(strip), ImageFont.load_default(max(10, height // 24))
    for value in (0.0, 0.5, 1.0):
        y = height // 10 + (1 - value) * (len(bar) - 1)
        draw.text((width // 3 + 5, y), f"{value:g}", fill=_FAINT, font=font, anchor="lm")
    return np.asarray(strip)


def save_png(path: str | os.PathLike[str], image: Image.Image | NDArray[np.uint8]) -> None:
    """Write a picture to `path` (.png), whole or not at all.

    Raises
    ------
    ValueError
        If the ending is not .png.
    OSError
        If it cannot be written.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"save_png: `path` must end in .png, got {os.fspath(path)}")
    drawn = image if isinstance(image, Image.Image) else Image.fromarray(image)
    with atomic_write(path) as temporary:
        drawn.save(temporary)
