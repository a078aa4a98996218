"""A field made of given features of the vertices of a mesh."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32
from dfd.field.field import Field
from dfd.mesh.normalization import normalization

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from dfd.mesh.mesh import MeshLike

ROWS_AT_ONCE = 1 << 16  # to bound memory


class VertexField(Field):
    """Φ from given features of the vertices of one mesh. Any point has the features of the nearest vertex.

    No network is fitted, so weights follow exactly from the given features. Vertices at one position have the features
    of the first of them, so that UV seams stay closed.

    Parameters
    ----------
    mesh
        The mesh to whose vertices `features` belong.
    features
        (V, D), one row per vertex. Only their directions matter.
    settings
        A description of their source, JSON values.

    Raises ValueError if `features` has another shape, is not finite, or a row has no direction.
    """

    def __init__(self, mesh: MeshLike, features: ArrayLike, *, settings: Mapping[str, Any] | None = None) -> None:
        from dfd.mesh.mesh import as_mesh  # imports SciPy, which the help of commands does not need

        mesh = as_mesh(mesh)
        rows = check.array("VertexField", "features", features, ("V", "D"))
        if len(rows) != len(mesh.vertices) or rows.shape[1] == 0:
            raise ArgumentError(
                "features",
                f"must have shape ({len(mesh.vertices)}, D), a row for each vertex, got {rows.shape}",
                "VertexField",
            )
        places, first = np.unique(mesh.representative, return_inverse=True)
        self._rows = _unit(rows[places])
        self._of_vertex = first
        self._places = mesh.vertices[places]
        center, scale = normalization(mesh)
        self.center, self.scale = np.array(center, np.float64), float(scale)
        self.settings = {"features": "vertices", **(settings or {})}

    @property
    def dimension(self) -> int:
        """Width D of a feature row."""
        return int(self._rows.shape[1])

    def __repr__(self) -> str:
        """Name the mesh's size and the width of the features."""
        return f"VertexField({self.dimension} dimensions of {len(self._of_vertex)} vertices)"

    def __call__(self, points: Any) -> Any:
        """Return features (N, D) of `points` (N, 3) in mesh units, as `Field` does; tensors have no gradient."""
        if tensors.is_tensor(points):
            import torch

            return torch.from_numpy(self(points.detach().cpu().numpy())).to(points.device)
        return self._rows[self._nearest.query(self._checked_points(points))[1]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Refuse, because given features have no file format here; save their array instead.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError("VertexField.save: features of vertices have no file of their own: keep their array")

    @cached_property
    def _nearest(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self._places)


def _unit(rows: Float32) -> Float32:
    """Return rows of unit length, without overflow."""
    result = np.empty_like(rows)
    for start in range(0, len(rows), ROWS_AT_ONCE):
        some = rows[start : start + ROWS_AT_ONCE].astype(np.float64)
        largest = np.abs(some).max(axis=1, keepdims=True)
        if not largest.all():
            row = start + int((largest == 0).argmax())
            raise ArgumentError(
                "features", f"must have rows with a direction, got only zeros in row {row}", "VertexField"
            )
        some /= largest  # so that no square overflows
        result[start : start + ROWS_AT_ONCE] = some / np.linalg.norm(some, axis=1, keepdims=True)
    result.flags.writeable = False
    return result
