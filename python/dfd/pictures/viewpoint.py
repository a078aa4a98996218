"""The camera of a picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.linear_algebra import Float64
from dfd.mesh.mesh import Mesh
from dfd.mesh.normalization import Normalization, box_normalization
from dfd.views.cameras import Camera, camera_towards

FIELD_OF_VIEW = 30.0  # degrees, at zoom 1
ASIDE = 25.0  # degrees to the side, so that the depth of the shape is visible


def azimuth_towards(mesh: Mesh, points: ArrayLike) -> float:
    """Return the azimuth, degrees, from which `points` (N, 3) on the outside of `mesh` are visible.

    Without points, this is the azimuth of a view from the front.
    """
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
    """Return the normalization of all points in the picture, and the camera in normalized coordinates.

    `drawn` holds the drawn positions (V, 3) of the mesh's vertices in mesh units.
    """
    direction = _direction(azimuth, elevation)
    closer = check.number("picture", "zoom", zoom, minimum=0.0, exclusive=True)
    others = [check.array("picture", "frame", points, ("N", 3), dtype=np.float64) for points in frame]
    seen = np.unique(mesh.faces)  # vertices without faces are not drawn and would enlarge the frame
    around = np.concatenate([each[seen] if len(each) == len(drawn) else each for each in (drawn, *others)])
    found = box_normalization(around.min(axis=0), around.max(axis=0))
    if found is None:
        raise ValueError("picture: all points have one position")
    camera = camera_towards(
        direction, ((around - found.center) * found.scale).astype(np.float32), field_of_view=FIELD_OF_VIEW
    )
    position = camera.position
    if target is not None:
        middle = found.apply(check.array("picture", "target", target, (3,), dtype=np.float64)) - position
        position = position + (middle @ camera.right) * camera.right + (middle @ camera.up) * camera.up
    angle = float(np.degrees(2 * np.arctan(camera.half_width / closer)))
    return found, Camera(position, camera.right, camera.up, camera.back, angle)


def _direction(azimuth: float, elevation: float) -> Float64:
    """Return the unit vector (3,) from the shape to the camera; at 0, 0 degrees it is +z, and azimuth 90 is +x."""
    turn = np.radians(check.number("picture", "azimuth", azimuth))
    tilt = np.radians(check.number("picture", "elevation", elevation, minimum=-90, maximum=90))
    return np.array([np.cos(tilt) * np.sin(turn), np.sin(tilt), np.cos(tilt) * np.cos(turn)])
