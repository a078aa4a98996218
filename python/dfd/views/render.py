"""Render pictures of a mesh, with the surface point of each pixel (paper, Eq. 2)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64, Int32, UInt8
from dfd.common.progress import Stages
from dfd.common.threads import get_num_threads
from dfd.geometry.normalization import normalization
from dfd.mesh.appearance import blend
from dfd.views.cameras import Camera, Framing, place_cameras
from dfd.views.raycast import Scene
from dfd.views.shading import Shading

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

Supervision = Literal["barycentric", "vertex"]

LARGEST_RESOLUTION = 4096
LARGEST_VIEWS = 32767  # because `Views.view` stores 16-bit integers


@dataclass(frozen=True, eq=False)
class Views:
    """Pictures of a shape, and the surface points of their pixels."""

    images: UInt8  # (n, R, R, 3) n pictures of R × R pixels, 8-bit sRGB, on a white background
    covered: Bool  # (n, R, R) whether a pixel shows the shape
    cameras: list[Camera]  # the camera of each picture
    points: Float32  # (P, 3) surface points, normalized: (p − `center`) · `scale` for a position p in mesh units
    view: NDArray[np.int16]  # (P,) the index of the picture that shows each point
    row: Float32  # (P,) row of each point in its picture, in pixels; whole numbers are pixel centers
    column: Float32  # (P,) column of each point in its picture, in pixels
    face: Int32  # (P,) the index of each point's face; empty if the points are vertices
    vertices: Float32  # (V, 3) normalized vertices of the rendered surface: the mesh, or a simplified copy
    faces: Int32  # (F, 3) faces of the rendered surface
    # The normalization maps the center of the bounding box to the origin, and the box's longest side to [−1, 1].
    center: Float64
    scale: float
    frame: Float64 = field(default_factory=lambda: np.eye(3))  # (3, 3) rows: the shape's right, up and front
    scene: Scene | None = None  # the search tree of `vertices` and `faces`, if it is kept


def render(
    mesh: Mesh,
    *,
    views: int = 24,
    resolution: int = 518,
    framing: Framing = "shape",
    mirrored: bool = False,
    simplify_to: int | None = None,
    supervision: Supervision = "barycentric",
    frame: Float64 | None = None,
    stages: Stages | None = None,
) -> Views:
    """Return pictures of `mesh` from all directions.

    A ray passes through the center of each pixel. If its first hit on a surface that is at least half opaque is on a
    triangle T, at barycentric coordinates B, the pixel shows the surface point P = B·T.

    Raises ValueError if an argument is out of its range, or no camera ray hits the mesh.

    Parameters
    ----------
    views, resolution
        The number of pictures, and the side of a picture in pixels.
    framing
        "shape" fills each picture with the shape; "paper" places all cameras at the distance of the paper.
    mirrored
        Whether cameras form groups of four that are mirror images of each other; see `place_cameras`.
    simplify_to
        The number of faces of a simplified copy, which is rendered instead of the mesh; None renders the mesh itself.
    supervision
        Which points the result has: "barycentric" for the surface points of all pixels that show the shape, "vertex"
        for the visible vertices.
    frame
        (3, 3) matrix whose rows are right, up and front of the shape, in mesh coordinates; None takes the mesh's axes.
    """
    views = check.whole("render", "views", views, minimum=1, maximum=LARGEST_VIEWS)
    resolution = check.whole("render", "resolution", resolution, minimum=1, maximum=LARGEST_RESOLUTION)
    if simplify_to is not None:
        simplify_to = check.whole("render", "simplify_to", simplify_to, minimum=4)
    check.choice("render", "framing", framing, Framing)
    check.choice("render", "supervision", supervision, Supervision)
    stages = stages or Stages(show=False)
    center, scale = normalization(mesh)
    if simplify_to is not None:
        from dfd.geometry.simplify import simplify

        with stages.stage("simplify"):
            mesh = simplify(mesh, simplify_to)
    with stages.stage("render", views) as advance:
        vertices = ((mesh.vertices - center) * scale).astype(np.float32)
        scene = Scene(vertices, mesh.faces)
        shading = Shading(scene, mesh, vertices)
        used = used_vertices(vertices, mesh.faces)
        axes = np.eye(3) if frame is None else frame
        placed = place_cameras(views, used @ axes.T, framing=framing, mirrored=mirrored)
        cameras = [camera.in_mesh(axes) for camera in placed]
        images = np.empty((views, resolution, resolution, 3), np.uint8)
        covered = np.zeros((views, resolution, resolution), bool)
        hit = np.zeros(views, bool)  # for each picture, whether any ray hits the surface

        def take(index: int) -> tuple[Float32, Float32, Float32, Int32]:  # points, rows, columns and faces
            images[index], hits = shading.picture(cameras[index], resolution)
            covered[index].ravel()[hits.ray] = True
            hit[index] = len(hits.ray) > 0
            if supervision == "vertex":
                row, column = cameras[index].project(used, resolution)
                inside = (np.minimum(row, column) >= -0.5) & (np.maximum(row, column) <= resolution - 0.5)
                chosen = inside & ~scene.hides(cameras[index].position, used, 1e-3)
                placed = row[chosen].astype(np.float32), column[chosen].astype(np.float32)
                # A vertex at the outline can lie in a pixel whose ray misses the surface.
                place = np.rint(placed).astype(np.int32).clip(0, resolution - 1)
                covered[index, place[0], place[1]] = True
                return used[chosen], *placed, np.zeros(0, np.int32)
            row, column = np.divmod(hits.ray.astype(np.int32), resolution)
            points = blend(vertices, mesh.faces.take(hits.face, axis=0), hits.barycentric)  # P = B·T, Eq. 2
            return points, row.astype(np.float32), column.astype(np.float32), hits.face

        seen = []
        # Embree and large NumPy operations release the GIL.
        with ThreadPoolExecutor(get_num_threads()) as threads:
            for index, (points, row, column, face) in enumerate(threads.map(take, range(views))):
                view = np.full(len(points), index, np.int16)
                seen.append((points, view, row, column, face))
                advance()
            points, view, row, column, face = threads.map(np.concatenate, zip(*seen, strict=True))
    if not hit.any() or len(points) == 0:
        raise ValueError("render: no camera ray hits `mesh`: its faces have no area, or are smaller than a pixel")
    return Views(
        images, covered, cameras, points, view, row, column, face, vertices, mesh.faces, center, scale, axes, scene
    )


def used_vertices(vertices: Float32, faces: Int32) -> Float32:
    """Return the rows (N, 3) of `vertices` (V, 3) that are corners of faces."""
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    return vertices if used.all() else vertices[used]
