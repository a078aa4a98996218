"""Write PNG files that show a shape from several sides, or before and after an edit."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dfd.editing.deformer import Deformer
from dfd.mesh.mesh import Mesh
from dfd.pictures.colors import part_colors
from dfd.pictures.contact_sheet import contact_sheet, heat_bar
from dfd.pictures.picture import picture, save_png
from dfd.pictures.viewpoint import azimuth_towards
from dfd.segmentation.parts import Part

BEFORE_AFTER_RESOLUTION = 640


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
    legend: bool = False,
    advance: Callable[[], object] = lambda: None,
    **options: Any,
) -> None:
    """Write pictures of each row from `views` sides. Several pictures form a contact sheet.

    Each of `rows` has a title and keyword arguments of `picture`. `azimuth` is the camera's azimuth for the first side,
    in degrees. By default, this camera faces the row's handles. `elevation`, `zoom`, `resolution` and `options` are as
    in `picture`. If `zoom` is not 1, the center of the picture is the mean position of the row's handles. `legend` adds
    the legend of the heat map to rows with weights. `advance` is called after each picture.

    Raises ValueError as `picture` does. Raises OSError if `path` cannot be written.
    """
    sheet = []
    for title, shown in rows:
        handles = np.reshape(shown.get("handles", ()), (-1, 3))
        first = azimuth_towards(mesh, handles) if azimuth is None else azimuth
        target = handles.mean(axis=0) if zoom != 1 and len(handles) else None
        look = {"elevation": elevation, "zoom": zoom, "target": target, "resolution": resolution, **options, **shown}
        cells = []
        for side in range(views):
            angle = first + 360.0 * side / views
            cells.append((picture(mesh, azimuth=angle, **look), f"{angle % 360:.0f}°"))
            advance()
        if legend and "weights" in shown:
            cells.append((heat_bar(resolution), ""))
        sheet.append((title, cells))
    if len(rows) == views == 1:
        save_png(path, np.concatenate([image for image, _ in sheet[0][1]], axis=1))
    else:
        save_png(path, contact_sheet(sheet, cell=resolution))


def save_before_after(
    path: Path, deformer: Deformer, *, azimuth: float | None = None, elevation: float = 18.0, zoom: float = 1.0
) -> None:
    """Write three pictures with the same camera: the shape at rest with its handles, the weights, and the posed shape.

    `azimuth`, `elevation` and `zoom` are as in `picture`. By default, the camera faces the handles. If `zoom` is not 1,
    the mean position of the handles, at rest and posed, is in the center.

    Raises ValueError as `picture` does. Raises OSError if `path` cannot be written.
    """
    views = session_views(deformer, azimuth)
    held, landed = views["before"]["handles"], views["after"]["handles"]
    look: dict[str, Any] = {"elevation": elevation, "zoom": zoom, "resolution": BEFORE_AFTER_RESOLUTION}
    look["target"] = (held.mean(axis=0) + landed.mean(axis=0)) / 2 if zoom != 1 and len(held) else None
    cells = [(picture(deformer.mesh, **view, **look), name) for name, view in views.items()]
    cells.insert(2, (heat_bar(BEFORE_AFTER_RESOLUTION), ""))
    save_png(path, contact_sheet([("", cells)], cell=BEFORE_AFTER_RESOLUTION))


def session_views(deformer: Deformer, azimuth: float | None = None) -> dict[str, dict[str, Any]]:
    """Return the arguments of `picture` for three pictures of a session: "before", "weights" and "after".

    "before" shows the shape at rest, and "after" the posed shape. All three have one camera. Dots mark the handles. In
    "after", the dots are at the posed handles. Without an `azimuth`, the camera faces the handles.
    """
    mesh, moved = deformer.mesh, deformer.vertices
    handles = np.array([handle.place.position for handle in deformer.handles]).reshape(-1, 3)
    landed = np.array([handle.landed for handle in deformer.report().handles]).reshape(-1, 3)
    shared: dict[str, Any] = {
        "fixed": np.array([place.place.position for place in deformer.fixed]).reshape(-1, 3),
        "azimuth": azimuth_towards(mesh, handles) if azimuth is None else azimuth,
        "frame": [mesh.vertices, moved],
    }
    before = {**shared, "handles": handles}
    weighted = {**before, "weights": deformer.following.max(axis=1, initial=0.0)}
    after = {**shared, "handles": landed, "vertices": moved}
    return {"before": before, "weights": weighted, "after": after}


def parts_view(mesh: Mesh, found: Sequence[Part]) -> dict[str, Any]:
    """Return arguments of `picture` that give each part in `found` its own color, and a number from 1."""
    return {
        "colors": part_colors(np.argmax([part.mask for part in found], axis=0)),
        "handles": mesh.vertices[[part.vertex for part in found]],
        "labels": [str(number) for number in range(1, len(found) + 1)],
    }
