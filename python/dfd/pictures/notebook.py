"""Draw pictures that notebooks display."""

from __future__ import annotations

from typing import Any

from PIL import Image

from dfd.editing.deformer import Deformer
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.pictures.picture import picture
from dfd.pictures.sheet import session_views


def show(shape: MeshLike | Deformer, **options: Any) -> Image.Image:
    """Return a picture of a mesh, or of the posed shape of a `Deformer` with dots at the posed handles.

    A mesh can be any source that `dfd.load` accepts. `options` are those of `dfd.pictures.picture.picture`. By default,
    the camera faces the handles of a `Deformer`. Raises ValueError as `picture` does.
    """
    if not isinstance(shape, Deformer):
        return Image.fromarray(picture(as_mesh(shape), **options))
    return Image.fromarray(picture(shape.mesh, **{**session_views(shape)["after"], **options}))
