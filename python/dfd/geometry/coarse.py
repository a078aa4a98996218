"""A coarse stand-in for a fine mesh, and where on it each fine vertex lies."""

from __future__ import annotations

from dataclasses import dataclass, replace

import fast_simplification
import numpy as np
from numpy.typing import NDArray

from dfd.geometry.topology import face_components, sound_faces

__all__ = ["CoarseMesh", "closest_on_triangles", "coarsen"]

_SMALL_PIECE = 2_000  # faces; smaller pieces are kept whole, since simplification might make them vanish
_ROUNDS = 4  # steps from triangle to neighbouring triangle in search of the nearest


@dataclass(frozen=True)
class CoarseMesh:
    """Sound faces, fewer than the fine mesh's, and each fine vertex as a point on one of them."""

    vertices: NDArray[np.float64]  # (K, 3), each used by a face
    faces: NDArray[np.int32]  # (T, 3)
    face: NDArray[np.int32]  # (V,) the coarse face of each fine vertex, -1 for a vertex that no sound face uses
    barycentric: NDArray[np.float64]  # (V, 3) its weights of that face's corners

    def carry(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values (V,) at fine vertices, from values (K,) at coarse ones; NaN where no face leads there."""
        carried = _dot(values[self.faces[self.face]], self.barycentric)
        carried[self.face < 0] = np.nan
        return carried

    def at(self, vertices: NDArray[np.int32]) -> CoarseMesh:
        """Return the same for fine vertices that lie where `vertices` (W,) of this one do."""
        return replace(self, face=self.face[vertices], barycentric=self.barycentric[vertices])


def coarsen(vertices: NDArray[np.float64], faces: NDArray[np.int32], most_faces: int) -> CoarseMesh:
    """Return a mesh of about `most_faces` faces at most; one that has no more is only freed of unsound faces.

    Parameters
    ----------
    vertices
        (V, 3) positions, finite.
    faces
        (F, 3) indices in range, vertices that share a position named by one index.
    most_faces
        From where on pieces of the surface are simplified (quadric error metric).
    """
    sound = sound_faces(faces)
    piece = face_components(sound)
    large = np.bincount(piece)[piece] >= _SMALL_PIECE if len(sound) > most_faces else np.zeros(len(sound), bool)
    target = max(most_faces - int((~large).sum()), most_faces // 4)
    points, triangles = vertices, sound[~large]
    nearest = np.arange(len(vertices), dtype=np.int32)
    if large.sum() > target:
        points, simplified, nearest = _simplified(vertices, sound[large], target, triangles)
        triangles = np.concatenate([simplified, triangles])
        triangles = sound_faces(triangles)
    else:
        triangles = sound
    used, number = _numbered(triangles, len(points))
    corners, triangles = points[used], number[triangles]
    face, barycentric = _locate(vertices, number[nearest], corners, triangles)
    return CoarseMesh(corners, triangles, face, barycentric)


def _simplified(
    vertices: NDArray[np.float64], large: NDArray[np.int32], target: int, small: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]]:
    """Return points, simplified faces, and the point (V,) that each vertex went to.

    Points are those of the simplified pieces followed by all `vertices`, whose numbers in `small` are shifted in place.
    """
    used, number = _numbered(large, len(vertices))
    corners, triangles = vertices[used], number[large]
    # in coordinates of about 1: its thresholds are absolute
    middle, size = corners.mean(axis=0), max(float(np.ptp(corners, axis=0).max()), 1e-300)
    scaled = np.ascontiguousarray((corners - middle) / size)
    collapses = fast_simplification.simplify(scaled, triangles, target_count=target, return_collapses=True)[2]
    points, simplified, went = fast_simplification.replay_simplification(scaled, triangles, collapses)
    points = _held_back(points, scaled, went)
    nearest = np.arange(len(vertices), dtype=np.int32) + np.int32(len(points))
    nearest[used] = went
    small += np.int32(len(points))
    return np.concatenate([points * size + middle, vertices]), simplified.astype(np.int32), nearest


def _numbered(faces: NDArray[np.int32], count: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the vertices that faces use, ascending, and the place of each of `count` among them, -1 for the rest."""
    mask = np.zeros(count, bool)
    mask[faces] = True
    used = np.flatnonzero(mask)
    number = np.full(count, -1, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return used, number


def _held_back(
    points: NDArray[np.float64],  # (P, 3) after simplification
    corners: NDArray[np.float64],  # (C, 3) before
    went: NDArray[np.integer],  # (C,) the point that each corner went to
) -> NDArray[np.float64]:
    """Return `points` with those that lie farther out than the corners they stand for at the middle of these.

    On flat ground the best place for a point is nearly free, and simplification may put it anywhere.
    """
    count = np.maximum(np.bincount(went, minlength=len(points)), 1)
    middle = np.stack([np.bincount(went, axis, len(points)) for axis in corners.T], axis=1) / count[:, None]
    reach = np.zeros(len(points))
    np.maximum.at(reach, went, np.linalg.norm(corners - middle[went], axis=1))
    astray = np.linalg.norm(points - middle, axis=1) > reach
    return np.where((astray & (np.bincount(went, minlength=len(points)) > 0))[:, None], middle, points)


def _locate(
    points: NDArray[np.float64],  # (V, 3)
    start: NDArray[np.int32],  # (V,) a corner near each point, -1 for none
    corners: NDArray[np.float64],  # (K, 3), each of at least one triangle
    triangles: NDArray[np.int32],  # (T, 3)
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return the nearest triangle (V,) and weights (V, 3) of its corners, searched from `start` along the surface."""
    order = np.argsort(triangles.ravel(), kind="stable").astype(np.int32)
    around = order // 3  # triangles, those of one corner side by side
    count = np.bincount(triangles.ravel(), minlength=len(corners))
    first = np.cumsum(count) - count
    face = np.full(len(points), -1, np.int32)
    barycentric = np.zeros((len(points), 3))
    squared = np.full(len(points), np.inf)
    here = np.flatnonzero(start >= 0)
    corner = start[here]
    for _ in range(_ROUNDS):
        for slot in range(int(count[corner].max(initial=0))):
            more = count[corner] > slot
            chosen, triangle = here[more], around[first[corner[more]] + slot]
            weights, distance = closest_on_triangles(points[chosen], corners[triangles[triangle]])
            nearer = distance < squared[chosen]
            better = chosen[nearer]
            face[better], barycentric[better] = triangle[nearer], weights[nearer]
            squared[better] = distance[nearer]
        nearest_corner = triangles[face[here], barycentric[here].argmax(axis=1)]
        onward = nearest_corner != corner
        here, corner = here[onward], nearest_corner[onward]
    return face, barycentric


def closest_on_triangles(
    points: NDArray[np.float64], triangles: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the weights (N, 3) of the point nearest to each of `points` (N, 3) on `triangles` (N, 3, 3).

    The second result (N,) is the squared distance to it.
    """
    a = triangles[:, 0]
    ab, ac, ap = triangles[:, 1] - a, triangles[:, 2] - a, points - a
    d11, d12, d22 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    p1, p2 = _dot(ap, ab), _dot(ap, ac)
    area = d11 * d22 - d12 * d12
    with np.errstate(divide="ignore", invalid="ignore"):
        v, w = (d22 * p1 - d12 * p2) / area, (d11 * p2 - d12 * p1) / area
        weights = np.stack([1 - v - w, v, w], axis=1)
        outside = ~(weights.min(axis=1) >= 0)  # also where there is no area
        # the nearest point of each side, as the share of its second end
        on_ab = np.nan_to_num(p1 / d11).clip(0, 1)
        on_ac = np.nan_to_num(p2 / d22).clip(0, 1)
        side = d22 - 2 * d12 + d11
        on_bc = np.nan_to_num((p2 - p1 + d11 - d12) / side).clip(0, 1)
    zero = np.zeros_like(on_ab)
    best = np.full(len(points), np.inf)
    for candidate in (
        np.stack([1 - on_ab, on_ab, zero], axis=1),
        np.stack([1 - on_ac, zero, on_ac], axis=1),
        np.stack([zero, 1 - on_bc, on_bc], axis=1),
    ):
        offset = ap - candidate[:, 1:2] * ab - candidate[:, 2:] * ac
        distance = _dot(offset, offset)
        nearer = outside & (distance < best)
        weights[nearer], best[nearer] = candidate[nearer], distance[nearer]
    offset = ap - weights[:, 1:2] * ab - weights[:, 2:] * ac
    return weights, _dot(offset, offset)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    products: NDArray[np.float64] = np.einsum("ij,ij->i", a, b)
    return products
