"""What an encoder sees of a shape from its six sides, each picture turned all four ways."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.common.threads import get_num_threads
from dfd.mesh.normalization import normalization
from dfd.views.cameras import camera_towards
from dfd.views.raycast import Scene
from dfd.views.render import surface_points, used_vertices
from dfd.views.shading import Shading

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

__all__ = ["SideViews", "look_from_sides"]

PATCHES = 16  # along a picture's side
SHOWN = 0.3  # of a patch's pixels, so that its token counts
SIDES = np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, eq=False)
class SideViews:
    """Tokens of the patches that show the shape, and where they look.

    Attributes
    ----------
    tokens
        (N, D + 1) float32, a column of ones last.
    picture
        (N,) which of the 24 pictures each is of.
    weight
        (N,) what each counts, their sum 1: every picture the same.
    place
        (N, 3) the surface behind each patch, about its mean, its largest coordinate 1; along the mesh's axes.
    axes
        (24, 3, 3) what is right, up and towards the eye in every picture, as rows along the mesh's axes.
    """

    tokens: NDArray[np.float32]
    picture: NDArray[np.int64]
    weight: NDArray[np.float64]
    place: NDArray[np.float64]
    axes: NDArray[np.float64]


def look_from_sides(mesh: Mesh, encoder: Encoder, frame: NDArray[np.float64]) -> SideViews:
    """Take and encode 24 small pictures along the axes of `frame` (3, 3): the same ones whichever of them is up.

    Raises
    ------
    ValueError
        If no ray meets the mesh.
    """
    center, scale = normalization(mesh)
    vertices = ((mesh.vertices - center) * scale).astype(np.float32)
    scene = Scene(vertices, mesh.faces)
    shading = Shading(scene, mesh, vertices)
    around = used_vertices(vertices, mesh.faces) @ frame.T
    resolution = encoder.nearest_resolution(PATCHES * encoder.patch)

    def take(side: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
        camera = camera_towards(side, around).in_mesh(frame)
        image, hits = shading.picture(camera, resolution)
        points = np.full((resolution * resolution, 3), np.nan)
        points[hits.ray] = surface_points(vertices, mesh.faces, hits)
        return image, points.reshape(resolution, resolution, 3), np.stack([camera.right, camera.up, camera.back])

    with ThreadPoolExecutor(get_num_threads()) as threads:
        taken = list(threads.map(take, SIDES))
    images, points, axes = [], [], []
    for image, behind, (right, up, back) in taken:
        for turns in range(4):  # counterclockwise, by a quarter each
            images.append(np.rot90(image, turns))
            points.append(np.rot90(behind, turns))
            axes.append(np.stack([right, up, back]))
            right, up = -up, right
    behind = np.stack(points)
    covered = ~np.isnan(behind[..., 0])
    if not covered.any():
        raise ValueError("find_up: `mesh` is seen by no camera: its faces are without area, or smaller than a pixel")
    tokens = encoder.encode(np.stack(images), covered=covered)
    return _of_patches(tokens, behind, covered, np.stack(axes))


def _of_patches(
    tokens: NDArray[np.float32], behind: NDArray[np.float64], covered: NDArray[np.bool_], axes: NDArray[np.float64]
) -> SideViews:
    count, side = tokens.shape[:2]
    within = behind.shape[1] // side
    cells = (count, side, within, side, within)
    shown = covered[:, : side * within, : side * within].reshape(cells).sum(axis=(2, 4))
    total = np.nan_to_num(behind[:, : side * within, : side * within]).reshape(*cells, 3).sum(axis=(2, 4))
    counts = shown > min(SHOWN * within**2, shown.max() - 1)  # of a shape as thin as a wire: what there is
    picture = np.nonzero(counts)[0]
    rows = np.concatenate([tokens[counts], np.ones((len(picture), 1), np.float32)], axis=1)
    place = total[counts] / shown[counts][:, None]
    place -= place.mean(axis=0)
    place /= max(float(np.abs(place).max()), np.finfo(np.float64).tiny)
    size = np.bincount(picture, minlength=count)
    weight = 1 / (size[picture] * float((size > 0).sum()))
    return SideViews(rows, picture, weight, place, axes)
