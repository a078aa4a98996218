"""Which way a limb runs: the direction along which the surface around a place is longest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.geometry.topology import face_areas
from dfd.mesh.mesh import Mesh

__all__ = ["Limb", "limb_at"]

# How far around the place is looked, as parts of the diagonal of the box: a finger is short, and so is most of a leg.
NEAREST, FARTHEST, STEPS = 0.02, 0.3, 16
# So many times as long as it is wide the surface there has to be, in mean squared distances from the place.
LONGEST = 1.5
# Of the disk of that radius: a piece with less area is a sliver, whatever its length.
LEAST_AREA = 0.05
# Of the whole surface: a larger piece is no limb of it.
MOST_AREA = 0.5
# As a part of the limb's length, so far from the middle of the piece a place is near an end of the limb.
NEAR_END = 0.5
# Enough to tell a direction by; of a finer mesh every so many faces.
MOST_FACES = 200_000


class Limb(NamedTuple):
    """Which way a limb runs at a place."""

    direction: NDArray[np.float64]  # (3,) of length 1, away from the rest of the limb
    at_end: bool  # whether most of the limb is on one side, so that the direction is told from its opposite


def limb_at(mesh: Mesh, distances: NDArray[np.floating]) -> Limb | None:
    """The limb at the place of distance 0: which way the surface around it is longest.

    Of the pieces of surface within growing distances it is the principal direction of the one that is most elongated,
    as seen from the place: a piece smaller than a limb is thick is round, and so is one that reaches into the body.

    Parameters
    ----------
    distances
        (V,) of the vertices along the surface, mesh units.

    Returns
    -------
    None where no piece is one and a half times as long as it is wide: there is no limb.
    """
    size = mesh.diagonal
    if size == 0.0 or len(mesh.faces) == 0:
        return None
    faces = mesh.faces[:: -(-len(mesh.faces) // MOST_FACES)]
    # Around the place and not around their middles: from the tip of a stump, the way to its root is the longest.
    corners = (mesh.vertices[faces] - mesh.vertices[distances.argmin()]) / size
    areas = face_areas(corners.reshape(-1, 3), np.arange(corners.size // 3, dtype=np.int32).reshape(-1, 3))
    away = distances[faces].mean(axis=1) / size
    order = np.argsort(away, kind="stable")
    order = order[: np.searchsorted(away[order], FARTHEST, side="right")]
    # Integrals of p pᵀ over triangles, summed from the nearest one on.
    middles = corners[order].mean(axis=1)
    squares = np.einsum("fki,fkj->fij", corners[order], corners[order]) + 9 * middles[:, :, None] * middles[:, None]
    area = np.cumsum(areas[order])
    first = np.cumsum(areas[order, None] * middles, axis=0)
    second = np.cumsum(areas[order, None, None] / 12 * squares, axis=0)
    best, found = LONGEST, None
    for radius in np.geomspace(NEAREST, FARTHEST, STEPS):
        last = int(np.searchsorted(away[order], radius, side="right")) - 1
        if last < 0 or not LEAST_AREA * np.pi * radius**2 <= area[last] <= MOST_AREA * areas.sum():
            continue
        variances, directions = np.linalg.eigh(second[last] / area[last])
        elongation = float(np.sqrt(max(variances[2], 0.0) / max(variances[1], 1e-12)))
        if elongation > best:
            rest = float(first[last] @ directions[:, 2] / area[last])
            outward = -directions[:, 2] if rest > 0 else directions[:, 2]
            best, found = elongation, Limb(outward, abs(rest) > NEAR_END * np.sqrt(variances[2]))
    return found
