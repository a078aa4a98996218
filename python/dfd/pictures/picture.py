"""Draw a mesh by ray casting, with antialiasing and ambient occlusion; no display is needed."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from scipy.ndimage import uniform_filter

from dfd.common import check
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Float32, Float64, Int64, UInt8
from dfd.common.threads import parallel_ranges
from dfd.mesh.appearance import blend
from dfd.mesh.colors import linear, srgb
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import smooth_normals
from dfd.pictures.colors import CLAY, weight_colors
from dfd.pictures.labels import draw_axes, draw_labels, draw_marks
from dfd.pictures.viewpoint import aim
from dfd.views.cameras import Camera
from dfd.views.raycast import Hits, Scene

SAMPLES = 2  # number of samples along each side of a pixel
LARGEST_RESOLUTION = 8192
BAND = 1 << 17  # about the number of samples in a band, a range of rows that one task draws; this limits the memory
HALO = 2  # number of further rows of pixels above and below a band, only used to smooth occlusion
CREASE = 30.0  # if smooth and face normals differ by more than this angle, in degrees, the face normal is used

# Brightness of the sky above, of the ground below, and of a lamp above and to the left of the camera.
SKY, GROUND, LAMP = 0.44, 0.28, 0.68
LAMP_OFFSET = (-0.45, 0.60)  # components of the lamp's direction to the right and up; the component to the camera is 1
SHADE_RAYS = 2  # number of rays per sample that test ambient occlusion
# Ordered dither: the 4 × 4 samples of a tile cast occlusion rays in different directions.
TILE = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) / 16
SHADE_REACH = 0.7  # surfaces at a larger distance do not occlude; the shape lies in [−1, 1]³
SHADE_DEPTH = 0.75  # fraction of the sky that counts as hidden at full occlusion
MAX_LAYERS = 6  # largest number of surfaces that are drawn along a ray
STEP = 1e-4  # distance behind a transparent surface at which a ray continues; the shape lies in [−1, 1]³


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
    """Return a picture of `mesh` on white, with its own vertices and colors or with given ones.

    Raises ValueError if an array has the wrong shape or is not finite, or a vertex index is out of range. Raises
    ValueError if both `colors` and `weights` are given, if there are not as many `labels` as `handles`, or if all
    points have the same position.

    Parameters
    ----------
    vertices
        (V, 3) moved positions in mesh units; None draws the mesh at rest.
    colors
        (V, 3) sRGB colors of the vertices, in [0, 1], interpolated over the faces. Without `colors` and `weights`, the
        mesh is drawn in its own colors, or in the color of clay if it has none.
    weights
        (V,) weights, drawn as a heat map; see `weight_colors`.
    handles, fixed
        (H, 3) positions in mesh units, or vertex indices. Blue dots mark handles, and dark squares mark fixed points.
        Hidden marks are faint.
    labels
        A text beside each of `handles`, or an empty sequence.
    azimuth, elevation
        Direction from the shape to the camera, in degrees. With 0 and 0, the camera is in front of the shape, at +z. At
        azimuth 90 it is at +x, and at elevation 90 above the shape.
    zoom
        Magnification of the shape in the picture.
    target
        (3,) the point at the center of the picture, in mesh units; None centers the shape.
    frame
        Arrays (N, 3) of further positions, in mesh units, that the picture must contain. Pictures of two poses have the
        same camera if the `frame` of each contains the vertices of the other.
    axes
        Whether to draw the axes x, y and z in the lower left corner.
    resolution
        R, the side of the picture in pixels.

    Returns
    -------
    (R, R, 3) uint8 sRGB.
    """
    resolution = check.whole("picture", "resolution", resolution, minimum=1, maximum=LARGEST_RESOLUTION)
    drawn = mesh.vertices
    if vertices is not None:
        drawn = check.array("picture", "vertices", vertices, mesh.vertices.shape, dtype=np.float64)
    if colors is not None and weights is not None:
        raise ValueError("picture: `colors` and `weights` cannot both be given")
    paint = None  # the mesh's own colors
    if weights is not None:
        paint = weight_colors(check.array("picture", "weights", weights, (len(drawn),)))
    elif colors is not None:
        paint = check.array("picture", "colors", colors, (len(drawn), 3)).clip(0, 1)
    marks = [
        (_positions(name, points, drawn), square)
        for name, points, square in (("fixed", fixed, True), ("handles", handles, False))
        if points is not None
    ]
    if labels and len(labels) != (0 if handles is None else len(np.asarray(handles))):
        raise ValueError(f"picture: `labels` must have one text for each of `handles`, got {len(labels)}")
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
    """Write a picture atomically. `image` is a PIL image, or a uint8 array of shape (height, width, 3).

    Raises ValueError if the ending of `path` is not .png. Raises OSError if `path` cannot be written; an existing file
    is then unchanged.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"save_png: `path` must end in .png, got {os.fspath(path)}")
    drawn = image if isinstance(image, Image.Image) else Image.fromarray(image)
    with atomic_write(path) as temporary:
        drawn.save(temporary, format="PNG")


