"""Whether a field can say anything about a mesh: it knows the box around the shape that it was distilled from."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

# Of the longest sides. The nearest units that get mixed up, inch and centimetre, differ by 2.54; a shape that was only
# posed, cut or simplified stays below.
LARGEST_RATIO = 2.0
# From the center, in half longest sides. A shape that was posed a little stays within; one that stands on the ground,
# but with another axis up, reaches 2.
FARTHEST_REACH = 1.5


def check_compatible(center: Float64, scale: float, mesh: Mesh, *, allowed_by: str = "") -> None:
    """Refuse a field of `center` and `scale` whose own shape was of quite another size, or lay elsewhere.

    A field holds the longest side and the center of its shape's box and nothing else of it, so a stranger of the same
    size in the same position passes. So do other resolutions of the same shape, its parts down to half of its size, and
    poses of it. `allowed_by` is what the message says a caller who knows better can give.

    Raises ValueError if the longest side of the mesh's box is less than half or more than twice that of the field's
    shape, or the box lies wholly outside the cube around that shape. Warns if the mesh reaches out of that cube by more
    than half of its half side: there the field only guesses.
    """
    low, high = (np.asarray(mesh.bounds) - center) * scale  # in the field's own cube, [-1, 1]³
    ratio = float((high - low).max()) / 2.0
    reach = float(max(-low.min(), high.max()))
    outside = bool((low > 1).any() or (high < -1).any())
    sizes = (
        f"a shape with a longest side of {2 / scale:.4g} around {_point(center)}, "
        f"and this mesh has one of {np.max(mesh.extents):.4g} around {_point(np.mean(mesh.bounds, axis=0))}"
    )
    remedy = "bring the mesh to that shape's units, axes and position, or distill a field from it"
    if outside or not 1 / LARGEST_RATIO <= ratio <= LARGEST_RATIO:
        known_better = f"; {allowed_by} takes it all the same" if allowed_by else ""
        raise ArgumentError(
            "field", f"must belong to this mesh, but it was distilled from {sizes}: {remedy}{known_better}"
        )
    if reach > FARTHEST_REACH:
        warnings.warn(
            f"`field` was distilled from {sizes}: weights beyond that shape's box are a guess. "
            f"Unless the mesh is a pose of that shape, {remedy}",
            UserWarning,
            stacklevel=4,
        )


def _point(position: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in position) + ")"
