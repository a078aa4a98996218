"""From a picture's pixel to a vertex, through the camera that the picture was taken with."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.mesh.mesh import Mesh, load
from dfd.mesh.normalization import normalization
from dfd.pictures.picture_document import PictureDocument, ViewDocument, read_document
from dfd.views.raycast import Scene


@dataclass(frozen=True)
class Picked:
    """What lies under a pixel."""

    vertex: int  # the corner, of the face that is seen there, that is nearest to the point that is seen
    position: tuple[float, float, float]  # (3,) where that vertex lies, mesh units
    point: tuple[float, float, float]  # (3,) the point of the surface that is seen, mesh units
    distance: float  # between the two, mesh units


def pick(picture: str | os.PathLike[str], x: float, y: float, mesh: Mesh | None = None) -> Picked:
    """Find the vertex under a pixel of a picture that `dfd show` or `dfd deform --picture` drew.

    `x` and `y` count from the upper left corner of the PNG file, to the right and down. `mesh` is what it shows; by
    default that is loaded from where it was when the picture was drawn.

    Raises ValueError if the picture does not say how it was taken, `mesh` is another one, or nothing is seen under the
    pixel. Raises OSError if a file cannot be read.
    """
    document = read_document(picture)
    column, row = check.number("pick", "x", x), check.number("pick", "y", y)
    view = _view_at(document, column, row)
    shape = _shape(document, view, mesh, Path(picture))
    place = normalization(shape)
    camera = view.camera
    # Through the middle of the pixel, whose whole numbers are.
    across = ((column - view.left + 0.5) / view.side * 2 - 1) * camera.half_width
    down = ((row - view.top + 0.5) / view.side * 2 - 1) * camera.half_width
    direction = across * camera.right - down * camera.up - camera.back
    hits = Scene(place.apply(shape.vertices), shape.faces).cast(place.apply(camera.position), direction[None])
    if len(hits.ray) == 0:
        raise ValueError(f"pick: `x`, `y` must be a pixel of the shape, but {column:g}, {row:g} is beside it")
    corners = shape.faces[hits.face[0]]
    point = hits.barycentric[0].astype(np.float64) @ shape.vertices[corners]
    apart = np.linalg.norm(shape.vertices[corners] - point, axis=1)
    vertex = int(corners[apart.argmin()])
    x_, y_, z_ = (float(value) for value in shape.vertices[vertex])
    px, py, pz = (float(value) for value in point)
    return Picked(vertex, (x_, y_, z_), (px, py, pz), float(apart.min()))


def _view_at(document: PictureDocument, column: float, row: float) -> ViewDocument:
    for view in document.views:
        if (
            view.left - 0.5 <= column < view.left + view.side - 0.5
            and view.top - 0.5 <= row < view.top + view.side - 0.5
        ):
            return view
    raise ValueError(f"pick: `x`, `y` must lie in a picture of the shape, but {column:g}, {row:g} is beside them all")


def _shape(document: PictureDocument, view: ViewDocument, mesh: Mesh | None, picture: Path) -> Mesh:
    """The mesh that a view shows."""
    if view.shape == "moved":
        if mesh is not None:
            return mesh
        if document.moved is None:
            raise ValueError("pick: `mesh` must be given: this is a view of the moved shape, which was not written")
        return load(_found(document.moved, picture))
    if mesh is None:
        if document.mesh is None:
            raise ValueError("pick: `mesh` must be given: the picture does not say where its own is")
        mesh = load(_found(document.mesh, picture))
    if mesh.content_hash != document.hash:
        raise ValueError("pick: `mesh` must be the one that the picture shows, got another one")
    return mesh


def _found(named: str, picture: Path) -> Path:
    """The file, from here or beside the picture."""
    beside = picture.parent / named
    return beside if not Path(named).exists() and beside.exists() else Path(named)
