"""Pictures that several pages draw alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dfd
from dfd.common.linear_algebra import Float64, UInt8
from dfd.pictures.picture import picture
from dfd.pictures.sheet import session_views
from dfd.pictures.viewpoint import azimuth_towards

RESOLUTION = 320
BEFORE, AFTER = np.array([64, 112, 216]), np.array([52, 168, 83])  # as in the paper: blue before, green after


def aim(mesh: dfd.Mesh, points: Any, *moved: Float64, **more: Any) -> dict[str, Any]:
    """Options of `picture` that show `points` (N, 3) from outside, with room for all of `moved` (V, 3)."""
    return {
        "azimuth": azimuth_towards(mesh, points),
        "frame": [mesh.vertices, *moved],
        "resolution": RESOLUTION,
        **more,
    }


def before_after(deformer: dfd.Deformer, where: dict[str, Any]) -> list[tuple[UInt8, str]]:
    """The weights that a session's vertices follow with, as heat, and the moved shape."""
    views = session_views(deformer)
    return [
        (picture(deformer.mesh, **{**views[name], **where}), caption)
        for name, caption in (("weights", "weights"), ("after", "moved"))
    ]


def silhouettes(mesh: dfd.Mesh, moved: Float64, where: dict[str, Any], *, shaded: bool = True) -> UInt8:
    """The outlines before (blue) and after (green) over each other, see-through, as in the paper's Fig. 8 and 23.

    With `shaded` the moved shape is seen through them.
    """
    old, new = (picture(mesh, vertices=vertices, **where).astype(float) for vertices in (mesh.vertices, moved))
    in_old, in_new = ((image < 250).any(axis=2, keepdims=True) for image in (old, new))
    page = new if shaded else np.full_like(new, 255)
    page = np.where(in_new, 0.55 * page + 0.45 * AFTER, page)
    page = np.where(in_old, 0.6 * page + 0.4 * BEFORE, page)
    return page.clip(0, 255).astype(np.uint8)


def blank(resolution: int = RESOLUTION) -> UInt8:
    """A white square, where there is nothing to show."""
    return np.full((resolution, resolution, 3), 255, np.uint8)


def heat(mesh: dfd.Mesh, weights: NDArray[np.floating], at: Sequence[int], **where: Any) -> UInt8:
    """Weights (V,) as heat, with dots at the vertices `at`."""
    return picture(mesh, weights=weights, handles=mesh.vertices[list(at)], **where)
