"""Draw pictures that notebooks display."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image

from dfd.common.linear_algebra import Float64
from dfd.editing.deformer import Deformer
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.pictures.colors import feature_colors
from dfd.pictures.picture import picture
from dfd.pictures.sheet import session_views

DOT = 0.012  # radius of the dots of a field, as a fraction of the diagonal


def show(shape: MeshLike | Deformer | Field, **options: Any) -> Image.Image:
    """Return a picture of a mesh, or of the posed shape of a `Deformer` with dots at the posed handles.

    Of a field, it shows surface samples in the colors of their features. A mesh can be any source that `dfd.load`
    accepts. `options` are those of `dfd.pictures.picture.picture`. By default, the camera faces the handles of a
    `Deformer`. Raises ValueError as `picture` does, or if a field has no surface samples.
    """
    if isinstance(shape, Field):
        points = shape.samples
        if points is None:
            raise ValueError("show: `shape` must be a field with samples of its surface: show its mesh")
        return Image.fromarray(
            picture(_dots(points), colors=np.repeat(feature_colors(shape(points)), 6, axis=0), **options)
        )
    if not isinstance(shape, Deformer):
        return Image.fromarray(picture(as_mesh(shape), **options))
    return Image.fromarray(picture(shape.mesh, **{**session_views(shape)["after"], **options}))


def _dots(points: Float64) -> Mesh:
    """Return a mesh with an octahedron at each of `points` (N, 3)."""
    size = DOT * float(np.linalg.norm(np.ptp(points, axis=0)))
    corners = size * np.concatenate([np.eye(3), -np.eye(3)])
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    every = 6 * np.arange(len(points))[:, None, None] + faces
    return Mesh((points[:, None] + corners).reshape(-1, 3), every.reshape(-1, 3))
