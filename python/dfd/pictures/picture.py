"""Pictures of a mesh for people: ray-cast, smooth at the edges, softly lit; they need no display."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy.ndimage import uniform_filter

from dfd.common import check
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Float32, Float64, Int64, UInt8
from dfd.common.threads import get_num_threads
from dfd.mesh.appearance import linear, srgb
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import smooth_normals
from dfd.pictures.colors import CLAY, weight_colors
from dfd.pictures.labels import draw_axes, draw_labels, draw_marks
from dfd.pictures.viewpoint import aim
from dfd.views.cameras import Camera
from dfd.views.raycast import Hits, Scene
from dfd.views.render import surface_points

SAMPLES = 2  # per pixel, along each side
LARGEST_RESOLUTION = 8192
BAND = 1 << 17  # samples drawn at a time, which bounds the memory of large pictures
HALO = 2  # rows of pixels drawn around a band and cut off again: as far as the smoothing of its shade reaches
CREASE = 30.0  # degrees; a smooth normal that leans further from its face leaves the edge sharp

# The light: sky from above, a lamp over the viewer's left shoulder, and shade where the surface hides the sky.
SKY, GROUND, LAMP = 0.44, 0.28, 0.68
LAMP_OFFSET = (-0.45, 0.60)  # to the right and up, against 1 towards the eye
SHADE_RAYS = 2  # per sample; the samples of a tile look in different directions and opacity what they find
TILE = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) / 16  # of samples, an ordered dither
SHADE_REACH = 0.7  # range of occlusion, of half the shape's size
SHADE_DEPTH = 0.75  # darkening by full occlusion
MAX_LAYERS = 6  # transparent surfaces along a ray
STEP = 1e-4  # past a surface, of half the shape's size


def picture(
    mesh: Mesh,
    *,
    vertices: ArrayLike | None = None,
    colors: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    handles: ArrayLike | None = None,
    fixed: ArrayLike | None = None,
    labels: Sequence[str] = (),
    azimuth: float = 35.0,
    elevation: float = 18.0,
    zoom: float = 1.0,
    target: ArrayLike | None = None,
    frame: Sequence[ArrayLike] = (),
    axes: bool = False,
    resolution: int = 512,
) -> UInt8:
    """Draw `mesh` on white, as it is or moved, in its own colors or in ones that show numbers.

    Parameters
    ----------
    vertices
        (V, 3) moved positions, mesh units; None draws the mesh as it is.
    colors
        (V, 3) sRGB in [0, 1] per vertex, blended over the faces; without `colors` and `weights` the mesh shows its
        textures, or clay.
    weights
        (V,) drawn as a heat map, see `weight_colors`.
    handles, fixed
        What to mark, handles by blue dots, fixed points by dark squares: (H, 3) positions in mesh units, or vertex
        indices. Hidden marks shine through faintly.
    labels
        A text beside each of `handles`; empty writes none.
    azimuth, elevation
        Where the camera stands, degrees: 0, 0 looks from +z at the front, azimuth 90 from +x, elevation 90 from above.
    zoom
        Above 1 nearer, below 1 farther away.
    target
        (3,) in mesh units, the middle of the picture; that of the shape if left out.
    frame
        Further positions, each (N, 3) in mesh units, that have to fit. Both pictures of a pair have one camera when
        each has the other's vertices in its `frame`.
    axes
        Whether the directions of the axes stand in the lower left corner.
    resolution
        Pixels R along a side.

    Returns
    -------
    (R, R, 3) uint8 sRGB.

    Raises ValueError if an array has the wrong shape or is not finite, a vertex index is out of range, both `colors`
    and `weights` are given, there are not as many `labels` as `handles`, or all points lie in one place.
    """
    resolution = check.whole("picture", "resolution", resolution, minimum=1, maximum=LARGEST_RESOLUTION)
    drawn = mesh.vertices
    if vertices is not None:
        drawn = check.array("picture", "vertices", vertices, mesh.vertices.shape, dtype=np.float64)
    paint = _vertex_colors(mesh, colors, weights)
    marks = [
        (_positions(name, points, drawn), square)
        for name, points, square in (("fixed", fixed, True), ("handles", handles, False))
        if points is not None
    ]
    if labels and len(labels) != (0 if handles is None else len(np.asarray(handles))):
        raise ValueError(f"picture: `labels` must be as many as `handles`, got {len(labels)}")
    normal_form, camera = aim(mesh, drawn, azimuth, elevation, zoom, target, frame)
    positions = normal_form.apply(drawn).astype(np.float32)
    scene = Scene(positions, mesh.faces)
    image = _Painter(mesh, positions, scene, camera, paint, moved=vertices is not None).draw(resolution)
    for marked, square in marks:
        draw_marks(image, scene, camera, normal_form.apply(marked), square=square)
    page = Image.fromarray((image.clip(0, 1) * 255 + 0.5).astype(np.uint8))
    if labels:
        draw_labels(page, camera, normal_form.apply(marks[-1][0]), labels)
    if axes:
        draw_axes(page, camera)
    return np.array(page)


def save_png(path: str | os.PathLike[str], image: Image.Image | UInt8) -> None:
    """Write a picture, a PIL image or a uint8 array of shape (height, width, 3), whole or not at all.

    Raises ValueError if the ending of `path` is not .png. Raises OSError if `path` cannot be written; a file that was
    there stays as it was.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"save_png: `path` must end in .png, got {os.fspath(path)}")
    drawn = image if isinstance(image, Image.Image) else Image.fromarray(image)
    with atomic_write(path) as temporary:
        drawn.save(temporary, format="PNG")


