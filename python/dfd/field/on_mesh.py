"""A field as the vertices of one mesh have it."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dfd.field.component_residuals import Pieces, pieces_of_vertices

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from dfd.mesh.mesh import Mesh

__all__ = ["FieldOnMesh"]

Float32 = NDArray[np.float32]


class Asked(Protocol):
    """What a field is here: features of positions, and the pieces that tell more."""

    center: NDArray[np.float64]
    scale: float
    pieces: Pieces | None

    @property
    def dimension(self) -> int:
        """Width of a row."""

    def __call__(self, points: NDArray[np.float64]) -> Float32:
        """Features of points (N, 3) in mesh units."""


class FieldOnMesh:
    """Features of the vertices of a mesh, and of points on it, each by the piece that it is on.

    Where the field keeps no pieces, or a piece of the mesh is none of them, they are those of the position alone.
    """

    def __init__(self, field: Asked, mesh: Mesh) -> None:
        self.field, self.mesh = field, mesh

    @property
    def shape(self) -> tuple[int, int]:
        """How many vertices there are, and the width of a row."""
        return len(self.mesh.vertices), self.field.dimension

    def rows(self, vertices: slice | NDArray[np.integer[Any]]) -> Float32:
        """Return the features of some vertices, (N, D) float32 unit rows."""
        points = self.mesh.vertices[vertices]
        return self._of(points, None if self._piece is None else self._piece[vertices])

    def at(self, points: NDArray[np.floating[Any]]) -> Float32:
        """Return features at `points` (N, 3) in mesh units, (N, D): of the piece that the nearest vertex is on."""
        places = np.asarray(points, np.float64)
        return self._of(places, None if self._piece is None else self._piece[self._nearest.query(places)[1]])

    def _of(self, points: NDArray[np.float64], piece: NDArray[np.int64] | None) -> Float32:
        field = self.field
        rows: Float32 = field(points)
        if piece is None or field.pieces is None:
            return rows
        return field.pieces.told_apart(rows, (points - field.center) * field.scale, piece)

    @cached_property
    def _piece(self) -> NDArray[np.int64] | None:
        """(V,) which of the field's pieces each vertex is on, or −1; None where the field has none."""
        if self.field.pieces is None:
            return None
        piece, boxes = pieces_of_vertices(self.mesh)
        corners = (boxes.reshape(-1, 2, 3) - self.field.center) * self.field.scale
        known = np.append(self.field.pieces.known(corners.reshape(-1, 6)), -1)  # the last one is that of −1
        found: NDArray[np.int64] = known[piece]
        return found

    @cached_property
    def _nearest(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self.mesh.vertices)
