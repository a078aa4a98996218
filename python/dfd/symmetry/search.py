"""Visual symmetry: planes across which a shape looks alike (paper, section 3.3.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dfd.common import check
from dfd.symmetry.plane import AXES, SymmetryPlane, axis_plane

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

__all__ = ["scored_planes", "symmetry_planes"]

# The mean over this many evenly strided vertices stands for the mean over more: its standard error is below 0.2 %.
LARGEST_SAMPLE = 50_000
THRESHOLD = 0.1  # the paper's ε
# A plane also counts as one of symmetry when a reflection changes the features by less than this part of what an
# arbitrary exchange of two vertices changes. Encoders differ in the spread of their features, and ε does not follow.
RELATIVE_THRESHOLD = 0.25
# Front and back of a figure that spreads its arms look much alike too, though far less than its two sides: a plane must
# not be more than this many times as unlike as the best one, give or take what the fit itself leaves.
WORSE_THAN_BEST, FIT_LEAVES = 3.0, 0.01


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
