"""Measure the thickness of a shape, also called shape diameter, at points of its surface.

Pictures do not show thickness: a thigh looks much like the belly above it, but is a third as thick. From each point,
rays are cast into the shape, in a cone about the normal. The lower median of the rays' lengths is the thickness. A
rotation of the shape does not change the thickness, and another pose changes it little.

Many files have inverted faces. So rays are cast to both sides of the surface, and the side on which more rays hit is
the inside. The thickness is 0 if fewer than half of the rays on that side hit, as on a single sheet.

Thickness is encoded by overlapping bands (intervals of thickness), a third of an octave apart. So a linear map of the
bands can approximate any function of thickness. Bands are averaged over neighboring points, so few rays are needed.

Source: Shapira, Shamir and Cohen-Or, "Consistent mesh partitioning and skeletonisation using the shape diameter
function", 2008.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64, Int32, unit
from dfd.distillation.targets import PointTargets
from dfd.field.component_residuals import apart
from dfd.views.raycast import Scene
from dfd.views.render import Views

RAYS = 6  # number of rays from a point to each side of the surface
CONE = np.radians(60)  # half the opening angle of the cone of rays, in radians
NEIGHBORS = 16  # number of nearest points, including the point itself, over which bands are averaged
BANDS = 22  # number of bands; centers go from 1/80 to 1.6 times the RMS distance of the points from their mean
_CENTERS = np.log(1 / 80) + np.log(2) / 3 * np.arange(BANDS)  # natural logarithms of the centers
_OFF = 1e-4  # normalized distance of ray origins from the surface, so that rays miss the point's own face


def thickness_bands(views: Views, targets: PointTargets) -> Float32:
    """Return how close the thickness at each of `targets` is to the center of each band, (N, BANDS) in [0, 1].

    The thickness is divided by the RMS distance of the points from their mean, so the size of the shape has no effect.
    """
    assert targets.face is not None, "thickness needs the face of each point"
    points, component = targets.points.astype(np.float64), targets.component
    # The scene of the views is reused, because building its search tree takes a second for a million faces.
    scene = views.scene or Scene(views.vertices, views.faces)
    thick = thicknesses(scene, views.vertices[views.faces[targets.face]], points, component)
    size = np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean())
    ratio = np.log(np.clip(thick / max(size, 1e-12), np.exp(_CENTERS[0]), np.exp(_CENTERS[-1])))
    width = _CENTERS[1] - _CENTERS[0]
    bands = np.exp(-np.square((ratio[:, None] - _CENTERS) / width)).astype(np.float32)
    separated = points if component is None else apart(points, component)
    _, near = cKDTree(separated).query(separated, np.arange(1, min(NEIGHBORS, len(points)) + 1), workers=-1)
    return bands[near].mean(axis=1)


def thicknesses(
    scene: Scene, corners: NDArray[np.floating], points: Float64, component: Int32 | None = None
) -> Float64:
    """Return the thickness of the shape at each point, (N,) in the unit of the scene; 0 on a single sheet.

    Parameters
    ----------
    scene
        The shape, normalized.
    corners, points
        The corners (N, 3, 3) of the face on which each point lies, and the points (N, 3).
    component
        The connected component (N,) of each point; None if there is only one. If equally many rays of a point hit on
        both sides, all rays of its component decide which side is inside.
    """
    edges = np.roll(corners, -1, axis=1).astype(np.float64) - corners
    longest = np.linalg.norm(edges, axis=2).argmax(axis=1)
    along, normal = unit(edges[np.arange(len(edges)), longest]), unit(np.cross(edges[:, 0], edges[:, 1]))
    across = np.cross(normal, along)
    # The rays of each point are rotated about the normal by a different angle, so that rays of neighbors differ.
    turn = np.arange(len(points)) * np.pi * (3 - np.sqrt(5))
    far = np.full((2, len(points), RAYS), np.inf)  # distances behind the face, and in front of it
    for side, sign in enumerate((-1.0, 1.0)):
        origins = points + sign * _OFF * normal
        for ray in range(RAYS):
            cosine = 1 - (ray + 0.5) / RAYS * (1 - np.cos(CONE))  # directions are uniform by solid angle
            angle = (turn + ray * np.pi * (1 + np.sqrt(5)))[:, None]
            outward = np.sqrt(1 - cosine**2) * (np.cos(angle) * along + np.sin(angle) * across)
            hits = scene.cast(origins, outward + sign * cosine * normal)
            far[side, hits.ray, ray] = hits.distance
    met = np.isfinite(far).sum(axis=2)
    lead = met[0] - met[1]  # rays that hit behind the face minus rays that hit in front of it
    component = np.zeros(len(points), np.int32) if component is None else component
    behind = np.where(lead == 0, np.bincount(component, lead)[component] >= 0, lead > 0)
    median = np.sort(np.where(behind[:, None], far[0], far[1]), axis=1)[:, (RAYS - 1) // 2]
    return np.where(np.isfinite(median), median, 0.0)
