"""Compute how fixed points lower the weights of a handle that moves a part.

A fixed point on a counterpart of the handle's component keeps this counterpart, and those counterparts that look more
like it than like the handle, at corresponding places. A fixed point on the handle's own component divides the component
with the handle: the weights are inverse to the squared distances. It divides each counterpart at the corresponding
place.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.edit import Edit, Handle
from dfd.editing.points import Place
from dfd.editing.weights.fill import Counterpart
from dfd.editing.weights.handle_features import HandleFeatures
from dfd.editing.weights.held_part import HeldPart

Factor = Callable[[NDArray[np.integer]], Float64]  # a function of vertices (N,)


def kept_by_fixed_points(
    rows: HandleFeatures, points: Float64, edit: Edit, handle: Handle, held: HeldPart
) -> list[Factor]:
    """Return for each component of `held` a factor of its weights. `points` (V, 3) are the vertices."""
    own = rows.of(handle.place)
    looks = [rows.of_vertices(np.array([each.counterpart.vertex])) for each in held.components]
    still = np.ones(len(held.components))  # factors of whole components
    dividing: list[tuple[Float64, float]] = []
    for fixed in edit.fixed:
        region = fixed.place.region
        where = held.components_of(np.array([rows.anchor(fixed.place)]) if region is None else rows.members(region))
        if (where == 0).any():
            dividing.append((_positions(rows, points, fixed.place), fixed.strength))
        elif (where > 0).any():
            theirs = np.concatenate([looks[k] for k in np.unique(where[where > 0])])
            for k in range(1, len(still)):
                if (where == k).any() or _apart(looks[k], theirs) < _apart(looks[k], own):
                    still[k] *= 1.0 - fixed.strength
    grip = _positions(rows, points, handle.place)
    return [
        _factor(points, each.counterpart, still[k], grip, dividing, np.asarray(handle.place.position))
        for k, each in enumerate(held.components)
    ]


def _factor(
    points: Float64,
    counterpart: Counterpart,
    still: float,
    grip: Float64,
    dividing: list[tuple[Float64, float]],
    position: Float64,
) -> Factor:
    """Return the factor of a component: `still`, and at fixed places `dividing` beside the places `grip` (G, 3)."""

    def mapped(places: Float64) -> Float64:
        return np.asarray(counterpart.position + (places - position) @ counterpart.frame.T, np.float64)

    def factor(vertices: NDArray[np.integer]) -> Float64:
        left = np.full(len(vertices), still)
        for places, strength in dividing:
            near, far = (_squares(points[vertices], mapped(each)) for each in (grip, places))
            left *= 1.0 - strength * near / np.maximum(near + far, 1e-300)
        return left

    return factor


def _squares(points: Float64, places: Float64) -> Float64:
    """Return the squared distances (N,) of `points` (N, 3) from the nearest of `places` (M, 3)."""
    return np.asarray(np.square(cKDTree(places).query(points)[0]), np.float64)


def _positions(rows: HandleFeatures, points: Float64, place: Place) -> Float64:
    return np.array([place.position]) if place.region is None else points[rows.members(place.region)]


def _apart(one: Float32, others: Float32) -> float:
    """Return the distance between the features `one` (1, D) and the nearest of `others` (N, D)."""
    return float(np.linalg.norm(others - one, axis=1).min())
