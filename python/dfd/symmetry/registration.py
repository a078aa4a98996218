"""Drawing a mapping to where it takes a surface onto itself best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.symmetry.evidence import SurfaceFeatures

_STEPS = 10
_COARSE_STEPS, _COARSE = 6, 4  # the first steps, still far off, go by every fourth point, if these are enough
_ENOUGH = 100  # of them for each parameter
_FIRST_REACH, _SHRINK = 0.3, 0.7  # normalized: what is farther from the surface does not count, step by step less
_LONGEST_STEP = 0.2
_DIFFERENCE = 1e-6

Mapping = Callable[[Float64], Float64]


def registered(evidence: SurfaceFeatures, vary: Callable[[Float64], Mapping], size: int) -> Float64:
    """Return the parameters (size,) by which points mapped by `vary(parameters)` lie best on the surface.

    Gauss-Newton steps from zero, on distances to the tangent planes of the nearest points; points that land far from
    any of the surface are left out.

    Source: Chen and Medioni, "Object modelling by registration of multiple range images", 1992.
    """
    parameters = np.zeros(size)
    for step in range(_STEPS):
        coarse = step < _COARSE_STEPS and len(evidence.points) > _COARSE * _ENOUGH * size
        points = evidence.points[:: _COARSE if coarse else 1]
        images = vary(parameters)(points)
        reach = max(_FIRST_REACH * _SHRINK**step, 2.5 * evidence.spacing)
        distance, nearest = evidence.tree.query(images, distance_upper_bound=reach)
        near = distance < reach
        if near.sum() < 3 * size:
            break
        tangents = evidence.normals[nearest[near]]
        residual = np.einsum("nd,nd->n", tangents, images[near] - evidence.points[nearest[near]])
        slopes = [
            np.einsum("nd,nd->n", tangents, vary(parameters + shift)(points[near]) - images[near])
            for shift in _DIFFERENCE * np.eye(size)
        ]
        matrix = np.stack(slopes, axis=1) / _DIFFERENCE
        weight = 1 / (1 + (residual / max(evidence.spacing, 1e-9)) ** 2)
        normal_matrix = matrix.T @ (matrix * weight[:, None])
        damping = 1e-6 * max(float(np.trace(normal_matrix)), 1e-12)
        change = np.linalg.solve(normal_matrix + damping * np.eye(size), -matrix.T @ (weight * residual))
        parameters = parameters + change * min(1.0, _LONGEST_STEP / max(float(np.abs(change).max()), 1e-12))
        if np.abs(change).max() < 1e-6:
            break
    return parameters