class _Painter:
    """Computes the light and color of a shape for one camera. All coordinates lie in the cube [−1, 1]³."""

    def __init__(
        self,
        mesh: Mesh,
        vertices: Float32,  # (V, 3) vertices in the cube
        scene: Scene,
        camera: Camera,
        colors: Float32 | None,  # (V, 3) sRGB; None for the mesh's own colors
        *,
        moved: bool,
    ) -> None:
        self._vertices, self._faces, self._scene, self._camera = vertices, mesh.faces, scene, camera
        self._normals = smooth_normals(vertices.astype(np.float64), mesh.faces) if moved else mesh.normals
        self._colors, self._appearance = colors, mesh.appearance

    def draw(self, resolution: int) -> Float32:
        """Return the picture (R, R, 3) in sRGB; each pixel is the mean of several samples."""
        image = np.empty((resolution, resolution, 3), np.float32)
        # The height of a band is a multiple of HALO, so that the tiles of all bands are aligned.
        height = max(HALO, BAND // (SAMPLES * resolution * SAMPLES) // HALO * HALO)

        def draw_band(begin: int, end: int) -> None:
            image[begin:end] = self._band(begin, end, resolution)

        parallel_ranges(resolution, height, draw_band)
        return image

    def _band(self, begin: int, end: int, resolution: int) -> Float32:
        """Return the rows from `begin` to `end` of the picture, (rows, R, 3)."""
        count, top = resolution * SAMPLES, max(0, begin - HALO)
        rows = np.arange(top * SAMPLES, min(resolution, end + HALO) * SAMPLES)
        directions = self._directions(rows, count)
        starts = np.broadcast_to(self._camera.position.astype(np.float32), directions.shape)
        ray = np.arange(len(directions))
        light = np.ones(len(directions), np.float32)  # transmittance of the surfaces in front of the next hit
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
        # The mean of sRGB values gives smoother outlines of dark surfaces on white than the mean of linear light.
        samples = srgb(color).reshape(-1, SAMPLES, resolution, SAMPLES, 3)
        pixels: Float32 = samples.mean(axis=(1, 3))
        return pixels[begin - top : end - top]

    def _directions(self, rows: NDArray[np.integer], count: int) -> Float32:
        """Return the ray directions (S, 3) of all samples in `rows`, in a picture of `count` × `count` samples."""
        camera = self._camera
        down, across = (((each + 0.5) / count * 2 - 1) * camera.half_width for each in (rows, np.arange(count)))
        directions = across[None, :, None] * camera.right - down[:, None, None] * camera.up - camera.back
        return _unit(directions.reshape(-1, 3))

    def _albedo(self, hits: Hits) -> Float32:
        """Return the linear red, green, blue and opacity of each hit, (K, 4)."""
        rgba = np.ones((len(hits.ray), 4), np.float32)
        if self._colors is not None:
            rgba[:, :3] = blend(self._colors, self._faces.take(hits.face, axis=0), hits.barycentric)
        elif self._appearance is not None:
            rgba = self._appearance.albedo(hits.face, hits.barycentric)
        else:
            rgba[:, :3] = CLAY
        rgba[:, :3] = linear(rgba[:, :3])
        return rgba

    def _light(self, normals: Float32, open_sky: Float32) -> Float32:
        """Return the light (K,) at points with unit `normals` (K, 3) and `open_sky` (K,), the visible share of sky."""
        right, up = self._camera.right.astype(np.float32), self._camera.up.astype(np.float32)
        lamp = _unit(self._camera.back.astype(np.float32) + LAMP_OFFSET[0] * right + LAMP_OFFSET[1] * up)
        sky = GROUND + (SKY - GROUND) * (0.5 + 0.5 * (normals @ up))
        direct = LAMP * np.maximum(normals @ lamp, 0) * (0.35 + 0.65 * open_sky)
        return sky * open_sky + direct

    def _facing_normals(self, hits: Hits, directions: Float32) -> Float32:
        """Return unit normals (K, 3) that face the camera: smooth normals, or face normals near creases."""
        corners = self._faces[hits.face]
        first = self._vertices[corners[:, 0]]
        flat = _unit(np.cross(self._vertices[corners[:, 1]] - first, self._vertices[corners[:, 2]] - first))
        normals = np.zeros_like(flat)
        for corner in range(3):
            own = self._normals[corners[:, corner]]
            sharp = np.einsum("kc,kc->k", own, flat) < np.cos(np.radians(CREASE))
            normals += hits.barycentric[:, corner : corner + 1] * np.where(sharp[:, None], flat, own)
        # If a face is seen from behind, its normals are reversed. Near an outline, a smooth normal can still point away
        # from the camera. Such a normal is made perpendicular to the ray, because its reverse would point inward.
        turned = np.where(np.einsum("kc,kc->k", flat, directions) > 0, np.float32(-1), np.float32(1))
        normals *= turned[:, None]
        normals -= np.maximum(np.einsum("kc,kc->k", normals, directions), 0)[:, None] * directions
        return _unit(normals)

    def _hidden(self, place: Float32, normals: Float32, ray: Int64, count: int) -> Float32:
        """Return the fraction (K,) of the sky that the shape hides from each of K points; near surfaces hide more.

        From each sample, few rays are cast, in directions that depend on the position of the sample in its tile.
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
    """Return the mean (K,) of `values` (K,) over a tile around each sample; only samples on the shape count."""
    grid = np.zeros((2, shape[0] * shape[1]), np.float32)
    grid[0, ray], grid[1, ray] = values, 1
    total, covered = (uniform_filter(each.reshape(shape), len(TILE), mode="constant").ravel()[ray] for each in grid)
    return total / np.maximum(covered, np.float32(1 / TILE.size))


def _positions(name: str, dots: Any, vertices: Float64) -> Float64:
    """Return the positions (H, 3) of marks, from positions or vertex indices `dots`."""
    if np.ndim(dots) == 2:
        return check.array("picture", name, dots, ("H", 3), dtype=np.float64)
    return vertices[check.vertex_indices("picture", name, dots, len(vertices))]


def _unit(vectors: NDArray[np.floating[Any]]) -> Float32:
    unit: Float32 = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)
    return unit.astype(np.float32, copy=False)
