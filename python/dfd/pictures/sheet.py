"""One shape from several sides, drawn in several ways, in one PNG file that says how it was taken."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dfd.mesh.mesh import Mesh
from dfd.pictures.before_after import azimuth_towards
from dfd.pictures.contact_sheet import heat_bar, lay_out, with_heat_bar
from dfd.pictures.picture import picture, save_png
from dfd.pictures.picture_document import PictureDocument, ViewDocument
from dfd.pictures.viewpoint import viewpoint

__all__ = ["save_sheet"]


def save_sheet(
    path: Path,
    mesh: Mesh,
    rows: Sequence[tuple[str, dict[str, Any]]],
    *,
    views: int = 1,
    azimuth: float | None = None,
    elevation: float = 15.0,
    zoom: float = 1.0,
    resolution: int = 768,
    axes: bool = False,
    numbers: bool = False,
    legend: bool = False,
    file: Path | None = None,
    advance: Callable[[], object] | None = None,
) -> None:
    """Draw every row from `views` sides; one picture alone fills the file, several stand on a sheet with titles.

    Parameters
    ----------
    rows
        Each a title and what `picture` draws for it, by the names of its arguments.
    azimuth
        Of the first side, degrees; by default from where the row's handles show.
    elevation, zoom, resolution, axes, numbers
        As in `picture`; what is nearer than 1 aims at the row's handles.
    legend
        Whether the scale of the heat stands beside the pictures.
    file
        That of the mesh, for `dfd.pictures.pick`.
    advance
        Called after each picture.

    Raises
    ------
    ValueError
        As `picture` does.
    OSError
        If `path` cannot be written.
    """
    alone = len(rows) == 1 and views == 1
    drawn, cameras = [], []
    for title, options in rows:
        handles = np.reshape(options.get("handles", ()), (-1, 3))
        first = azimuth_towards(mesh, handles) if azimuth is None else azimuth
        sides = []
        for side in range(views):
            where: dict[str, Any] = {"azimuth": first + 360.0 * side / views, "elevation": elevation, "zoom": zoom}
            where["target"] = handles.mean(axis=0) if zoom != 1 and len(handles) else None
            image = picture(mesh, resolution=resolution, axes=axes, numbers=numbers, **where, **options)
            sides.append((image, f"{where['azimuth'] % 360:.0f}°"))
            cameras.append(viewpoint(mesh, **where))
            if advance is not None:
                advance()
        drawn.append((title, [*sides, (heat_bar(resolution), "")] if legend and not alone else sides))
    if alone:
        image = drawn[0][1][0][0]
        page: Any = with_heat_bar(image) if legend else image
        boxes = [(0, 0, resolution)]
    else:
        page, places = lay_out(drawn, cell=resolution)
        boxes = [(left, top, resolution) for row in places for left, top, _, _ in row[:views]]
    squares = [ViewDocument.of(camera, box, "resting") for camera, box in zip(cameras, boxes, strict=True)]
    save_png(path, page, PictureDocument.of(mesh, squares, file=file))
