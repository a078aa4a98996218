"""Render and encode a few small pictures around a shape for each candidate up direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Bool, Float32, Float64
from dfd.common.threads import parallel_ranges
from dfd.geometry.normalization import normalization
from dfd.views.cameras import camera_towards
from dfd.views.raycast import Scene
from dfd.views.render import used_vertices
from dfd.views.shading import Shading

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

PATCHES = 16  # number of the encoder's patches along a picture's side
SHOWN = 0.3  # a token is used if the shape covers more than this share of the pixels of its patch


def _square(first: float, height: float) -> Float64:
    """Return the directions (4, 3) of four cameras around a shape, which differ by quarter turns.

    The first camera is `first` degrees from the front, and all are `height` degrees above the horizon.
    """
    turns, height = np.radians(first + 90 * np.arange(4)), np.radians(height)
    return np.stack(
        [np.cos(height) * np.sin(turns), np.full(4, np.sin(height)), np.cos(height) * np.cos(turns)], axis=1
    )


SIDES, CORNERS = _square(0, 20), _square(45, 15)  # camera directions: front, right, back, left; then between them


@dataclass(frozen=True, eq=False)
class ViewTokens:
    """The mean tokens of N pictures: feature vectors of an encoder, averaged over the patches that show the shape."""

    # (N, 2, D) the mean token of each picture, and the mean token of its right half minus that of its left half
    tokens: Float32
    axes: Float64  # (N, 3, 3) right, up and back of each camera, in the mesh's coordinates

    def __add__(self, other: ViewTokens) -> ViewTokens:
        """Return the tokens of both sets of pictures."""
        return ViewTokens(np.concatenate([self.tokens, other.tokens]), np.concatenate([self.axes, other.axes]))


class ProbeCameras:
    """Render small pictures of a mesh and encode them. Data that all pictures need are computed once."""

    def __init__(self, mesh: Mesh, encoder: Encoder) -> None:
        center, scale = normalization(mesh)
        vertices = ((mesh.vertices - center) * scale).astype(np.float32)
        self._shading = Shading(Scene(vertices, mesh.faces), mesh, vertices)
        self._used = used_vertices(vertices, mesh.faces)
        self._encoder = encoder
        self._resolution = encoder.nearest_resolution(PATCHES * encoder.patch)

    def seen(self, frames: Float64, eyes: Float64) -> ViewTokens:
        """Return the tokens of K·E pictures, one for each of `frames` (K, 3, 3) and each direction in `eyes` (E, 3).

        Raises ValueError if no camera ray hits the mesh.
        """
        around = [(frame, self._used @ frame.T) for frame in frames]
        cameras = [camera_towards(eye, points).in_mesh(frame) for frame, points in around for eye in eyes]
        images = np.empty((len(cameras), self._resolution, self._resolution, 3), np.uint8)
        covered = np.zeros((len(cameras), self._resolution**2), bool)

        def take(number: int, _: int) -> None:
            images[number], hits = self._shading.picture(cameras[number], self._resolution)
            covered[number, hits.ray] = True

        parallel_ranges(len(cameras), 1, take)
        if not covered.any():
            raise ValueError("find_up: no camera ray hits `mesh`: its faces have no area, or are smaller than a pixel")
        covered = covered.reshape(images.shape[:3])
        tokens = self._encoder.encode(images, covered=covered)
        axes = np.stack([[camera.right, camera.up, camera.back] for camera in cameras])
        return ViewTokens(np.stack([_halves(*each) for each in zip(tokens, covered, strict=True)]), axes)


def _halves(tokens: Float32, covered: Bool) -> Float32:
    """Return the mean of a picture's tokens, and the mean of its right half minus that of its left half, (2, D).

    `tokens` are (h, w, D). `covered` (R, R) is True for pixels on the shape. Patches with few such pixels are left out.
    """
    side = len(tokens)
    within = len(covered) // side
    shown = covered[: side * within, : side * within].reshape(side, within, side, within).mean(axis=(1, 3))
    if not shown.any():
        return np.zeros((2, tokens.shape[2]), np.float32)
    rows, columns = np.nonzero(shown > min(SHOWN, 0.99 * shown.max()))  # a thin wire covers less than SHOWN everywhere
    own, across = tokens[rows, columns], 2 * columns - (columns.min() + columns.max())
    mean = own.mean(axis=0)
    if not across.any():  # a single column has no halves
        return np.stack([mean, np.zeros_like(mean)])
    return np.stack([mean, own[across > 0].mean(axis=0) - own[across < 0].mean(axis=0)])
