"""The probability that a transferred edit moves the corresponding parts, from the vertices that follow its handles."""

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.editing.deformer import Deformer
from dfd.geometry.topology import vertex_areas

HELD = 0.5  # a vertex is moved if its weight is at least this share of the handle's largest weight
# The log-odds that both parts correspond are EQUAL − BY_SHARE · d − BY_PLACE · c. Here d is the difference between the
# logarithms of their shares of the surface, and c the distance between their centers in diagonals. The numbers are
# learned by `python -m bench.training.learn_agreement` from 1,892 handles that were transferred between rigs. On
# families that were left out, 92 % of the handles with a probability of at least 0.8 are right. With the cosine of the
# features in place of the probability, it is 69 %.
EQUAL, BY_SHARE, BY_PLACE = 2.97, 2.76, 18.3


def agreements(before: Deformer, after: Deformer) -> tuple[float, ...]:
    """Return the probability (H,) that each handle of `after` moves the part that corresponds to that of `before`.

    `before` is a session of the shape on which the edit was made, `after` a session of the other shape.
    """
    odds = EQUAL - differences(before, after) @ (BY_SHARE, BY_PLACE)
    return tuple((1.0 / (1.0 + np.exp(-odds))).tolist())


def differences(before: Deformer, after: Deformer) -> Float64:
    """Return (H, 2) the logarithm of the ratio between shares of the surface, and the distance between centers.

    Distances are in diagonals of the boxes. Absolute coordinates are compared, so a left part equals a right one.
    """
    (share, center), (other_share, other_center) = map(_followed, (before, after))
    ratio = np.abs(np.log(np.maximum(share, 1e-9)) - np.log(np.maximum(other_share, 1e-9)))
    return np.column_stack([ratio, np.linalg.norm(np.abs(center) - np.abs(other_center), axis=1)])


def _followed(session: Deformer) -> tuple[Float64, Float64]:
    """Return the share (H,) of the surface that follows each handle, and its center (H, 3) in the box."""
    mesh, weights = session.mesh, session.following
    area = vertex_areas(mesh.vertices, mesh.faces)
    held = area[:, None] * ((weights >= HELD * weights.max(axis=0)) & (weights > 0))
    total = held.sum(axis=0)
    center = held.T @ (mesh.vertices - mesh.bounds.mean(axis=0)) / np.maximum(total, 1e-300)[:, None]
    return total / max(area.sum(), 1e-300), center / max(mesh.diagonal, 1e-300)
