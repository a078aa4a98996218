"""What a fit could not tell apart: pieces of a surface that share a place in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dfd.distillation.targets import PointTargets
from dfd.field.field import Field
from dfd.field.pieces import Pieces, boxes_of
from dfd.geometry.topology import face_components
from dfd.mesh.weld import weld
from dfd.views.render import Views

__all__ = ["with_pieces"]

# A piece of few points says little for certain: what it differs by counts by n / (n + FEW).
FEW = 10


def with_pieces(field: Field, targets: PointTargets, views: Views) -> Field:
    """Return `field`, fitted to `targets`, with what it misses of the pieces of the surface that share a place.

    `targets` are as wide as the field's features, at points of the surface of `views`. Where there is
    one piece the field is returned as it is.
    """
    component = face_components(weld(views.vertices.astype(np.float64))[1][views.faces])
    if targets.piece is None or component.max(initial=0) == 0:
        return field
    piece = targets.piece
    missed = targets.targets - field(field.center + targets.points / field.scale)
    size = np.bincount(piece, minlength=int(component.max()) + 1)
    missed *= (size / (size + FEW))[piece, None].astype(np.float32)
    return field.with_pieces(
        Pieces(
            _boxes(views, component).astype(np.float32),
            targets.points,
            piece,
            missed.astype(np.float16),
        )
    )


def _boxes(views: Views, component: NDArray[np.int32]) -> NDArray[np.float64]:
    return boxes_of(views.vertices[views.faces.ravel()].astype(np.float64), np.repeat(component, 3))
