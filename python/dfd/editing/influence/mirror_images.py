"""Mirror images among the components of a part: a plane for each pair, whether or not the whole shape has it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float64, Int32, unit
from dfd.geometry.topology import even_points, face_areas
from dfd.symmetry.plane import SymmetryPlane

SAMPLES = 1000  # surface samples of a component
KEPT = 0.85  # share of the samples that a fit counts: components end a little differently
ROUNDS = 12  # of matching samples and fitting the plane to the matches
# Largest root mean squared distance of a fit, over the diagonal of the component's box: with a plane of the whole
# shape, and with a plane of the pair alone.
SHAPE_FIT, PAIR_FIT = 0.06, 0.035
NO_BETTER = 1.25  # a plane of the pair alone must fit so many times better than a translation


class Component(NamedTuple):
    """Samples of the surface of one component."""

    points: Float64  # (N, 3)
    normals: Float64  # (N, 3) of length 1
    tree: cKDTree
    size: float  # the diagonal of its box


def component_of(vertices: Float64, faces: Int32) -> Component | None:
    """Return samples of the surface of `faces` (F, 3); None if it has no area."""
    areas = face_areas(vertices, faces)
    if not areas.sum() > 0:
        return None
    face, barycentric = even_points(areas, SAMPLES)
    corners = vertices[faces[face]]
    points = np.einsum("nk,nkd->nd", barycentric, corners)
    normals = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    return Component(points, normals, cKDTree(points), float(np.linalg.norm(np.ptp(points, axis=0))))


def mirror_image(one: Component, other: Component, planes: Sequence[SymmetryPlane] | None) -> Float64 | None:
    """Return the reflection (3, 4) that maps component `one` onto `other`; None where none does.

    Only `planes` of the whole shape are tried. If None, a plane of the pair is found instead: it lies between the
    centers of both (Besl and McKay, "A method for registration of 3-D shapes", 1992, with a plane in place of a rigid
    motion). A component that is as well a translated copy, such as a wheel behind another, has no plane of the pair.
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
    return found if NO_BETTER * _misfit(one, other, found) < _misfit(one, other, shift) else None


def _refined(one: Component, other: Component, reflection: Float64, most: float) -> Float64 | None:
    """Return the reflection near `reflection` that fits best, if its misfit is at most `most`."""
    best, least = None, most
    for _ in range(ROUNDS):
        misfit = _misfit(one, other, reflection)
        if misfit <= least:
            best, least = reflection, misfit
        apart, nearest = other.tree.query(one.points @ reflection[:, :3].T + reflection[:, 3])
        kept = np.argsort(apart)[: int(KEPT * len(apart))]
        here, there = one.points[kept], other.points[nearest[kept]]
        delta = here.mean(axis=0) - there.mean(axis=0)
        cross = (here - here.mean(axis=0)).T @ (there - there.mean(axis=0))
        # The normal n minimizes Σ ‖R x − y‖² over all planes with the best offset.
        normal = np.linalg.eigh(2 * (cross + cross.T) - len(here) * np.outer(delta, delta))[1][:, 0]
        reflection = _reflection(normal, float(normal @ (here.mean(axis=0) + there.mean(axis=0))) / 2)
    return best


def _reflection(normal: Float64, offset: float) -> Float64:
    """Return (3, 4) the reflection in the plane normal · p = offset."""
    return np.column_stack([np.eye(3) - 2 * np.outer(normal, normal), 2 * offset * normal])


def _misfit(one: Component, other: Component, affine: Float64) -> float:
    """Return how far apart `one`, moved by the isometry `affine` (3, 4), and `other` are, over the size of `one`."""
    linear, shift = affine[:, :3], affine[:, 3]
    there = one.points @ linear.T + shift, other
    back = (other.points - shift) @ linear, one
    found = []
    for points, target in (there, back):
        apart, nearest = target.tree.query(points)
        above = np.abs(((points - target.points[nearest]) * target.normals[nearest]).sum(axis=1))
        beside = apart > 0.1 * target.size  # beyond the samples' own spacing
        squares = np.square(np.sort(np.where(beside, apart, above)))[: int(KEPT * len(points))]
        found.append(float(np.sqrt(squares.mean())))
    return max(found) / one.size
