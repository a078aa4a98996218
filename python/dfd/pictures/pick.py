"""Find the surface point and the vertex that a pixel of a picture shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dfd.common import check
from dfd.mesh.mesh import Mesh
from dfd.pictures.viewpoint import aim
from dfd.posing.transforms import Vector, vector
from dfd.views.raycast import Scene


@dataclass(frozen=True)
class Picked:
    """The surface at the center of a pixel."""

    point: Vector  # (3,) on the surface, mesh units
    face: int  # index of the face with the point
    vertex: int  # the corner of the face that is nearest to the point


def pick(
    mesh: Mesh,
    column: int,
    row: int,
    *,
    azimuth: float = 35.0,
    elevation: float = 18.0,
    zoom: float = 1.0,
    resolution: int = 512,
) -> Picked | None:
    """Return what a pixel of `picture` with the same arguments shows; None if the pixel shows no surface.

    `column` and `row` count from 0, from the upper left corner of the picture.

    Raises ValueError if the pixel lies outside the picture.
    """
    for name, value in (("column", column), ("row", row)):
        if check.whole("pick", name, value, minimum=0) >= resolution:
            raise ValueError(f"pick: `{name}` must be below the resolution, {resolution}, got {value}")
    normal_form, camera = aim(mesh, mesh.vertices, azimuth, elevation, zoom, None, ())
    across, down = (((each + 0.5) / resolution * 2 - 1) * camera.half_width for each in (column, row))
    direction = across * camera.right - down * camera.up - camera.back
    hits = Scene(normal_form.apply(mesh.vertices), mesh.faces).cast(camera.position, direction[None])
    if len(hits.ray) == 0:
        return None
    face = int(hits.face[0])
    corners = mesh.vertices[mesh.faces[face]]
    point = hits.barycentric[0].astype(float) @ corners
    nearest = int(np.linalg.norm(corners - point, axis=1).argmin())
    return Picked(vector("point", point), face, int(mesh.faces[face][nearest]))
