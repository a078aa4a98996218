"""Pictures that notebooks show by themselves."""

from __future__ import annotations

from typing import Any

from PIL import Image

from dfd.editing.deformer import Deformer
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.pictures.picture import picture
from dfd.pictures.sheet import session_views


def show(shape: MeshLike | Deformer, **options: Any) -> Image.Image:
    """Draw a mesh, whatever `dfd.load` makes one of, or a session's posed shape with a dot where each handle landed.

    A notebook displays the picture where it is a cell's result. `options` are as `dfd.pictures.picture.picture` takes
    them; a session is seen from where its handles show. Raises ValueError as `picture` does.
    """
    if not isinstance(shape, Deformer):
        return Image.fromarray(picture(as_mesh(shape), **options))
    return Image.fromarray(picture(shape.mesh, **{**session_views(shape)["after"], **options}))
