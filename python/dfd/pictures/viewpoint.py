"""Choose the camera of a picture from azimuth, elevation and zoom."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.linear_algebra import Float64
from dfd.geometry.normalization import Normalization, box_normalization
from dfd.mesh.mesh import Mesh
from dfd.views.cameras import Camera, camera_towards

FIELD_OF_VIEW = 30.0  # field of view at zoom 1, in degrees
ASIDE = 25.0  # angle in degrees between the azimuths of the camera and of the points; an oblique view shows depth


def azimuth_towards(mesh: Mesh, points: ArrayLike) -> float:
    """Return the azimuth of `points` (N, 3) about the mesh's center, or 0 without points, plus `ASIDE`, in degrees."""
    outwards = np.reshape(points, (-1, 3)).sum(axis=0) - len(np.reshape(points, (-1, 3))) * mesh.bounds.mean(axis=0)
    return float(np.degrees(np.arctan2(outwards[0], outwards[2]))) + ASIDE


def aim(
    mesh: Mesh,
    drawn: Float64,
    azimuth: float,
    elevation: float,
    zoom: float,
    target: ArrayLike | None,
    frame: Sequence[ArrayLike],
) -> tuple[Normalization, Camera]:
    """Return the map of the points in the picture to the cube [−1, 1]³, and a camera in coordinates of the cube.

    `drawn` (V, 3) are the vertex positions that are drawn, in mesh units. The other arguments are those of `picture`.
    """
    turn = np.radians(check.number("picture", "azimuth", azimuth))
    tilt = np.radians(check.number("picture", "elevation", elevation, minimum=-90, maximum=90))
    direction = [np.cos(tilt) * np.sin(turn), np.sin(tilt), np.cos(tilt) * np.cos(turn)]  # from the shape to the camera
    closer = check.number("picture", "zoom", zoom, minimum=0.0, exclusive=True)
    others = [check.array("picture", "frame", points, ("N", 3), dtype=np.float64) for points in frame]
    seen = np.unique(mesh.faces)  # vertices without faces are not drawn
    around = np.concatenate([each[seen] if len(each) == len(drawn) else each for each in (drawn, *others)])
    found = box_normalization(around.min(axis=0), around.max(axis=0))
    if found is None:
        raise ValueError("picture: all points have one position")
    camera = camera_towards(direction, found.apply(around).astype(np.float32), field_of_view=FIELD_OF_VIEW)
    position = camera.position
    if target is not None:
        middle = found.apply(check.array("picture", "target", target, (3,), dtype=np.float64)) - position
        position = position + (middle @ camera.right) * camera.right + (middle @ camera.up) * camera.up
    angle = float(np.degrees(2 * np.arctan(camera.half_width / closer)))
    return found, Camera(position, camera.right, camera.up, camera.back, angle)
