"""Tokens of a few small pictures around a shape, for candidate up directions."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Bool, Float32, Float64
from dfd.common.threads import get_num_threads
from dfd.mesh.normalization import normalization
from dfd.views.cameras import camera_towards
from dfd.views.raycast import Scene
from dfd.views.render import used_vertices
from dfd.views.shading import Shading

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

PATCHES = 16  # along a picture's side
SHOWN = 0.3  # least part of a patch's pixels that the shape covers, for its token to count


def _square(first: float, height: float) -> Float64:
    """Four eyes (4, 3) around a shape, the first at an angle from the front, at an angle above the horizon.

    Quarter turns lead from one to the next, and mirror images are among them: which way a shape faces, and which of a
    candidate's axes is called its front, changes nothing.
    """
    turns, height = np.radians(first + 90 * np.arange(4)), np.radians(height)
    return np.stack(
        [np.cos(height) * np.sin(turns), np.full(4, np.sin(height)), np.cos(height) * np.cos(turns)], axis=1
    )


SIDES, CORNERS = _square(0, 20), _square(45, 15)  # of a square that the shape stands in: where the eye is


@dataclass(frozen=True, eq=False)
class ViewTokens:
    """Tokens of N pictures."""

    # tokens: (N, 2, D) for every picture the mean token of the shape, and that of its right half minus its left half
    tokens: Float32
    axes: Float64  # (N, 3, 3) right, up and back of every camera, in the mesh's coordinates

    def __add__(self, other: ViewTokens) -> ViewTokens:
        """The pictures of both."""
        return ViewTokens(np.concatenate([self.tokens, other.tokens]), np.concatenate([self.axes, other.axes]))


class ProbeCameras:
    """Renders and encodes small pictures around a mesh."""

    def __init__(self, mesh: Mesh, encoder: Encoder) -> None:
        center, scale = normalization(mesh)
        vertices = ((mesh.vertices - center) * scale).astype(np.float32)
        self._shading = Shading(Scene(vertices, mesh.faces), mesh, vertices)
        self._used = used_vertices(vertices, mesh.faces)
        self._encoder = encoder
        self._resolution = encoder.nearest_resolution(PATCHES * encoder.patch)

    def seen(self, frames: Float64, eyes: Float64) -> ViewTokens:
        """Pictures from `eyes` (E, 3), for each of `frames` (K, 3, 3) as right, up and front: K·E of them, in turn.

        Raises ValueError if no ray hits the mesh.
        """
        around = [self._used @ frame.T for frame in frames]
        cameras = [
            camera_towards(eye, points).in_mesh(frame)
            for frame, points in zip(frames, around, strict=True)
            for eye in eyes
        ]
        images = np.empty((len(cameras), self._resolution, self._resolution, 3), np.uint8)
        covered = np.zeros((len(cameras), self._resolution**2), bool)

        def take(number: int) -> None:
            images[number], hits = self._shading.picture(cameras[number], self._resolution)
            covered[number, hits.ray] = True

        with ThreadPoolExecutor(get_num_threads()) as threads:
            list(threads.map(take, range(len(cameras))))
        if not covered.any():
            raise ValueError("find_up: no camera ray hits `mesh`: its faces are without area, or smaller than a pixel")
        covered = covered.reshape(images.shape[:3])
        tokens = self._encoder.encode(images, covered=covered)
        axes = np.stack([[camera.right, camera.up, camera.back] for camera in cameras])
        return ViewTokens(np.stack([_halves(*each) for each in zip(tokens, covered, strict=True)]), axes)


def _halves(tokens: Float32, covered: Bool) -> Float32:
    """The mean token and right less left (2, D), of a picture's tokens (h, w, D) and covered pixels; 0 of nothing."""
    side = len(tokens)
    within = len(covered) // side
    shown = covered[: side * within, : side * within].reshape(side, within, side, within).mean(axis=(1, 3))
    if not shown.any():
        return np.zeros((2, tokens.shape[2]), np.float32)
    rows, columns = np.nonzero(shown > min(SHOWN, 0.99 * shown.max()))  # of a shape as thin as a wire: what there is
    own, across = tokens[rows, columns], 2 * columns - (columns.min() + columns.max())
    mean = own.mean(axis=0)
    if not across.any():  # of a single column
        return np.stack([mean, np.zeros_like(mean)])
    return np.stack([mean, own[across > 0].mean(axis=0) - own[across < 0].mean(axis=0)])
