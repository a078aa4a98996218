"""Measure how well a symmetry maps a shape to itself: compare the features of surface samples and of their images.

In normalized coordinates, the origin is the center of the bounding box, and half of the box's longest side is 1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64, Int32, Int64, unit
from dfd.field.field import Field
from dfd.geometry.normalization import Normalization, box_normalization
from dfd.geometry.topology import even_points, face_areas
from dfd.mesh.mesh import Mesh
from dfd.mesh.normals import face_normals

POINTS = 2_000  # number of surface samples
COUNTERPARTS = 6  # number of samples with similar features that are paired with each queried sample
# Largest number of samples for which samples with similar features are searched. With 200, 4 of 52 shapes get other
# planes.
_QUERIED = 500
# Smallest normalized distance of paired samples; nearer samples always look alike. With 0.01, 6 of 52 shapes get other
# planes.
_LEAST_PAIR_DISTANCE = 0.1
_BINS = 24  # number of distance intervals for which the mean change of features is computed
STAYS = 0.1  # a sample counts as moved if its image is farther away than this normalized distance
# Smallest share of samples that a symmetry must move, so that the plane of a flat shape is none. With 0, the planes of
# 52 shapes, none of them flat, stay the same.
_MOVED = 0.3
# Share of the moved samples that a score uses, because a small part can lack a mirror image. With 1, 6 of 52 shapes get
# other planes.
_TRIMMED = 0.8


@dataclass(frozen=True)
class SurfaceFeatures:
    """Surface samples in normalized coordinates, and their features."""

    field: Field
    frame: Normalization  # the map from mesh units to normalized coordinates
    points: Float64  # (N, 3) normalized
    normals: Float64  # (N, 3) unit
    features: Float32  # (N, D)
    tree: cKDTree  # search tree of `points`
    pairs: Int64  # (P, 2) indices of samples with similar features, farther than _LEAST_PAIR_DISTANCE from each other
    change: Float64  # (B,) mean feature distance of two samples, for each of B intervals of the distance in space
    farthest: float  # upper end of the last interval of `change`, normalized
    spacing: float  # typical distance of neighboring samples, normalized

    def dissimilarity(self, images: Float64) -> float:
        """Return the dissimilarity of the symmetry that maps `points` to `images` (N, 3).

        It is the mean feature distance of the best 80 % of moved samples from their images, divided by the usual
        feature distance of samples that far apart. It is 0 for a perfect symmetry, about 1 by chance. If few samples
        move, the result is 1.
        """
        distance = np.linalg.norm(images - self.points, axis=1)
        moves = distance > STAYS
        if moves.mean() < _MOVED:
            return 1.0
        found = np.asarray(self.field(self.frame.invert(images[moves])), np.float32)
        changed = np.linalg.norm(self.features[moves] - found, axis=1)
        places = (np.arange(len(self.change)) + 0.5) * self.farthest / len(self.change)
        usual = float(np.interp(distance[moves], np.concatenate([[0], places]), [0, *self.change]).mean())
        if usual == 0:  # all features are equal
            return 1.0
        kept = np.argsort(changed)[: max(1, int(_TRIMMED * len(changed)))]
        return float(changed[kept].mean() / usual)


def surface_features(field: Field, mesh: Mesh) -> SurfaceFeatures | None:
    """Return evenly spaced surface samples of `mesh` and their features; None if the mesh has no extent."""
    frame = box_normalization(*mesh.bounds)
    if frame is None:
        return None
    points, normals = _surface_points(frame.apply(mesh.vertices), mesh.faces)
    features = np.asarray(field(frame.invert(points)), np.float32)
    change, farthest = _change_with_distance(points, features)
    pairs, tree = _similar_pairs(points, features), cKDTree(points)
    spacing = float(np.median(tree.query(points[:200], k=[2])[0]))
    return SurfaceFeatures(field, frame, points, normals, features, tree, pairs, change, farthest, spacing)


def _surface_points(vertices: Float64, faces: Int32) -> tuple[Float64, Float64]:
    """Return surface samples (N, 3) and unit normals (N, 3), or vertices and normals of 0 if no face has an area."""
    if face_areas(vertices, faces).sum() == 0:
        chosen = np.unique(faces)[:: max(1, len(vertices) // POINTS)]
        return vertices[chosen], np.zeros((len(chosen), 3))
    corners, weights = even_points(vertices, faces, POINTS)
    return np.einsum("nk,nkd->nd", weights, vertices[corners]), unit(face_normals(vertices, corners))


def _change_with_distance(points: Float64, features: Float32) -> tuple[Float64, float]:
    """Return `change` and `farthest` of `SurfaceFeatures` for the samples `points` (N, 3) with `features` (N, D)."""
    random = np.random.default_rng(0)
    a, b = random.integers(0, len(points), (2, 20 * POINTS))
    # Random pairs are seldom near each other, so neighbors along a random direction are added.
    order = np.argsort(points @ random.normal(size=3))
    a, b = np.concatenate([a, order[:-1]]), np.concatenate([b, order[1:]])
    distance = np.linalg.norm(points[a] - points[b], axis=1)
    change = np.linalg.norm(features[a] - features[b], axis=1)
    farthest = float(distance.max()) or 1.0
    bins = np.minimum((distance / farthest * _BINS).astype(int), _BINS - 1)
    count, total = np.bincount(bins, minlength=_BINS), np.bincount(bins, change, _BINS)
    known = count > 0
    means = np.interp(np.arange(_BINS), np.flatnonzero(known), total[known] / count[known])
    return np.maximum.accumulate(means), farthest


def _similar_pairs(points: Float64, features: Float32) -> Int64:
    """Return pairs (P, 2): every k-th sample is paired with the distant samples that have the most similar features."""
    queried = np.arange(0, len(points), -(-len(points) // _QUERIED))
    dissimilarity = -(features[queried] @ features.T)
    squared = (points**2).sum(axis=1)
    apart = squared[queried, None] + squared - 2 * points[queried] @ points.T
    dissimilarity[apart <= _LEAST_PAIR_DISTANCE**2] = np.inf
    count = min(COUNTERPARTS, len(points) - 1)
    if count < 1:
        return np.zeros((0, 2), np.int64)
    best = np.argpartition(dissimilarity, count - 1, axis=1)[:, :count]
    pairs = np.column_stack([np.repeat(queried, count), best.ravel()])
    return pairs[np.isfinite(np.take_along_axis(dissimilarity, best, axis=1).ravel())]
