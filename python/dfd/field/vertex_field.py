"""Define a field by given features of the vertices or faces of a mesh, or of points."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.field import field_file
from dfd.field.architecture import Architecture
from dfd.field.compatibility import POINTS
from dfd.field.field import Field
from dfd.geometry.normalization import normalization
from dfd.geometry.topology import face_areas
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh

ROWS_AT_ONCE = 1 << 16  # number of rows that are scaled at a time, to limit memory


class VertexField(Field):
    """A field from given features of one mesh. Any point has the feature of the nearest vertex.

    There is no network, so weights follow exactly from the given features. All vertices at one position get the feature
    of the first of these vertices, so that UV seams stay closed.

    Raises ValueError if `features` has another array shape, is not finite, has only zeros, or requires gradients: a
    session has no gradients. Warns if rows of zeros were filled.

    Parameters
    ----------
    mesh
        The mesh to which `features` belong.
    features
        (V, D) array with one row per vertex. Rows are scaled to unit length. Rows of zeros, such as those of vertices
        that no picture shows, are filled from neighbors along the surface.
    settings
        A description of the source of the features, as JSON values.
    at
        The places of the rows. None stands for the vertices. "faces" stands for the faces: `features` is (F, D), and a
        vertex gets the mean of its faces, weighted by their areas. Points (N, 3) in mesh units, such as those of a
        scan, have features (N, D), and a vertex gets the feature of the nearest point.

    Examples
    --------
    >>> import dfd
    >>> import numpy as np
    >>> sample = dfd.samples.chair()
    >>> rows = np.eye(len(sample.parts))[sample.labels]  # a row for each vertex
    >>> session = dfd.Deformer(sample.mesh, dfd.VertexField(sample.mesh, rows))
    >>> seat = session.add(sample.vertices_of("seat")[0], translation=(0, 0.1, 0))
    """

    def __init__(
        self, mesh: MeshLike, features: ArrayLike, *, settings: Mapping[str, Any] | None = None, at: Any = None
    ) -> None:
        mesh = as_mesh(mesh)
        if tensors.tracked(features):
            raise ArgumentError("features", "must not require gradients: detach them, or use dfd.bind", "VertexField")
        rows = check.array("VertexField", "features", features, ("R", "D"))
        places, first = np.unique(mesh.representative, return_inverse=True)
        rows = _at_vertices(mesh, rows, at)[places]
        unknown: Bool = np.logical_not(rows.any(axis=1))
        if unknown.any():
            rows = _filled(mesh, rows, places.astype(np.int64), unknown)
            number = f"{int(unknown.sum())} of {len(unknown)}"
            check.warn(f"VertexField: `features` had {number} rows of zeros, filled from neighbors", UserWarning)
        self._store(_unit(rows), first, mesh.vertices[places])
        center, scale = normalization(mesh)
        self.center, self.scale = np.array(center, np.float64), float(scale)
        self.settings = {"features": "vertices", **(settings or {})}

    def _store(self, rows: Float32, of_vertex: NDArray[np.integer[Any]], places: Float64) -> None:
        self._rows, self._of_vertex, self._places = rows, of_vertex, places

    @property
    def samples(self) -> Float64:
        """Return at most 512 places (N, 3) with features, mesh units."""
        return self._places[:: -(-len(self._places) // POINTS)]

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
        """Write the field to `path` (.safetensors) atomically. `Field.load` and the app read it.

        Raises OSError if `path` cannot be written; an existing file stays unchanged.
        """
        arrays: dict[str, NDArray[Any]] = {
            "rows": self._rows,
            "of_vertex": self._of_vertex.astype(np.int64),
            "places": self._places,
        }
        arrays |= {"center": np.asarray(self.center, np.float64), "scale": np.array(self.scale)}
        field_file.write(path, None, arrays, self.settings)

    @classmethod
    def _of_arrays(
        cls, arrays: dict[str, NDArray[Any]], settings: Mapping[str, Any], architecture: Architecture | None
    ) -> VertexField:
        """Return the field with the contents of a file. Raises ArgumentError if they are damaged."""
        field = cls.__new__(cls)
        if missing := {"rows", "of_vertex", "places", "center", "scale"} - arrays.keys():
            raise ArgumentError(missing.pop(), "is missing", "VertexField")
        rows = check.array("VertexField", "rows", arrays["rows"], ("N", "D"))
        places = check.array("VertexField", "places", arrays["places"], (len(rows), 3), dtype=np.float64)
        of_vertex = check.vertex_indices("VertexField", "of_vertex", arrays["of_vertex"], len(rows), wrap=False)
        field._store(_unit(rows), of_vertex, places)
        field.center = check.array("VertexField", "center", arrays["center"], (3,), dtype=np.float64)
        field.scale = check.number("VertexField", "scale", arrays["scale"], minimum=0.0, exclusive=True)
        field.settings = dict(settings)
        return field

    @cached_property
    def _nearest(self) -> cKDTree:
        return cKDTree(self._places)


def _at_vertices(mesh: Mesh, rows: Float32, at: Any) -> Float32:
    """Return the features (V, D) of the vertices, for features `rows` (R, D) of the places `at` (see `VertexField`)."""
    count, what = len(mesh.vertices), "vertex"
    faces = isinstance(at, str)
    if faces:
        check.choice("VertexField", "at", at, ("faces",))
        count, what = len(mesh.faces), "face"
    elif at is not None:
        points = check.array("VertexField", "at", at, ("N", 3), dtype=np.float64)
        count, what = len(points), "point"
    if len(rows) != count or rows.shape[1] == 0 or count == 0:
        wanted = f"shape ({count}, D), a row for each {what}"
        raise ArgumentError("features", f"must have {wanted}, got {rows.shape}", "VertexField")
    if at is None:
        return rows
    if not faces:
        return np.asarray(rows[cKDTree(points).query(mesh.vertices)[1]], np.float32)
    areas = face_areas(mesh.vertices, mesh.faces)
    corners = mesh.faces.ravel()
    shape = len(mesh.vertices), len(mesh.faces)
    shares = csr_array((np.repeat(areas, 3), (corners, np.repeat(np.arange(len(areas)), 3))), shape=shape)
    found = shares @ rows.astype(np.float64)
    largest = np.abs(found).max(axis=1, keepdims=True)
    return np.asarray(found / np.where(largest == 0, 1, largest), np.float32)[mesh.representative]


def _filled(mesh: Mesh, rows: Float32, places: Int64, unknown: Bool) -> Float32:
    """Return `rows` (P, D) of the vertices `places` (P,), in which `unknown` rows are means of neighbors with features.

    Each round fills the neighbors of known rows along edges. Components without any feature get the nearest row.
    """
    if unknown.all():
        raise ArgumentError("features", "must have rows other than 0, got only zeros", "VertexField")
    number = np.full(len(mesh.vertices), -1)
    number[places] = np.arange(len(places))
    corners = number[mesh.representative[mesh.faces]]
    ends = np.concatenate([corners[:, pair] for pair in ([0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2])])
    edges = csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(places), len(places)))
    rows, known = _unit(np.where(unknown[:, None], 1.0, rows)).astype(np.float64), ~unknown
    rows[unknown] = 0
    while True:
        counts = edges @ known.astype(np.float64)
        reached = np.flatnonzero(~known & (counts > 0))
        if not len(reached):
            break
        rows[reached] = (edges[reached] @ rows) / counts[reached, None]
        known[reached] = True
        opposed = reached[~rows[reached].any(axis=1)]  # rows of opposite features have the mean 0
        known[opposed] = False
        if len(opposed) == len(reached):
            break
    left = np.flatnonzero(~known)
    if len(left):
        nearest = cKDTree(mesh.vertices[places[known]]).query(mesh.vertices[places[left]])[1]
        rows[left] = rows[known][nearest]
    return rows.astype(np.float32)


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
