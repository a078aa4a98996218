"""How likely a carried edit moves on another shape what it moved on its own, judged by what follows the handles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.geometry.topology import vertex_areas

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

HELD = 0.5  # share of a handle's largest weight: what follows less is not moved
# The log-odds that both parts are the same: EQUAL, less BY_SHARE for each factor e between their shares of the surface,
# and BY_PLACE for each diagonal between their centers. `python -m bench.training.learn_agreement` learned them from
# 1,892 handles that were carried between rigs. Of those reported with at least 0.8, 92 % were right on families that
# were left out; by the cosine of the features alone it was 69 %.
EQUAL, BY_SHARE, BY_PLACE = 2.97, 2.76, 18.3


def agreements(before: Deformer, after: Deformer) -> tuple[float, ...]:
    """Return the probability (H,) that each handle of `after` moves what the same handle of `before` moves.

    `before` is a session of the shape on which the edit was made, `after` one of the shape to which it was carried.
    """
    odds = EQUAL - differences(before, after) @ (BY_SHARE, BY_PLACE)
    return tuple((1.0 / (1.0 + np.exp(-odds))).tolist())


def differences(before: Deformer, after: Deformer) -> Float64:
    """Return (H, 2) the logarithm of the ratio between shares of the surface, and the distance between centers.

    Distances are in diagonals of the boxes. A part on the left is as far from the center as its image on the right.
    """
    (share, center), (other_share, other_center) = map(_followed, (before, after))
    ratio = np.abs(np.log(np.maximum(share, 1e-9)) - np.log(np.maximum(other_share, 1e-9)))
    return np.column_stack([ratio, np.linalg.norm(np.abs(center) - np.abs(other_center), axis=1)])


def _followed(session: Deformer) -> tuple[Float64, Float64]:
    """Return (H,) the share of the surface that follows each handle, and (H, 3) its center in the box."""
    mesh, weights = session.mesh, session.following
    area = vertex_areas(mesh.vertices, mesh.faces)
    held = area[:, None] * ((weights >= HELD * weights.max(axis=0)) & (weights > 0))
    total = held.sum(axis=0)
    center = held.T @ (mesh.vertices - mesh.bounds.mean(axis=0)) / np.maximum(total, 1e-300)[:, None]
    return total / max(area.sum(), 1e-300), center / max(mesh.diagonal, 1e-300)
