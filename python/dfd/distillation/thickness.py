"""How thick a shape is around each point of its surface: what an encoder cannot tell from pictures.

A thigh looks much like the belly above it, and a sleeve like the coat; but one is a third as thick as the other. From
each point a few rays go into the shape, spread over a cone about the normal, and the lower median of how far they come
is the thickness there, the shape diameter. It stays as it is while a shape turns or grows, and nearly so while it takes
a pose.

Which side is inside is asked of the rays themselves, not of the order of the corners, which many files have the wrong
way round: inside is where more rays meet something. A single sheet has no inside: where fewer than half of the rays of
either side meet anything, the thickness is 0.

Thicknesses are told by soft bands, a third of an octave apart, so that a linear map of them can be any function. Those
of neighboring points are averaged: a few rays each are then enough.

Source: Shapira, Shamir and Cohen-Or, "Consistent mesh partitioning and skeletonisation using the shape diameter
function", 2008.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import unit
from dfd.distillation.targets import PointTargets
from dfd.field.component_residuals import apart
from dfd.views.raycast import Scene
from dfd.views.render import Views

__all__ = ["BANDS", "thickness_bands", "thicknesses"]

RAYS = 6  # of each side
CONE = np.radians(60)  # between the normal and the outermost ray
NEIGHBORS = 16  # points that tell a band together, the point itself among them
# The centers of the bands, of the root mean square distance from the middle of the surface: 1/80 … 1.6.
BANDS = 22
_CENTERS = np.log(1 / 80) + np.log(2) / 3 * np.arange(BANDS)
_OFF = 1e-4  # so far from the surface a ray begins, normalized: beyond the face that its point lies on


def thickness_bands(views: Views, targets: PointTargets) -> NDArray[np.float32]:
    """Return (N, BANDS) how much the thickness around each of `targets` is of each band, 0 … 1.

    `targets` lie on faces of `views`. Thickness is measured by the root mean square distance of the points from their
    mean: a copy that is larger, or turned, has the same bands.
    """
    assert targets.face is not None, "only points on a surface have a thickness"
    points, piece = targets.points.astype(np.float64), targets.piece
    # The search tree of a million faces takes a second to build.
    scene = views.scene or Scene(views.vertices, views.faces)
    thick = thicknesses(scene, views.vertices[views.faces[targets.face]], points, piece)
    size = np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean())
    ratio = np.log(np.clip(thick / max(size, 1e-12), np.exp(_CENTERS[0]), np.exp(_CENTERS[-1])))
    width = _CENTERS[1] - _CENTERS[0]
    bands = np.exp(-np.square((ratio[:, None] - _CENTERS) / width)).astype(np.float32)
    places = points if piece is None else apart(points, piece)
    _, near = cKDTree(places).query(places, np.arange(1, min(NEIGHBORS, len(points)) + 1), workers=-1)
    result: NDArray[np.float32] = bands[near].mean(axis=1)
    return result


def thicknesses(
    scene: Scene,
    corners: NDArray[np.floating],
    points: NDArray[np.float64],
    piece: NDArray[np.int32] | None = None,
) -> NDArray[np.float64]:
    """Return (N,) how far it is through the shape from each point, in the unit of the scene; 0 on an open sheet.

    Parameters
    ----------
    scene
        The shape, normalized.
    corners, points
        (N, 3, 3) those of the face that each point lies on, and (N, 3) the points.
    piece
        (N,) the connected component of each; None where there is one. Where as many rays of a point meet something on
        either side, its component decides which is inside.
    """
    along, across, normal = _axes(corners.astype(np.float64))
    # A turn from point to point: neighbors look into directions of their own, and tell more together.
    turn = np.arange(len(points)) * np.pi * (3 - np.sqrt(5))
    far = np.full((2, len(points), RAYS), np.inf)  # behind the face, and before it
    for side, sign in enumerate((-1.0, 1.0)):
        origins = points + sign * _OFF * normal
        for ray in range(RAYS):
            cosine = 1 - (ray + 0.5) / RAYS * (1 - np.cos(CONE))  # even by solid angle
            angle = (turn + ray * np.pi * (1 + np.sqrt(5)))[:, None]
            outward = np.sqrt(1 - cosine**2) * (np.cos(angle) * along + np.sin(angle) * across)
            hits = scene.cast(origins, outward + sign * cosine * normal)
            far[side, hits.ray, ray] = hits.distance
    met = np.isfinite(far).sum(axis=2)
    lead = met[0] - met[1]
    of_piece = np.zeros(len(points), np.int64) if piece is None else piece
    of_piece_lead = np.bincount(of_piece, lead)[of_piece]
    behind = np.where(lead == 0, of_piece_lead >= 0, lead > 0)
    median = np.sort(np.where(behind[:, None], far[0], far[1]), axis=1)[:, (RAYS - 1) // 2]
    return np.where(np.isfinite(median), median, 0.0)


def _axes(
    corners: NDArray[np.float64],  # (N, 3, 3)
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Unit axes (N, 3) of triangles, that turn with them: along the first edge, across it, and the normal."""
    along, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = unit(np.cross(along, other))
    along = unit(along)
    return along, np.cross(normal, along), normal
