"""Find the reflection that maps one component of a part onto another, even if the whole shape is not symmetric."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float64, Int32, Int64, unit
from dfd.geometry.topology import even_points, face_areas
from dfd.symmetry.plane import SymmetryPlane

SAMPLES = 1000  # number of surface samples of a component
KEPT = 0.85  # a fit uses this fraction of the samples, those that match best, because the ends of components can differ
ROUNDS = 12  # number of rounds; each round matches samples and fits the plane to the matches
# A reflection is accepted if its misfit (see `_misfit`) is at most SHAPE_FIT for a plane of the whole shape, or at most
# PAIR_FIT for a plane that was fitted to the two components.
SHAPE_FIT, PAIR_FIT = 0.06, 0.035
LEAST_GAIN = 1.25  # a fitted plane is rejected if a translation has a misfit of at most this times the plane's misfit


class SurfaceSamples(NamedTuple):
    """Samples of the surface of one component."""

    points: Float64  # (N, 3) positions in mesh units
    normals: Float64  # (N, 3) unit normals
    tree: cKDTree  # search tree of `points`
    size: float  # diagonal of the bounding box of `points`, in mesh units


def samples_of(vertices: Float64, faces: Int32) -> SurfaceSamples | None:
    """Return samples of the surface of `faces` (F, 3), or None if all faces have the area 0."""
    if not face_areas(vertices, faces).sum() > 0:
        return None
    of_corner, barycentric = even_points(vertices, faces, SAMPLES)
    corners = vertices[of_corner]
    points = np.einsum("nk,nkd->nd", barycentric, corners)
    normals = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return SurfaceSamples(points, normals, cKDTree(points), float(np.linalg.norm(np.ptp(points, axis=0))))


def mirror_image(one: SurfaceSamples, other: SurfaceSamples, planes: Sequence[SymmetryPlane] | None) -> Float64 | None:
    """Return the reflection (3, 4) that maps component `one` onto `other`, or None if no plane fits.

    The first of `planes` that fits is used. If its misfit exceeds PAIR_FIT, it is improved, as Besl and McKay fit a
    rigid motion ("A method for registration of 3-D shapes", 1992). If `planes` is None, the plane halfway between the
    components is improved. It is rejected if a translation fits about as well, as from one wheel to the next.
    """
    for plane in planes or ():
        reflection = plane.reflection[:3]
        misfit = _misfit(one, other, reflection)
        if misfit <= SHAPE_FIT:
            return reflection if misfit <= PAIR_FIT else _refined(one, other, reflection, SHAPE_FIT)
    if planes is not None:
        return None
    between = one.points.mean(axis=0) - other.points.mean(axis=0)
    if np.linalg.norm(between) < 1e-3 * one.size:
        return None
    normal = between / np.linalg.norm(between)
    middle = (one.points.mean(axis=0) + other.points.mean(axis=0)) / 2
    found = _refined(one, other, _reflection(normal, float(normal @ middle)), PAIR_FIT)
    if found is None:
        return None
    shift = np.column_stack([np.eye(3), -between])
    return found if LEAST_GAIN * _misfit(one, other, found) < _misfit(one, other, shift) else None


def _refined(one: SurfaceSamples, other: SurfaceSamples, reflection: Float64, most: float) -> Float64 | None:
    """Return the best reflection (3, 4) near `reflection`, or None if its misfit is above `most`."""
    best, least = None, most
    for _ in range(ROUNDS):
        points = one.points @ reflection[:, :3].T + reflection[:, 3]
        apart, nearest = other.tree.query(points)
        if _rms(points, (apart, nearest), other) <= least * one.size:  # the misfit is at least that
            misfit = _misfit(one, other, reflection)
            if misfit <= least:
                best, least = reflection, misfit
        kept = np.argsort(apart)[: int(KEPT * len(apart))]
        here, there = one.points[kept], other.points[nearest[kept]]
        delta = here.mean(axis=0) - there.mean(axis=0)
        cross = here.T @ (there - there.mean(axis=0))
        # The normal minimizes Σ ‖R x − y‖² over the matches x, y, for the reflection R with the best offset.
        normal = np.linalg.eigh(2 * (cross + cross.T) - len(here) * np.outer(delta, delta))[1][:, 0]
        reflection = _reflection(normal, float(normal @ (here.mean(axis=0) + there.mean(axis=0))) / 2)
    return best


def _reflection(normal: Float64, offset: float) -> Float64:
    """Return the reflection (3, 4) in the plane of all points p with normal · p = offset."""
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
