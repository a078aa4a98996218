"""Metadata of a picture: its mesh and cameras, in a text inside the PNG file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Literal

import numpy as np
from PIL import Image, UnidentifiedImageError
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from dfd.mesh.mesh import Mesh
from dfd.views.cameras import Camera

KEY = "dfd-picture"  # of the PNG file's text
Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _Document(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ViewDocument(_Document):
    """One square of the picture and the pinhole camera that it was taken with, in mesh units."""

    left: int = Field(ge=0, description="Pixels from the picture's left edge.")
    top: int = Field(ge=0, description="Pixels from the picture's upper edge.")
    side: int = Field(gt=0, description="Pixels along each side of the square.")
    position: Vector
    right: Vector
    up: Vector
    back: Vector
    field_of_view: FiniteFloat = Field(gt=0, lt=180, description="Degrees across the square.")
    shape: Literal["resting", "moved"] = Field(description="Whether it shows the mesh or what an edit made of it.")

    @classmethod
    def of(cls, camera: Camera, box: tuple[int, int, int], shape: Literal["resting", "moved"]) -> ViewDocument:
        """The square at `box` (left, top, side) through a camera in mesh units."""
        left, top, side = box
        vectors = {name: tuple(map(float, getattr(camera, name))) for name in ("position", "right", "up", "back")}
        return cls(left=left, top=top, side=side, **vectors, field_of_view=camera.field_of_view, shape=shape)  # type: ignore[arg-type]  # of three numbers each

    @property
    def camera(self) -> Camera:
        """The camera, in mesh units."""
        position, right, up, back = (np.array(each) for each in (self.position, self.right, self.up, self.back))
        return Camera(position, right, up, back, self.field_of_view)


class PictureDocument(_Document):
    """A picture's mesh and its squares."""

    format: Literal["dfd-picture"] = "dfd-picture"
    version: Literal[1] = 1
    mesh: str | None = Field(description="The mesh's file, as it was named.")
    moved: str | None = Field(description="The file of the moved mesh, as it was named.")
    hash: str = Field(description="Content hash of the mesh.")
    views: list[ViewDocument]

    @classmethod
    def of(
        cls,
        mesh: Mesh,
        views: Sequence[ViewDocument],
        *,
        file: str | os.PathLike[str] | None = None,
        moved: str | os.PathLike[str] | None = None,
    ) -> PictureDocument:
        """What a picture of `mesh` says, and the files in which the mesh and the moved one are."""
        source = file if file is not None else mesh.source
        return cls(
            hash=mesh.content_hash,
            views=list(views),
            mesh=None if source is None else os.fspath(source),
            moved=None if moved is None else os.fspath(moved),
        )


def read_document(path: str | os.PathLike[str]) -> PictureDocument:
    """Read the metadata of the PNG file at `path`.

    Raises ValueError if it is not a PNG file, or one that does not come from here; OSError if it cannot be read.
    """
    name = os.fspath(path)
    try:
        with Image.open(path, formats=["PNG"]) as image:
            image.load()
            text = image.info.get(KEY)
    except (SyntaxError, Image.DecompressionBombError, UnidentifiedImageError) as error:
        raise ValueError(f"{name} is not a PNG file that can be read: {error}") from None
    if not isinstance(text, str):
        raise ValueError(f"{name}: the picture does not say how it was taken; `dfd show` and `dfd deform` draw such")
    try:
        return PictureDocument.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "text"
        raise ValueError(f"{name}: what the picture says of itself is odd: `{key}`: {first['msg']}") from None
