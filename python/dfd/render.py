"""From a mesh to pictures of it, and the surface point behind every pixel (paper, Eq. 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.cameras import Camera, place_cameras
from dfd.progress import Stages
from dfd.scene import Hits, Scene
from dfd.shading import Shading

if TYPE_CHECKING:
    from dfd.mesh import Mesh

__all__ = ["Views", "render"]

LARGEST_RESOLUTION = 8192


@dataclass(frozen=True, eq=False)
class Views:
    """Pictures of a shape, and the surface points that they show.

    Attributes
    ----------
    images
        (n, R, R, 3) 8-bit red, green and blue as displayed, on white.
    cameras
        One a picture.
    points
        (P, 3) float32 surface points in normalised coordinates: (p − `center`) · `scale` for p in mesh units.
    view, row, column
        (P,) the picture that shows each point, and where in it, in pixels; whole numbers are pixel centres.
    center, scale
        The normalisation: the middle of the bounding box comes to the origin, its longest side to [−1, 1].
    """

    images: NDArray[np.uint8]
    cameras: list[Camera]
    points: NDArray[np.float32]
    view: NDArray[np.int16]
    row: NDArray[np.float32]
    column: NDArray[np.float32]
    center: NDArray[np.float64]
    scale: float


def normalization(mesh: Mesh) -> tuple[NDArray[np.float64], float]:
    """Centre (3,) and factor that bring the box of `mesh` to [−1, 1] along its longest side.

    Raises
    ------
    ValueError
        If all vertices are one point.
    """
    center = np.asarray(mesh.bounds, np.float64).mean(axis=0)
    side = float(np.max(mesh.extents))
    if side <= 0:
        raise ValueError("render: `mesh` must have some extent, got all vertices at one point")
    return center, 2.0 / side


def render(
    mesh: Mesh,
    *,
    views: int = 24,
    resolution: int = 518,
    framing: str = "shape",
    mirrored: bool = False,
    simplify_to: int | None = None,
    supervision: str = "barycentric",
    stages: Stages | None = None,
) -> Views:
    """Take pictures of `mesh` from all around.

    One ray goes through the centre of every pixel; where it first meets a triangle T at barycentric coordinates B, the
    pixel shows the surface point P = B·T.

    Parameters
    ----------
    views, resolution
        How many pictures, and pixels along a side of each.
    framing
        "shape" fills every picture with the shape, "paper" keeps the paper's distance.
    mirrored
        Cameras, and with them pictures, come in mirrored pairs.
    simplify_to
        Cast rays at a copy of at most so many faces (quadric error simplification) instead of the mesh itself.
    supervision
        Which points are returned: "barycentric" for those behind all covered pixels, "vertex" for the visible vertices.

    Raises
    ------
    ValueError
        If an argument is out of its range, or no ray meets the mesh.
    """
    _check_whole("views", views, 32767)
    _check_whole("resolution", resolution, LARGEST_RESOLUTION)
    if supervision not in ("barycentric", "vertex"):
        raise ValueError(f"render: `supervision` must be 'barycentric' or 'vertex', got {supervision!r}")
    stages = stages or Stages(show=False)
    if simplify_to is not None:
        from dfd.simplify import simplify

        with stages.stage("simplify"):
            mesh = simplify(mesh, simplify_to)
    center, scale = normalization(mesh)
    vertices = ((mesh.vertices - center) * scale).astype(np.float32)
    with stages.stage("render", views) as advance:
        scene = Scene(vertices, mesh.faces)
        shading = Shading(scene, mesh)
        cameras = place_cameras(views, vertices, framing=framing, mirrored=mirrored)
        images = np.empty((views, resolution, resolution, 3), np.uint8)
        seen = []
        for index, camera in enumerate(cameras):
            images[index], hits = shading.picture(camera, resolution)
            if supervision == "vertex":
                points, row, column = _visible_vertices(scene, vertices, camera, resolution)
            else:
                row, column = np.divmod(hits.ray, resolution)
                points = surface_points(vertices, mesh.faces, hits)
            seen.append((points, np.full(len(row), index, np.int16), row.astype(np.float32), column.astype(np.float32)))
            advance()
    points, view, row, column = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    if len(points) == 0:
        raise ValueError("render: `mesh` is seen by no camera: all its faces are without area, or smaller than a pixel")
    return Views(images, cameras, points, view, row, column, center, scale)


def surface_points(vertices: NDArray[np.float32], faces: NDArray[np.int32], hits: Hits) -> NDArray[np.float32]:
    """P = B·T (Eq. 2) of all hits, (K, 3), in the units of `vertices`."""
    corners = faces[hits.face]
    points = hits.barycentric[:, :1] * vertices[corners[:, 0]]
    points += hits.barycentric[:, 1:2] * vertices[corners[:, 1]]
    points += hits.barycentric[:, 2:] * vertices[corners[:, 2]]
    return points


def _visible_vertices(
    scene: Scene, vertices: NDArray[np.float32], camera: Camera, resolution: int
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """Vertices that nothing hides from the camera, and the pixels that they fall on."""
    offset = vertices - camera.position
    hits = scene.cast(camera.position, offset)
    # The ray ends at the vertex at distance 1; what it meets clearly before is in front of it.
    hidden = np.zeros(len(vertices), bool)
    hidden[hits.ray] = hits.distance < 1 - 1e-3
    row, column = camera.project(vertices, resolution)
    inside = (np.minimum(row, column) >= -0.5) & (np.maximum(row, column) <= resolution - 0.5)
    chosen = ~hidden & inside
    return vertices[chosen], row[chosen], column[chosen]


def _check_whole(name: str, value: object, largest: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= largest:
        raise ValueError(f"render: `{name}` must be a whole number from 1 to {largest}, got {value!r}")
