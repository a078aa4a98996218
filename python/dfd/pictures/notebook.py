"""Pictures that notebooks show by themselves."""

from __future__ import annotations

import io
import os
from typing import Any

from PIL import Image

from dfd.common.linear_algebra import UInt8
from dfd.editing.deformer import Deformer
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import session_views


class Shown:
    """A picture, (R, R, 3) uint8 in `pixels`, that a notebook shows where it is a cell's result."""

    def __init__(self, pixels: UInt8) -> None:
        self.pixels = pixels

    def __repr__(self) -> str:
        return f"Shown({self.pixels.shape[1]} x {self.pixels.shape[0]} pixels)"

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        Image.fromarray(self.pixels).save(file, format="PNG")
        return file.getvalue()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as a PNG file.

        Raises ValueError if the ending of `path` is not .png. Raises OSError if `path` cannot be written.
        """
        save_png(path, self.pixels)


def show(shape: MeshLike | Deformer, **options: Any) -> Shown:
    """Draw a mesh, whatever `dfd.load` makes one of, or a session's posed shape with a dot where each handle landed.

    `options` are as `dfd.pictures.picture.picture` takes them; a session is seen from where its handles show. Raises
    ValueError as `picture` does.
    """
    if not isinstance(shape, Deformer):
        return Shown(picture(as_mesh(shape), **options))
    return Shown(picture(shape.mesh, **{**session_views(shape)["after"], **options}))
