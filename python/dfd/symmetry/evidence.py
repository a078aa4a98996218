"""Judge symmetries of a shape by points of its surface, their features, and pairs of points that look alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64, Int32, Int64, unit
from dfd.field.field import Field
from dfd.geometry.topology import even_points, face_areas
from dfd.mesh.mesh import Mesh
from dfd.mesh.normalization import Normalization, box_normalization
from dfd.mesh.normals import face_normals

POINTS = 2_000
COUNTERPARTS = 6  # points that look like a queried point, among those farther away than _APART
_QUERIED = 500  # points whose counterparts are sought; the pairs are far more than the planes that are tried
_APART = 0.1  # of half the longest side: nearer points always look alike
_BINS = 24  # of the distances, for the change of features with distance
STAYS = 0.1  # normalized: points that move by less are not judged
_MOVED = 0.3  # least share of points that a symmetry moves
_NO_SPREAD = 1e-4  # least difference of features: smaller ones do not tell symmetries apart
_TRIMMED = 0.8  # share of the points in a score, because the object in one hand of a figure is not symmetric


@dataclass(frozen=True)
class SurfaceFeatures:
    """Points of a surface in normalized coordinates, in which half the longest side is 1, and their features."""

    field: Field
    frame: Normalization  # from mesh units to normalized coordinates
    points: Float64  # (N, 3) normalized
    normals: Float64  # (N, 3) unit
    features: Float32  # (N, D)
    tree: cKDTree  # of `points`
    pairs: Int64  # (P, 2) points that look alike and are apart
    change: Float64  # (B,) mean distance between the features of two points, by the distance of the points
    reach: float  # upper end of the last interval of `change`, normalized
    spacing: float  # typical distance of neighboring points, normalized

    def features_at(self, points: Float64) -> Float32:
        """Return the features (K, D) of normalized points (K, 3)."""
        return np.asarray(self.field(self.frame.invert(points)), np.float32)

    def usual_change(self, distance: Float64) -> Float64:
        """Return the mean difference of features (K,) between two points at each `distance` (K,), normalized."""
        places = (np.arange(len(self.change)) + 0.5) * self.reach / len(self.change)
        return np.interp(distance, np.concatenate([[0], places]), [0, *self.change])

    def dissimilarity(self, images: Float64) -> tuple[float, float]:
        """Judge a symmetry by the `images` (N, 3) of `points`, normalized.

        Return the dissimilarity, and the share of the moved points whose images lie on the surface. The dissimilarity
        is the mean change of features over `usual_change`, for the best four fifths of the moved points. It is 0 for a
        perfect symmetry, and 1 for chance. It is also 1 if few points move, as across the plane of a flat shape.
        """
        distance = np.linalg.norm(images - self.points, axis=1)
        moves = distance > STAYS
        if moves.mean() < _MOVED:
            return 1.0, 0.0
        landed = float((self.tree.query(images[moves])[0] < 3 * self.spacing).mean())
        changed = np.linalg.norm(self.features[moves] - self.features_at(images[moves]), axis=1)
        usual = float(self.usual_change(distance[moves]).mean())
        if usual < _NO_SPREAD:
            return 1.0, landed
        kept = np.argsort(changed)[: max(1, int(_TRIMMED * len(changed)))]
        return float(changed[kept].mean() / usual), landed


def surface_features(field: Field, mesh: Mesh) -> SurfaceFeatures | None:
    """Return points spread evenly over the surface of `mesh`, and their features; None if it has no extent."""
    frame = box_normalization(*mesh.bounds)
    if frame is None:
        return None
    points, normals = _surface_points(frame.apply(mesh.vertices), mesh.faces)
    features = np.asarray(field(frame.invert(points)), np.float32)
    change, reach = _change_with_distance(points, features)
    pairs, tree = _counterpart_pairs(points, features), cKDTree(points)
    spacing = float(np.median(tree.query(points[:200], k=[2])[0]))
    return SurfaceFeatures(field, frame, points, normals, features, tree, pairs, change, reach, spacing)


def _surface_points(vertices: Float64, faces: Int32) -> tuple[Float64, Float64]:
    """Return points (N, 3) spread over the faces by area, and the unit normals (N, 3) of their faces."""
    areas = face_areas(vertices, faces)
    if areas.sum() == 0:
        chosen = np.unique(faces)[:: max(1, len(vertices) // POINTS)]
        return vertices[chosen], np.zeros((len(chosen), 3))
    face, weights = even_points(areas, POINTS)
    normals = unit(face_normals(vertices, faces[face]))
    return np.einsum("nk,nkd->nd", weights, vertices[faces[face]]), normals


def _change_with_distance(points: Float64, features: Float32) -> tuple[Float64, float]:
    """Return the mean difference (B,) of features by the distance of two points, and the largest distance."""
    random = np.random.default_rng(0)
    a, b = random.integers(0, len(points), (2, 20 * POINTS))
    # Random pairs are far apart, so the second half of the pairs are near each other.
    order = np.argsort(points @ random.normal(size=3))
    c = order[:-1]
    a, b = np.concatenate([a, c]), np.concatenate([b, order[1:]])
    distance = np.linalg.norm(points[a] - points[b], axis=1)
    change = np.linalg.norm(features[a] - features[b], axis=1)
    reach = float(distance.max()) or 1.0
    bins = np.minimum((distance / reach * _BINS).astype(int), _BINS - 1)
    count, total = np.bincount(bins, minlength=_BINS), np.bincount(bins, change, _BINS)
    known = count > 0
    means = np.interp(np.arange(_BINS), np.flatnonzero(known), total[known] / count[known])
    return np.maximum.accumulate(means), reach


def _counterpart_pairs(points: Float64, features: Float32) -> Int64:
    """Return pairs (P, 2): evenly spread points, each with the distant points that have the nearest features."""
    queried = np.arange(0, len(points), -(-len(points) // _QUERIED))
    unlike = -(features[queried] @ features.T)
    squared = (points**2).sum(axis=1)
    apart = squared[queried, None] + squared - 2 * points[queried] @ points.T
    unlike[apart <= _APART**2] = np.inf
    count = min(COUNTERPARTS, len(points) - 1)
    if count < 1:
        return np.zeros((0, 2), np.int64)
    best = np.argpartition(unlike, count - 1, axis=1)[:, :count]
    pairs = np.column_stack([np.repeat(queried, count), best.ravel()])
    return pairs[np.isfinite(np.take_along_axis(unlike, best, axis=1).ravel())]
