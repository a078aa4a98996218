"""A field of features that another network computed for the vertices of a mesh."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32
from dfd.field.field import Field, FieldSource
from dfd.field.given_features import of_vertices, read_rows
from dfd.mesh.normalization import normalization

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from dfd.mesh.mesh import Mesh, MeshLike

ROWS_AT_ONCE = 1 << 16  # to bound memory


class VertexField(Field):
    """Φ from given features of the vertices of one mesh; elsewhere it has those of the nearest vertex.

    No network is fitted: weights follow from the distances of the given features exactly. Vertices at one position have
    the features of the first of them, as in faces, so that seams stay closed. To use the features on other resolutions
    of the shape, `dfd.distill(mesh, features=features)` fits a network to them.

    Parameters
    ----------
    mesh
        The mesh, whose order of vertices `features` has.
    features
        (V, D), a row a vertex. Only their directions count. Or (F, D), a row a face, where F is not V: a vertex then
        has the mean of the faces around it, by their areas.
    settings
        How they were made, JSON values.

    Raises ValueError if `features` has another shape, is not finite, or a row has no direction.
    """

    def __init__(self, mesh: MeshLike, features: ArrayLike, *, settings: Mapping[str, Any] | None = None) -> None:
        from dfd.mesh.mesh import as_mesh  # SciPy with it, which a command's help can do without

        mesh = as_mesh(mesh)
        rows = check.array("VertexField", "features", features, ("V", "D"))
        if len(rows) == len(mesh.faces) != len(mesh.vertices):
            rows = of_vertices(mesh, rows).astype(np.float32)
        if len(rows) != len(mesh.vertices) or rows.shape[1] == 0:
            raise ArgumentError(
                "features",
                f"must have shape ({len(mesh.vertices)}, D), a row for each vertex, or "
                f"({len(mesh.faces)}, D), a row for each face, got {rows.shape}",
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
        """Features (N, D) of `points` (N, 3) in mesh units, as `Field` gives them; a tensor's have no gradient."""
        if tensors.is_tensor(points):
            import torch

            return torch.from_numpy(self(points.detach().cpu().numpy())).to(points.device)
        return self._rows[self._nearest.query(self._checked_points(points))[1]]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Refuse: features of vertices are kept as the array that they came as.

        Raises
        ------
        ValueError
            Always.
        """
        raise ValueError(
            "VertexField.save: features of vertices have no file of their own: keep their array, or fit a field with "
            "dfd.distill(mesh, features=features)"
        )

    @cached_property
    def _nearest(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self._places)


def read_vertex_field(path: Path, mesh: Mesh | None) -> VertexField:
    """Read an `.npy` or `.pt` for `Field.load`, and raise what it raises."""
    if mesh is None:
        raise ArgumentError(
            "mesh", f"must be given for {path}: its rows are those of the mesh's vertices", "Field.load"
        )
    rows = read_rows(path, mesh, "Field.load: `path`")
    try:
        field = VertexField(mesh, rows)
    except ArgumentError as error:
        raise ArgumentError("path", f"{path}: `{error.argument}` {error.reason}", "Field.load") from None
    field.source = FieldSource.of(path)
    return field


Field.read_vertex_field = read_vertex_field


def _unit(rows: Float32) -> Float32:
    """Rows normalized to unit length, without overflow."""
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