class _Painter:
    """Light and color of one shape under one camera, in normalized coordinates."""

    def __init__(
        self,
        mesh: Mesh,
        vertices: Float32,  # (V, 3) normalized
        scene: Scene,
        camera: Camera,
        colors: Float32 | None,  # (V, 3); None: the mesh's own
        *,
        moved: bool,
    ) -> None:
        self._vertices, self._faces, self._scene, self._camera = vertices, mesh.faces, scene, camera
        self._normals = smooth_normals(vertices.astype(np.float64), mesh.faces) if moved else mesh.normals
        self._colors, self._appearance = colors, mesh.appearance

    def draw(self, resolution: int) -> Float32:
        """Return the picture (R, R, 3) in sRGB, each pixel the mean of several rays."""
        image = np.empty((resolution, resolution, 3), np.float32)
        height = max(HALO, BAND // (SAMPLES * resolution * SAMPLES) // HALO * HALO)  # so that tiles lie alike in each
        bands = [slice(top, min(top + height, resolution)) for top in range(0, resolution, height)]

        def draw_band(band: slice) -> None:
            image[band] = self._band(band, resolution)

        with ThreadPoolExecutor(get_num_threads()) as threads:
            for _ in threads.map(draw_band, bands):
                pass
        return image

    def _band(self, band: slice, resolution: int) -> Float32:
        """Return some rows of the picture, (rows, R, 3)."""
        count, top = resolution * SAMPLES, max(0, band.start - HALO)
        rows = np.arange(top * SAMPLES, min(resolution, band.stop + HALO) * SAMPLES)
        directions = self._directions(rows, count)
        starts = np.broadcast_to(self._camera.position.astype(np.float32), directions.shape)
        ray = np.arange(len(directions))
        light = np.ones(len(directions), np.float32)  # remaining transmittance
        color = np.zeros((len(directions), 3), np.float32)
        for _ in range(MAX_LAYERS):
            hits = self._scene.cast(starts, directions[ray])
            place = starts[hits.ray] + directions[ray[hits.ray]] * hits.distance[:, None]
            ray = ray[hits.ray]
            rgba = self._albedo(hits)
            opacity = light[ray] * rgba[:, 3]
            normals = self._facing_normals(hits, directions[ray])
            hidden = _smoothed(self._hidden(place, normals, ray, count), ray, (len(rows), count))
            color[ray] += opacity[:, None] * rgba[:, :3] * self._light(normals, 1 - SHADE_DEPTH * hidden)[:, None]
            light[ray] -= opacity
            onward = light[ray] > 0.01
            if not onward.any():
                break
            ray = ray[onward]
            starts = place[onward] + STEP * directions[ray]
        color += light[:, None]
        # Pixels are averaged as they are displayed: at an outline, dark and white mix evenly.
        samples = srgb(color).reshape(-1, SAMPLES, resolution, SAMPLES, 3)
        pixels: Float32 = samples.mean(axis=(1, 3))
        return pixels[band.start - top : band.stop - top]

    def _directions(self, rows: NDArray[np.integer], count: int) -> Float32:
        """Unit directions through the samples of some of `count` rows of as many samples."""
        camera = self._camera
        down, across = (((each + 0.5) / count * 2 - 1) * camera.half_width for each in (rows, np.arange(count)))
        directions = across[None, :, None] * camera.right - down[:, None, None] * camera.up - camera.back
        return _unit(directions.reshape(-1, 3))

    def _albedo(self, hits: Hits) -> Float32:
        """Return linear red, green, blue, and opacity, (K, 4)."""
        rgba = np.ones((len(hits.ray), 4), np.float32)
        if self._colors is not None:
            rgba[:, :3] = surface_points(self._colors, self._faces, hits)  # blends colors as it blends positions
        elif self._appearance is not None:
            rgba = self._appearance.albedo(hits.face, hits.barycentric)
        else:
            rgba[:, :3] = CLAY
        rgba[:, :3] = linear(rgba[:, :3])
        return rgba

    def _light(self, normals: Float32, open_sky: Float32) -> Float32:
        """Return the linear light (K,) that falls on points with unit `normals` (K, 3) under a partly hidden sky."""
        right, up = self._camera.right.astype(np.float32), self._camera.up.astype(np.float32)
        lamp = _unit(self._camera.back.astype(np.float32) + LAMP_OFFSET[0] * right + LAMP_OFFSET[1] * up)
        sky = GROUND + (SKY - GROUND) * (0.5 + 0.5 * (normals @ up))
        direct = LAMP * np.maximum(normals @ lamp, 0) * (0.35 + 0.65 * open_sky)
        return sky * open_sky + direct

    def _facing_normals(self, hits: Hits, directions: Float32) -> Float32:
        """Unit normals (K, 3) on the side of the eye: smooth over gentle bends, sharp at creases."""
        corners = self._faces[hits.face]
        first = self._vertices[corners[:, 0]]
        flat = _unit(np.cross(self._vertices[corners[:, 1]] - first, self._vertices[corners[:, 2]] - first))
        normals = np.zeros_like(flat)
        for corner in range(3):
            own = self._normals[corners[:, corner]]
            sharp = np.einsum("kc,kc->k", own, flat) < np.cos(np.radians(CREASE))
            normals += hits.barycentric[:, corner : corner + 1] * np.where(sharp[:, None], flat, own)
        # Seen from behind, both turn round. A smooth normal that still looks away, close to an outline, is bent back
        # to the outline: turned round it would look into the shape.
        turned = np.where(np.einsum("kc,kc->k", flat, directions) > 0, np.float32(-1), np.float32(1))
        normals *= turned[:, None]
        normals -= np.maximum(np.einsum("kc,kc->k", normals, directions), 0)[:, None] * directions
        return _unit(normals)

    def _hidden(self, place: Float32, normals: Float32, ray: Int64, count: int) -> Float32:
        """Return how much of the sky over each point (K,) the shape itself hides, 0 to 1, nearer parts counting more.

        A sample looks in few directions, those of its place in the tile.
        """
        side = _unit(np.cross(normals, np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])))
        other = np.cross(normals, side)
        hidden = np.zeros(len(place), np.float32)
        starts = place + np.float32(2e-3) * normals
        turn = TILE[(ray // count) % 4, (ray % count) % 4]
        for index in range(SHADE_RAYS):
            angle = 2 * np.pi * (turn + index * 0.6180339887498949)
            height = ((index + 0.5) / SHADE_RAYS + 7 * turn) % 1
            radius = np.sqrt(height)
            towards = (
                (radius * np.cos(angle))[:, None] * side
                + (radius * np.sin(angle))[:, None] * other
                + np.sqrt(1 - height)[:, None] * normals
            ).astype(np.float32)
            hits = self._scene.cast(starts, towards)
            hidden[hits.ray] += (1 - hits.distance / SHADE_REACH).clip(0, 1)
        return hidden / np.float32(SHADE_RAYS)


def _smoothed(values: Float32, ray: Int64, shape: tuple[int, int]) -> Float32:
    """Return the mean (K,) of `values` (K,) over the covered samples within a tile around each sample."""
    grid = np.zeros((2, shape[0] * shape[1]), np.float32)
    grid[0, ray], grid[1, ray] = values, 1
    total, covered = (uniform_filter(each.reshape(shape), len(TILE), mode="constant").ravel()[ray] for each in grid)
    return total / np.maximum(covered, np.float32(1 / TILE.size))


def _vertex_colors(mesh: Mesh, colors: ArrayLike | None, weights: ArrayLike | None) -> Float32 | None:
    count = len(mesh.vertices)
    if colors is not None and weights is not None:
        raise ValueError("picture: `colors` and `weights` cannot both be given")
    if weights is not None:
        return weight_colors(check.array("picture", "weights", weights, (count,)))
    if colors is not None:
        return check.array("picture", "colors", colors, (count, 3)).clip(0, 1)
    return None


def _positions(name: str, dots: Any, vertices: Float64) -> Float64:
    """Positions (H, 3) of dots that are given as such or as vertex indices."""
    if np.ndim(dots) == 2:
        return check.array("picture", name, dots, ("H", 3), dtype=np.float64)
    return vertices[check.vertex_indices("picture", name, dots, len(vertices))]


def _unit(vectors: NDArray[np.floating[Any]]) -> Float32:
    unit: Float32 = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
    return unit.astype(np.float32, copy=False)
