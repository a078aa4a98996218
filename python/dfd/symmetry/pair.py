"""Find the reflection or translation that maps one component of a part onto another, even on an asymmetric shape."""

from collections.abc import Sequence

import numpy as np

from dfd.common.linear_algebra import Float64, Int64
from dfd.symmetry.fit import KEPT, SurfaceSamples, fitted
from dfd.symmetry.plane import SymmetryPlane

# A reflection is accepted if its misfit (see `_misfit`) is at most SHAPE_FIT for a plane of the whole shape, or at most
# PAIR_FIT for a plane that was fitted to the two components, as for a translation.
SHAPE_FIT, PAIR_FIT = 0.06, 0.035
LEAST_GAIN = 1.25  # a translation is preferred to a fitted plane up to this times the plane's misfit


def isometry(one: SurfaceSamples, other: SurfaceSamples, planes: Sequence[SymmetryPlane] | None) -> Float64 | None:
    """Return the isometry (3, 4) that maps component `one` onto `other`, or None if none fits.

    The reflection in the first of `planes` that fits is used, or improved if its misfit exceeds PAIR_FIT. If `planes`
    is None, the plane halfway between the components is improved, and a translation is preferred if it fits about as
    well, as from one wheel, slat or plank to the next.
    """
    for plane in planes or ():
        given = np.append(plane.normal, plane.offset)
        misfit = _misfit(one, other, _reflection(given))
        if misfit <= SHAPE_FIT:
            better = _improved(one, other, given) if misfit > PAIR_FIT else (misfit, _reflection(given))
            return min(better, (misfit, _reflection(given)), key=lambda each: each[0])[1]
    if planes is not None:
        return None
    between = one.points.mean(axis=0) - other.points.mean(axis=0)
    if np.linalg.norm(between) < 1e-3 * one.size:
        return None
    normal = between / np.linalg.norm(between)
    middle = (one.points.mean(axis=0) + other.points.mean(axis=0)) / 2
    misfit, found = _improved(one, other, np.append(normal, normal @ middle))
    shift = np.column_stack([np.eye(3), -between])
    shifted = _misfit(one, other, shift)
    least, best = (shifted, shift) if shifted <= LEAST_GAIN * misfit else (misfit, found)
    return best if least <= PAIR_FIT else None


def _improved(one: SurfaceSamples, other: SurfaceSamples, plane: Float64) -> tuple[float, Float64]:
    """Return the misfit and the reflection (3, 4) of the plane near `plane` that fits best."""
    found = _reflection(fitted(one, other, plane))
    return _misfit(one, other, found), found


def _reflection(plane: Float64) -> Float64:
    """Return the reflection (3, 4) in a plane (4,)."""
    normal, offset = plane[:3], plane[3]
    return np.column_stack([np.eye(3) - 2 * np.outer(normal, normal), 2 * offset * normal])


def _misfit(one: SurfaceSamples, other: SurfaceSamples, affine: Float64) -> float:
    """Return the larger RMS distance between `one`, moved by `affine` (3, 4), and `other`, in sizes of `one`."""
    linear, shift = affine[:, :3], affine[:, 3]
    there, back = one.points @ linear.T + shift, (other.points - shift) @ linear
    return max(_rms(there, other.tree.query(there), other), _rms(back, one.tree.query(back), one)) / one.size


def _rms(points: Float64, matches: tuple[Float64, Int64], target: SurfaceSamples) -> float:
    """Return the RMS distance of the best 85 % of `points` (N, 3) from the surface of `target`, in mesh units.

    `matches` are the distances (N,) of the nearest samples of `target`, and their indices (N,).
    """
    apart, nearest = matches
    above = np.abs(((points - target.points[nearest]) * target.normals[nearest]).sum(axis=1))
    beside = apart > 0.1 * target.size  # too far from the nearest sample to use its tangent plane
    squares = np.square(np.sort(np.where(beside, apart, above)))[: int(KEPT * len(points))]
    return float(np.sqrt(squares.mean()))
