"""What an edit does, in one picture."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dfd.editing.deformer import Deformer
from dfd.mesh.mesh import Mesh
from dfd.pictures.picture import contact_sheet, picture, save_png

__all__ = ["azimuth_towards", "save_before_after"]

CELL = 640
# Seen a little from the side, a shape shows its depth.
ASIDE = 25.0


def azimuth_towards(mesh: Mesh, points: ArrayLike) -> float:
    """Degrees round the y axis from which (N, 3) points on the outside of `mesh` are seen; from the front for none."""
    outwards = np.reshape(points, (-1, 3)).sum(axis=0) - len(np.reshape(points, (-1, 3))) * mesh.bounds.mean(axis=0)
    return float(np.degrees(np.arctan2(outwards[0], outwards[2]))) + ASIDE


def save_before_after(path: Path, deformer: Deformer) -> None:
    """Draw the resting shape with its handles, what follows them, and the deformed shape, all with one camera.

    Raises
    ------
    OSError
        If `path` cannot be written.
    """
    mesh, moved = deformer.mesh, deformer.vertices
    handles = np.array([handle.place.position for handle in deformer.handles]).reshape(-1, 3)
    targets = np.array(
        [matrix[:, :3] @ at + matrix[:, 3] for matrix, at in zip(deformer.transforms, handles, strict=True)]
    ).reshape(-1, 3)
    fixed = np.array([place.position for place in deformer.fixed]).reshape(-1, 3)
    heat = deformer.weights.max(axis=1, initial=0.0)
    draw = partial(
        picture,
        mesh,
        fixed=fixed,
        azimuth=azimuth_towards(mesh, handles),
        frame=[mesh.vertices, moved],
        resolution=CELL,
    )
    views = [
        (draw(handles=handles), "before"),
        (draw(weights=heat, handles=handles), "weights"),
        (draw(vertices=moved, handles=targets), "after"),
    ]
    save_png(path, contact_sheet([("", views)], cell=CELL))
