"""Estimate the probability that each handle of a transferred edit moves the part that the original handle moves."""

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.editing.deformer import Deformer
from dfd.geometry.topology import vertex_areas

MOVED = 0.5  # a handle moves the vertices with at least this fraction of its largest weight
# A logistic regression gives the log-odds that two parts correspond: INTERCEPT − AREA_SLOPE · a − DISTANCE_SLOPE · d.
# `differences` returns a and d. `python -m bench.training.learn_agreement` computes the constants from 1,892 handles
# that were transferred between rigs.
INTERCEPT, AREA_SLOPE, DISTANCE_SLOPE = 2.97, 2.76, 18.3


def agreements(before: Deformer, after: Deformer) -> tuple[float, ...]:
    """Return for each of H handles the probability that it moves corresponding parts in both sessions.

    `before` is the session in which the edit was made, `after` a session of the other shape with the transferred edit.
    """
    log_odds = INTERCEPT - differences(before, after) @ (AREA_SLOPE, DISTANCE_SLOPE)
    return tuple((1.0 / (1.0 + np.exp(-log_odds))).tolist())


def differences(before: Deformer, after: Deformer) -> Float64:
    """Return two differences (H, 2), at least 0, between the surfaces that a handle moves before and after.

    Column 0 is |log(A / B)|, where A and B are the moved fractions of the area of both shapes. Column 1 is the distance
    between the absolute coordinates of both centers, so a left part equals its mirror image on the right.
    """
    (area, center), (other_area, other_center) = map(_moved_surface, (before, after))
    ratio = np.abs(np.log(np.maximum(area, 1e-9)) - np.log(np.maximum(other_area, 1e-9)))
    return np.column_stack([ratio, np.linalg.norm(np.abs(center) - np.abs(other_center), axis=1)])


def _moved_surface(session: Deformer) -> tuple[Float64, Float64]:
    """Return the fraction (H,) of the area that each handle moves, and its center (H, 3) in units of the diagonal."""
    mesh, weights = session.mesh, session.following
    area = vertex_areas(mesh.vertices, mesh.faces)
    held = area[:, None] * ((weights >= MOVED * weights.max(axis=0)) & (weights > 0))
    total = held.sum(axis=0)
    center = held.T @ (mesh.vertices - mesh.bounds.mean(axis=0)) / np.maximum(total, 1e-300)[:, None]
    return total / max(area.sum(), 1e-300), center / max(mesh.diagonal, 1e-300)
