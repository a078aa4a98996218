"""What symmetries of a shape are judged by: points of its surface with their features, and pairs that look alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64, Int32, Int64, unit
from dfd.field.field import Field
from dfd.geometry.topology import even_points, face_areas
from dfd.mesh.mesh import Mesh
from dfd.mesh.normalization import box_normalization
from dfd.mesh.normals import face_normals

POINTS = 2_000
LOOK_ALIKES = 6  # of each asking point, among those farther away than _APART
_ASKING = 500  # points whose counterparts are sought: the planes between them are far more than are tried
_APART = 0.1  # of half the longest side: what is nearer looks alike anyhow
_BINS = 24  # of distances, for how features change with them
STAYS = 0.1  # normalized: a point that moves by less says nothing about a symmetry
_MOVED = 0.3  # the share of points that a symmetry has to move
_NO_SPREAD = 1e-4  # features that differ by less everywhere say nothing about symmetry
_TRIMMED = 0.8  # share of the points that a score goes by: what a hand holds need not be symmetric


@dataclass(frozen=True)
class SurfaceFeatures:
    """Points of a surface in normalized coordinates, in which half the longest side is 1, and their features."""

    field: Field
    center: Float64  # (3,) mesh units
    half: float  # mesh units
    points: Float64  # (N, 3) normalized
    normals: Float64  # (N, 3) unit
    features: Float32  # (N, D)
    tree: cKDTree  # of `points`
    pairs: Int64  # (P, 2) points that look alike and are apart
    change: Float64  # (B,) mean distance of two points' features, by how far apart they are
    reach: float  # the distance that the last of `change` is for
    spacing: float  # about how far apart neighboring points are, normalized

    def features_at(self, points: Float64) -> Float32:
        """Features (K, D) of normalized points (K, 3)."""
        return np.asarray(self.field(points * self.half + self.center), np.float32)

    def usual_change(self, distance: Float64) -> Float64:
        """How much features of this shape differ, (K,), between points so far apart, (K,) normalized."""
        places = (np.arange(len(self.change)) + 0.5) * self.reach / len(self.change)
        return np.interp(distance, np.concatenate([[0], places]), [0, *self.change])

    def dissimilarity(self, images: Float64) -> tuple[float, float]:
        """Judge a symmetry by the `images` (N, 3) of `points`, normalized.

        Returned is how much features change over how much they usually do between points so far apart, over the best
        four fifths of the points that move: 0 is a perfect symmetry, 1 no better than chance, and where few points move
        at all, as across a flat shape's own plane. Then the share of the points that move and land on the surface.
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


def gather(field: Field, mesh: Mesh) -> SurfaceFeatures | None:
    """Take points evenly over the surface of `mesh` and their features; None where it has no extent."""
    found = box_normalization(*mesh.bounds)
    if found is None:
        return None
    center, scale = found
    points, normals = _surface_points((mesh.vertices - center) * scale, mesh.faces)
    features = np.asarray(field(points / scale + center), np.float32)
    change, reach = _change_with_distance(points, features)
    pairs, tree = _look_alikes(points, features), cKDTree(points)
    spacing = float(np.median(tree.query(points[:200], k=[2])[0]))
    return SurfaceFeatures(field, center, 1 / scale, points, normals, features, tree, pairs, change, reach, spacing)


def _surface_points(vertices: Float64, faces: Int32) -> tuple[Float64, Float64]:
    """Return points (N, 3) spread over the faces by their areas, and the faces' unit normals there."""
    areas = face_areas(vertices, faces)
    if areas.sum() == 0:
        chosen = np.unique(faces)[:: max(1, len(vertices) // POINTS)]
        return vertices[chosen], np.zeros((len(chosen), 3))
    face, weights = even_points(areas, POINTS)
    normals = unit(face_normals(vertices, faces[face]))
    return np.einsum("nk,nkd->nd", weights, vertices[faces[face]]), normals


def _change_with_distance(points: Float64, features: Float32) -> tuple[Float64, float]:
    """Return the mean distance (B,) of two points' features by how far apart the points are, and how far at most."""
    random = np.random.default_rng(0)
    a, b = random.integers(0, len(points), (2, 20 * POINTS))
    # pairs at random are far apart: take as many from among near ones
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


def _look_alikes(points: Float64, features: Float32) -> Int64:
    """Return pairs (P, 2) of some points, spread evenly, with those farther away whose features are nearest."""
    asking = np.arange(0, len(points), -(-len(points) // _ASKING))
    unlike = -(features[asking] @ features.T)
    squared = (points**2).sum(axis=1)
    apart = squared[asking, None] + squared - 2 * points[asking] @ points.T
    unlike[apart <= _APART**2] = np.inf  # what is near looks alike anyhow
    count = min(LOOK_ALIKES, len(points) - 1)
    if count < 1:
        return np.zeros((0, 2), np.int64)
    best = np.argpartition(unlike, count - 1, axis=1)[:, :count]
    pairs = np.column_stack([np.repeat(asking, count), best.ravel()])
    return pairs[np.isfinite(np.take_along_axis(unlike, best, axis=1).ravel())]
