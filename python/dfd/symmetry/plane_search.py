"""Find candidate mirror planes halfway between samples with similar features, and fit each plane to the surface.

All coordinates are normalized (`dfd.symmetry.evidence`). A plane is an array (4,): its unit normal and its offset.
"""

import numpy as np

from dfd.common.linear_algebra import Float64, Int64
from dfd.symmetry.evidence import SurfaceFeatures

Planes = Float64  # (K, 4)

_SEEDS = 300  # largest number of candidate planes, each halfway between two samples; pairs of samples vote for planes
_MOST_REFINED = 8  # largest number of planes, those with the most votes, that are fitted to the surface
_PAIR_FITS = 0.12  # a pair votes for a plane if the mirror image of a sample is nearer than this to the other sample
_SAME_ANGLE, _SAME_OFFSET = np.radians(8.0), 0.06  # planes with a smaller angle and difference of offsets are the same
_STEPS = 10  # largest number of Gauss-Newton steps
# The first _COARSE_STEPS steps use every _COARSE-th sample, if more than _ENOUGH samples remain.
_COARSE_STEPS, _COARSE, _ENOUGH = 6, 4, 300
# Mirror images farther than _FIRST_REACH from the surface are ignored. Each step multiplies this distance by _SHRINK.
_FIRST_REACH, _SHRINK = 0.3, 0.7
_DIFFERENCE = 1e-6  # change of a parameter for finite differences


def candidate_planes(evidence: SurfaceFeatures) -> Planes:
    """Return candidate mirror planes (K, 4), fitted to the surface, no two of them nearly the same."""
    seeds = _distinct(_voted(evidence), _MOST_REFINED)
    seeds = np.concatenate([seeds, _principal(evidence.points)])
    return _distinct(np.array([_refined(evidence, plane) for plane in seeds]), len(seeds))


def mirrored(points: Float64, plane: Float64) -> Float64:
    """Return the mirror images (N, 3) of `points` (N, 3) in `plane`."""
    height = points @ plane[:3] - plane[3]
    return points - 2 * height[:, None] * plane[:3]


def same_plane(a: Float64, b: Float64, *, angle: float = _SAME_ANGLE, offset: float = _SAME_OFFSET) -> bool:
    """Return whether two planes have an angle below `angle` (radians) and offsets that differ by less than `offset`."""
    along = float(a[:3] @ b[:3])
    return bool(abs(along) > np.cos(angle) and abs(a[3] - np.sign(along) * b[3]) < offset)


def _voted(evidence: SurfaceFeatures) -> Planes:
    """Return planes halfway between the samples of random pairs. Planes with the most votes of pairs come first."""
    pairs = evidence.pairs
    if len(pairs) == 0:
        return np.zeros((0, 4))
    random = np.random.default_rng(0)
    chosen = pairs[random.choice(len(pairs), min(_SEEDS, len(pairs)), replace=False)]
    planes = _between(evidence.points, chosen)
    voters = pairs[random.choice(len(pairs), min(2_000, len(pairs)), replace=False)]
    one, other = evidence.points[voters[:, 0]], evidence.points[voters[:, 1]]
    votes = [float((((mirrored(one, plane) - other) ** 2).sum(axis=1) < _PAIR_FITS**2).sum()) for plane in planes]
    return planes[np.argsort(votes)[::-1]]


def _between(points: Float64, pairs: Int64) -> Planes:
    """Return the plane halfway between the two points of each pair, (P, 4)."""
    one, other = points[pairs[:, 0]], points[pairs[:, 1]]
    normals = (one - other) / np.linalg.norm(one - other, axis=1, keepdims=True)
    return np.column_stack([normals, np.einsum("pd,pd->p", normals, (one + other) / 2)])


def _principal(points: Float64) -> Planes:
    """Return six planes (6, 4): three perpendicular to x, y, z, and three perpendicular to the principal axes."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2] if len(points) >= 3 else np.eye(3)
    normals = np.concatenate([np.eye(3), axes])
    return np.column_stack([normals, normals @ middle * np.repeat([0.0, 1.0], 3)])


def _distinct(planes: Planes, most: int) -> Planes:
    """Return the first `most` of `planes`, without planes that are nearly the same as an earlier one."""
    kept: list[Float64] = []
    for plane in planes:
        if len(kept) == most:
            break
        if not any(same_plane(plane, other) for other in kept):
            kept.append(plane)
    return np.array(kept).reshape(-1, 4)


def _refined(evidence: SurfaceFeatures, plane: Float64) -> Float64:
    """Return the plane near `plane` for which the mirror image of the surface fits the surface best.

    Gauss-Newton steps minimize the distances of mirror images to the tangent planes of the nearest samples. Images far
    from the surface are left out. Source: Chen and Medioni, "Object modelling by registration of multiple range
    images", 1992.
    """
    in_plane = np.linalg.svd(plane[None, :3])[2][1:]  # (2, 3) two perpendicular unit vectors in the plane

    def varied(change: Float64) -> Float64:
        """Return the plane after a `change` (3,) of two components of its normal and of its offset."""
        turned = plane[:3] + change[:2] @ in_plane
        return np.append(turned, plane[3] + change[2]) / np.linalg.norm(turned)

    parameters = np.zeros(3)
    for step in range(_STEPS):
        coarse = step < _COARSE_STEPS and len(evidence.points) > _COARSE * _ENOUGH
        points = evidence.points[:: _COARSE if coarse else 1]
        images = mirrored(points, varied(parameters))
        reach = max(_FIRST_REACH * _SHRINK**step, 2.5 * evidence.spacing)
        distance, nearest = evidence.tree.query(images, distance_upper_bound=reach)
        near = distance < reach
        if near.sum() < 9:
            break
        tangents = evidence.normals[nearest[near]]
        residual = np.einsum("nd,nd->n", tangents, images[near] - evidence.points[nearest[near]])
        slopes = [
            np.einsum("nd,nd->n", tangents, mirrored(points[near], varied(parameters + shift)) - images[near])
            for shift in _DIFFERENCE * np.eye(3)
        ]
        matrix = np.stack(slopes, axis=1) / _DIFFERENCE
        weight = 1 / (1 + (residual / max(evidence.spacing, 1e-9)) ** 2)
        normal_matrix = matrix.T @ (matrix * weight[:, None])
        damping = 1e-6 * max(float(np.trace(normal_matrix)), 1e-12)
        change = np.linalg.solve(normal_matrix + damping * np.eye(3), -matrix.T @ (weight * residual))
        parameters = parameters + change
        if np.abs(change).max() < 1e-6:
            break
    return varied(parameters)
