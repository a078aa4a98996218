"""Define a field by given features of the vertices of a mesh."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32
from dfd.field.field import Field
from dfd.geometry.normalization import normalization
from dfd.mesh.mesh import MeshLike, as_mesh

ROWS_AT_ONCE = 1 << 16  # number of rows that are scaled at a time, to limit memory


class VertexField(Field):
    """A field from given features of the vertices of one mesh. Any point has the feature of the nearest vertex.

    There is no network, so weights follow exactly from the given features. All vertices at one position get the feature
    of the first of these vertices, so that UV seams stay closed.

    Parameters
    ----------
    mesh
        The mesh to whose vertices `features` belong.
    features
        (V, D) array with one row per vertex. Rows are scaled to unit length.
    settings
        A description of the source of the features, as JSON values.

    Raises ValueError if `features` has another array shape, is not finite, or has a row of zeros.

    Examples
    --------
    >>> import dfd
    >>> import numpy as np
    >>> sample = dfd.samples.chair()
    >>> rows = np.eye(len(sample.parts))[sample.labels]  # a row for each vertex
    >>> session = dfd.Deformer(sample.mesh, dfd.VertexField(sample.mesh, rows))
    >>> seat = session.add(sample.vertices_of("seat")[0], translation=(0, 0.1, 0))
    """

    def __init__(self, mesh: MeshLike, features: ArrayLike, *, settings: Mapping[str, Any] | None = None) -> None:
        mesh = as_mesh(mesh)
        rows = check.array("VertexField", "features", features, ("V", "D"))
        if len(rows) != len(mesh.vertices) or rows.shape[1] == 0:
            wanted = f"shape ({len(mesh.vertices)}, D), a row for each vertex"
            raise ArgumentError("features", f"must have {wanted}, got {rows.shape}", "VertexField")
        places, first = np.unique(mesh.representative, return_inverse=True)
        self._rows = _unit(rows[places])
        self._of_vertex = first
        self._places = mesh.vertices[places]
        center, scale = normalization(mesh)
        self.center, self.scale = np.array(center, np.float64), float(scale)
        self.settings = {"features": "vertices", **(settings or {})}

    @property
    def dimension(self) -> int:
        """Return the dimension D of a feature."""
        return int(self._rows.shape[1])

    def __repr__(self) -> str:
        return f"VertexField({self.dimension} dimensions of {len(self._of_vertex)} vertices)"

    def __call__(self, points: Any) -> Any:
        """Return the features (N, D) of `points` (N, 3) in mesh units. A tensor gives a tensor without gradient."""
        if tensors.is_tensor(points):
            import torch

            return torch.from_numpy(self(points.detach().cpu().numpy())).to(points.device)
        return self._rows[self._nearest.query(self._checked_points(points))[1]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Raise ValueError for every `path`: given features cannot be saved as a field; save the array instead."""
        raise ValueError("VertexField.save: a field of given features cannot be saved: save the array of features")

    @cached_property
    def _nearest(self) -> cKDTree:
        return cKDTree(self._places)


def _unit(rows: Float32) -> Float32:
    """Return `rows` (N, D), scaled to unit length without overflow; ValueError if a row has only zeros."""
    result = np.empty_like(rows)
    for start in range(0, len(rows), ROWS_AT_ONCE):
        some = rows[start : start + ROWS_AT_ONCE].astype(np.float64)
        largest = np.abs(some).max(axis=1, keepdims=True)
        if not largest.all():
            row = start + int((largest == 0).argmax())
            raise ArgumentError("features", f"must have rows other than 0, got zeros in row {row}", "VertexField")
        some /= largest  # prevents overflow of the squares
        result[start : start + ROWS_AT_ONCE] = some / np.linalg.norm(some, axis=1, keepdims=True)
    result.flags.writeable = False
    return result
