"""Visual symmetry: planes across which a shape looks alike (paper, section 3.3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd import check

if TYPE_CHECKING:
    from dfd.field import Field
    from dfd.mesh import Mesh

__all__ = ["SymmetryPlane", "axis_name", "axis_plane", "symmetry_planes"]

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
# The mean over this many evenly strided vertices stands for the mean over more: its standard error is below 0.2 %.
LARGEST_SAMPLE = 50_000
THRESHOLD = 0.1  # the paper's ε
# A plane also counts as one of symmetry when a reflection changes the features by less than this part of what an
# arbitrary exchange of two vertices changes. Encoders differ in the spread of their features, and ε does not follow.
RELATIVE_THRESHOLD = 0.25
# Front and back of a figure that spreads its arms look much alike too, though far less than its two sides: a plane must
# not be more than this many times as unlike as the best one, give or take what the fit itself leaves.
WORSE_THAN_BEST, FIT_LEAVES = 3.0, 0.01


@dataclass(frozen=True)
class SymmetryPlane:
    """The plane {p : normal · p = offset} in mesh units, and how alike its two sides look.

    Attributes
    ----------
    normal
        (3,) unit vector.
    offset
        Signed distance from the origin along `normal`, mesh units.
    score
        Mean of ‖Φ(v) − Φ(R v)‖ over the vertices, the quantity that the paper compares with ε; 0 is perfect.
    relative_score
        `score` over the mean distance of two arbitrary vertices' features; 1 is no better than chance.
    band
        Half width, mesh units, over which a mirrored deformation passes from one side to the other; 0 switches at
        the plane, as Eq. 8 does.
    """

    normal: tuple[float, float, float]
    offset: float
    score: float = 0.0
    relative_score: float = 0.0
    band: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a plane that is none."""
        normal = check.array("SymmetryPlane", "normal", self.normal, (3,), dtype=np.float64)
        if abs(np.linalg.norm(normal) - 1.0) > 1e-6:
            raise ValueError(f"SymmetryPlane: `normal` must have length 1, got {np.linalg.norm(normal):g}")
        object.__setattr__(self, "normal", tuple(float(x) for x in normal))
        object.__setattr__(self, "offset", check.number("SymmetryPlane", "offset", self.offset))
        object.__setattr__(self, "band", check.number("SymmetryPlane", "band", self.band, minimum=0.0))

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Distance of (N, 3) points from the plane, (N,), mesh units; positive where the normal points."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        distance: NDArray[np.float64] = array @ np.asarray(self.normal) - self.offset
        return distance

    def reflect(self, points: ArrayLike) -> NDArray[np.float64]:
        """Mirror images R p of (N, 3) points, (N, 3), mesh units."""
        array = check.array("SymmetryPlane", "points", points, ("N", 3), dtype=np.float64)
        image: NDArray[np.float64] = array - 2.0 * self.signed_distance(array)[:, None] * np.asarray(self.normal)
        return image

    def matrix(self) -> NDArray[np.float64]:
        """R as a (3, 4) affine matrix in mesh units."""
        normal = np.asarray(self.normal)
        return np.column_stack([np.eye(3) - 2.0 * np.outer(normal, normal), 2.0 * self.offset * normal])


def axis_name(normal: Sequence[float]) -> str:
    """The axis, "x", "y" or "z", that a plane's `normal` (3,) lies along, or lies nearest to."""
    return list(AXES)[int(np.argmax(np.abs(normal)))]


def axis_plane(mesh: Mesh, axis: str, *, band: float = 0.0) -> SymmetryPlane:
    """The plane across `axis` ("x", "y" or "z") through the centre of the bounding box of `mesh`."""
    if axis not in AXES:
        raise ValueError(f"axis_plane: `axis` must be x, y or z, got {axis!r}")
    center = np.asarray(mesh.bounds, np.float64).mean(axis=0)
    return SymmetryPlane(AXES[axis], float(center @ np.asarray(AXES[axis])), band=band)


def symmetry_planes(field: Field, mesh: Mesh, *, threshold: float | None = None) -> list[SymmetryPlane]:
    """Find the axis planes across which `mesh` looks alike.

    What counts is the mean of ‖Φ(v) − Φ(R v)‖ over the vertices of both sides of a plane through the box centre.

    Parameters
    ----------
    threshold
        The paper's ε, 0.1 there: planes with a smaller mean are found. If left out, those below 0.1 or below a quarter
        of what exchanging arbitrary vertices gives (the spread of the features, and with it a fair ε, depends on the
        encoder and its block), but none beside a plane across which the shape looks far more alike.

    Returns
    -------
    The planes found, the most alike first; empty when there is none.

    Raises
    ------
    ValueError
        If `threshold` is negative or not finite.

    Source: paper, section 3.3.3.
    """
    if threshold is not None:
        threshold = check.number("symmetry_planes", "threshold", threshold, minimum=0.0)
    planes = scored_planes(field, mesh)
    if threshold is not None:
        return [plane for plane in planes if plane.score < threshold]
    most = WORSE_THAN_BEST * planes[0].relative_score + FIT_LEAVES
    return [
        plane
        for plane in planes
        if (plane.score < THRESHOLD or plane.relative_score < RELATIVE_THRESHOLD) and plane.relative_score <= most
    ]


def scored_planes(field: Field, mesh: Mesh) -> list[SymmetryPlane]:
    """All three axis planes with their scores, the most alike first."""
    stride = -(-len(mesh.vertices) // LARGEST_SAMPLE)
    vertices = mesh.vertices[::stride]
    features = field(vertices)
    partners = features[np.random.default_rng(0).permutation(len(features))]
    spread = float(np.linalg.norm(features - partners, axis=1).mean())
    planes = []
    for axis in AXES:
        plane = axis_plane(mesh, axis)
        score = float(np.linalg.norm(features - field(plane.reflect(vertices)), axis=1).mean())
        # Features without any spread say nothing about symmetry: no better than chance.
        relative = score / spread if spread > 0 else 1.0
        planes.append(SymmetryPlane(plane.normal, plane.offset, score, relative))
    return sorted(planes, key=lambda plane: plane.score)
