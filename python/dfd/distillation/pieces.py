"""What a fit could not tell apart: pieces of a surface that share a place in space."""

from __future__ import annotations

import numpy as np

from dfd.distillation.targets import PointTargets
from dfd.field.component_residuals import Pieces
from dfd.field.field import Field

__all__ = ["keep_pieces"]

# A piece of few points says little for certain: what it differs by counts by n / (n + FEW).
FEW = 10


def keep_pieces(field: Field, targets: PointTargets) -> Field:
    """Return `field`, fitted to `targets`, with what it misses of the pieces of the surface that share a place.

    `targets` are as wide as the field's features. Where the surface is one piece the field is returned as it is.
    """
    piece, boxes = targets.piece, targets.boxes
    if piece is None or boxes is None:
        return field
    missed = targets.targets - field(field.center + targets.points / field.scale)
    size = np.bincount(piece, minlength=len(boxes))
    missed *= (size / (size + FEW))[piece, None].astype(np.float32)
    return field.with_pieces(Pieces(boxes.astype(np.float32), targets.points, piece, missed.astype(np.float16)))
