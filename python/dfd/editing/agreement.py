"""Estimate how probably a transferred handle moves the part that corresponds to the original handle's part."""

from typing import Protocol

import numpy as np

from dfd.common.linear_algebra import Float32, Float64
from dfd.geometry.topology import vertex_areas
from dfd.mesh.mesh import Mesh

MOVED = 0.5  # vertices with at least this fraction of a handle's largest weight count as moved by the handle
# A logistic regression gives the log-odds that two parts correspond: INTERCEPT − AREA_SLOPE · a − DISTANCE_SLOPE · d.
# `differences` returns a and d. `python -m bench.training.learn_agreement` computes the constants. These are from 564
# handles that were transferred between 71 rigs, after transfers compared several places and levels. In families that
# were left out, 76 % of those with a probability of at least 0.5 are right, and 17 % of the right ones have less. With
# the constants before (2.97, 2.76, 18.3), the numbers are 67 % and 5 %.
INTERCEPT, AREA_SLOPE, DISTANCE_SLOPE = 2.56, 3.32, 24.4


class Session(Protocol):
    """The mesh of an editing session, and the weights (V, H) with which vertices follow its handles."""

    mesh: Mesh

    @property
    def following(self) -> Float32: ...


def reason(before: Session, after: Session, handle: int) -> str:
    """Return why a handle, given by its index, probably moves another part in `after`."""
    area, distance = differences(before, after)[handle]
    if AREA_SLOPE * area >= DISTANCE_SLOPE * distance:
        shares = [float(_moved_surface(session)[0][handle]) for session in (after, before)]
        return "it moves {:.1%} of the surface, and {:.1%} on the first shape".format(*shares)
    return f"the surface that it moves lies {distance:.0%} of the diagonal from its place on the first shape"


def agreements(before: Session, after: Session) -> tuple[float, ...]:
    """Return for each of H handles the probability that it moves corresponding parts in both sessions.

    The edit was made in the session `before`. The session `after` has the transferred edit on the other shape.
    """
    return tuple((1.0 / (1.0 + np.exp(-log_odds(differences(before, after))))).tolist())


def log_odds(differences: Float64) -> Float64:
    """Return the log-odds (H,) that parts with the given differences (H, 2) correspond."""
    return np.asarray(INTERCEPT - differences @ (AREA_SLOPE, DISTANCE_SLOPE), np.float64)


def differences(before: Session, after: Session) -> Float64:
    """Compare the surfaces that each handle moves in the two sessions. Return two differences per handle, (H, 2).

    Column 0 is |log(A / B)|, with the fractions A and B of the area that the handle moves. Column 1 is the distance
    between the centers of the two surfaces. Their coordinates become absolute values, so mirror images have distance 0.
    """
    return between(*_moved_surface(before), *_moved_surface(after))


def between(area: Float64, center: Float64, other_area: Float64, other_center: Float64) -> Float64:
    """Return `differences` (H, 2) of surfaces with the given shares (H,) of the area, and centers (H, 3) in diagonals.

    The centers are relative to the center of the shape's bounding box.
    """
    ratio = np.abs(np.log(np.maximum(area, 1e-9)) - np.log(np.maximum(other_area, 1e-9)))
    return np.column_stack([ratio, np.linalg.norm(np.abs(center) - np.abs(other_center), axis=1)])


def _moved_surface(session: Session) -> tuple[Float64, Float64]:
    """Return the share (H,) of the area that each handle moves, and the center (H, 3) of this surface."""
    mesh, weights = session.mesh, session.following
    area = vertex_areas(mesh.vertices, mesh.faces)
    held = area[:, None] * ((weights >= MOVED * weights.max(axis=0)) & (weights > 0))
    total = held.sum(axis=0)
    center = held.T @ (mesh.vertices - mesh.bounds.mean(axis=0)) / np.maximum(total, 1e-300)[:, None]
    return total / max(area.sum(), 1e-300), center / max(mesh.diagonal, 1e-300)  # from the box center, in diagonals
