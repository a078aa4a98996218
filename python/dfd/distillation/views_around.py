"""What an encoder sees of a shape as it would stand: pictures from around, the same ones for every candidate."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.common.threads import get_num_threads
from dfd.mesh.normalization import normalization
from dfd.views.cameras import camera_towards
from dfd.views.raycast import Scene
from dfd.views.render import used_vertices
from dfd.views.shading import Shading

if TYPE_CHECKING:
    from dfd.encoders.encode import Encoder
    from dfd.mesh.mesh import Mesh

__all__ = ["CORNERS", "LAYERS", "SIDES", "Around"]

LAYERS = ("all", "upper", "middle", "lower")  # of a shape in a picture: all of it, and its thirds
PATCHES = 16  # along a picture's side
SHOWN = 0.3  # of a patch's pixels, so that its token counts


def _square(first: float, height: float) -> NDArray[np.float64]:
    """Four eyes (4, 3) around a shape, the first at an angle from the front, at an angle above the horizon.

    Quarter turns lead from one to the next, and mirror images are among them: which way a shape faces, and which of a
    candidate's axes is called its front, changes nothing.
    """
    turns, height = np.radians(first + 90 * np.arange(4)), np.radians(height)
    return np.stack(
        [np.cos(height) * np.sin(turns), np.full(4, np.sin(height)), np.cos(height) * np.cos(turns)], axis=1
    )


SIDES, CORNERS = _square(0, 20), _square(45, 15)  # of a square that the shape stands in: where the eye is


class Around:
    """Takes small pictures of a mesh from around, as it would stand."""

    def __init__(self, mesh: Mesh, encoder: Encoder) -> None:
        center, scale = normalization(mesh)
        vertices = ((mesh.vertices - center) * scale).astype(np.float32)
        self._shading = Shading(Scene(vertices, mesh.faces), mesh, vertices)
        self._used = used_vertices(vertices, mesh.faces)
        self._encoder = encoder
        self._resolution = encoder.nearest_resolution(PATCHES * encoder.patch)

    def seen(self, frames: NDArray[np.float64], eyes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean tokens of pictures from `eyes` (E, 3), for `frames` (K, 3, 3) that may be upright: (K, 4, D).

        The second axis is of `LAYERS`.

        Raises
        ------
        ValueError
            If no ray meets the mesh.
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
            raise ValueError(
                "find_up: `mesh` is seen by no camera: its faces are without area, or smaller than a pixel"
            )
        covered = covered.reshape(images.shape[:3])
        tokens = self._encoder.encode(images, covered=covered)
        layers = [_layers(*each) for each in zip(tokens, covered, strict=True)]
        of_frames = np.stack(layers).reshape(len(frames), len(eyes), len(LAYERS), self._encoder.dimension)
        mean: NDArray[np.float64] = of_frames.mean(axis=1, dtype=np.float64)
        return mean


def _layers(tokens: NDArray[np.float32], covered: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Mean tokens (4, D), of a picture's tokens (h, w, D) and covered pixels; what is missing is as the mean of all."""
    side = len(tokens)
    within = len(covered) // side
    shown = covered[: side * within, : side * within].reshape(side, within, side, within).mean(axis=(1, 3))
    if not shown.any():
        return np.zeros((len(LAYERS), tokens.shape[2]), np.float32)
    rows, columns = np.nonzero(shown > min(SHOWN, 0.99 * shown.max()))  # of a shape as thin as a wire: what there is
    height = (rows + 0.5 - rows.min()) / (rows.max() + 1 - rows.min())
    own = tokens[rows, columns]
    mean = own.mean(axis=0)
    thirds = [own[(height * 3).astype(int) == third] for third in range(3)]
    return np.stack([mean, *(some.mean(axis=0) if len(some) else mean for some in thirds)])
