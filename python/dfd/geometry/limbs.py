"""The direction of a limb: that along which the surface around a point is longest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Float64
from dfd.geometry.topology import face_areas
from dfd.mesh.mesh import Mesh

# Search radii, as parts of the diagonal of the box: a finger is short, and so is most of a leg.
NEAREST, FARTHEST, STEPS = 0.02, 0.3, 16
# Least ratio of length to width of a limb, as root mean squared distances from the point.
LONGEST = 1.5
# Of the disk of that radius: a region with less area is a sliver.
LEAST_AREA = 0.05
# Of the whole surface: a larger region is not a limb.
MOST_AREA = 0.5
# As a part of the limb's length: a point this far from the region's middle is near an end of the limb.
NEAR_END = 0.5
# Enough for a direction; a finer mesh is subsampled.
MOST_FACES = 200_000


class Limb(NamedTuple):
    """The direction of a limb at a point."""

    direction: Float64  # (3,) of length 1, away from the rest of the limb
    at_end: bool  # whether most of the limb is on one side, so that the sign of the direction is known


def limb_at(mesh: Mesh, distances: NDArray[np.floating]) -> Limb | None:
    """The limb at the point of distance 0: the direction in which the surface around it is longest.

    Of the regions within growing distances, the most elongated one gives the principal direction about the point: a
    region smaller than the limb's thickness is round, and so is one that reaches into the body.

    `distances` (V,) are those of the vertices along the surface, mesh units. None where no region is one and a half
    times as long as it is wide: there is no limb.
    """
    size = mesh.diagonal
    if size == 0.0 or len(mesh.faces) == 0:
        return None
    faces = mesh.faces[:: -(-len(mesh.faces) // MOST_FACES)]
    # Moments about the point, not the region's middle: from the tip of a stump, the direction to its root is longest.
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
