"""What an edit does, in one picture."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dfd.editing.deformer import Deformer
from dfd.mesh.mesh import Mesh
from dfd.pictures.contact_sheet import heat_bar, lay_out
from dfd.pictures.picture import picture, save_png
from dfd.pictures.picture_document import PictureDocument, ViewDocument
from dfd.pictures.viewpoint import viewpoint

__all__ = ["azimuth_towards", "save_before_after"]

CELL = 640
# Seen a little from the side, a shape shows its depth.
ASIDE = 25.0


def azimuth_towards(mesh: Mesh, points: ArrayLike) -> float:
    """Degrees round the y axis from which (N, 3) points on the outside of `mesh` are seen; from the front for none."""
    outwards = np.reshape(points, (-1, 3)).sum(axis=0) - len(np.reshape(points, (-1, 3))) * mesh.bounds.mean(axis=0)
    return float(np.degrees(np.arctan2(outwards[0], outwards[2]))) + ASIDE


def save_before_after(
    path: Path,
    deformer: Deformer,
    *,
    azimuth: float | None = None,
    elevation: float = 18.0,
    zoom: float = 1.0,
    files: tuple[Path | None, Path | None] = (None, None),
) -> None:
    """Draw the resting shape with its handles, what follows them, and the deformed shape, all with one camera.

    Dots sit on the vertices by which handles are judged; after the move, where those have landed.

    Parameters
    ----------
    azimuth
        As in `picture`; by default from where the handles show.
    elevation, zoom
        As in `picture`; what is above 1 aims at the handles.
    files
        Those of the mesh and of the moved one, for `dfd.pictures.pick`.

    Raises
    ------
    ValueError
        As `picture` does.
    OSError
        If `path` cannot be written.
    """
    mesh, moved = deformer.mesh, deformer.vertices
    told = deformer.report().handles
    handles = np.array([handle.place.position for handle in deformer.handles]).reshape(-1, 3)
    landed = np.array([handle.landed for handle in told]).reshape(-1, 3)
    fixed = np.array([place.position for place in deformer.fixed]).reshape(-1, 3)
    heat = deformer.following.max(axis=1, initial=0.0)
    where: dict[str, Any] = {
        "azimuth": azimuth_towards(mesh, handles) if azimuth is None else azimuth,
        "elevation": elevation,
        "zoom": zoom,
        "target": (handles.mean(axis=0) + landed.mean(axis=0)) / 2 if zoom != 1 and len(handles) else None,
        "frame": [mesh.vertices, moved],
    }
    draw = partial(picture, mesh, fixed=fixed, resolution=CELL, **where)
    views = [
        (draw(handles=handles), "before"),
        (draw(weights=heat, handles=handles), "weights"),
        (heat_bar(CELL), ""),
        (draw(vertices=moved, handles=landed), "after"),
    ]
    page, ((before, weights, _, after),) = lay_out([("", views)], cell=CELL)
    camera = viewpoint(mesh, **where)
    squares = [
        ViewDocument.of(camera, box[:3], "moved" if box is after else "resting") for box in (before, weights, after)
    ]
    save_png(path, page, PictureDocument.of(mesh, squares, file=files[0], moved=files[1]))
