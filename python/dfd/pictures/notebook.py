"""Pictures that notebooks display."""

from __future__ import annotations

from typing import Any

from PIL import Image

from dfd.editing.deformer import Deformer
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.pictures.picture import picture
from dfd.pictures.sheet import session_views


def show(shape: MeshLike | Deformer, **options: Any) -> Image.Image:
    """Draw a mesh, or a session's posed shape with a dot at the posed position of each handle.

    The mesh may be any source of `dfd.load`. A notebook displays the picture that is the result of a cell. `options`
    are those of `dfd.pictures.picture.picture`. The camera of a session faces its handles by default. Raises ValueError
    as `picture` does.
    """
    if not isinstance(shape, Deformer):
        return Image.fromarray(picture(as_mesh(shape), **options))
    return Image.fromarray(picture(shape.mesh, **{**session_views(shape)["after"], **options}))
