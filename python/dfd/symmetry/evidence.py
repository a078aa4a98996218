"""Measure how well a symmetry maps a shape to itself: compare the features of surface samples and of their images.

In normalized coordinates, the origin is the center of the bounding box, and half of the box's longest side is 1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64
from dfd.field.field import Field
from dfd.geometry.normalization import Normalization, box_normalization
from dfd.mesh.mesh import Mesh
from dfd.symmetry.fit import SAMPLES, SurfaceSamples, samples_of

# Number of distance intervals for which the mean change of features is computed. With 8, 1 of 34 shapes loses a plane;
# with 48, none differs.
_BINS = 24
# STAYS: a sample counts as moved if its image is farther away than this normalized distance. With 0, 1 of 34 shapes
# (`dfd.symmetry.fit`) gets one plane more; with 0.2, 3 of them lose one.
STAYS = 0.1
# Share of the moved samples that a score uses, because a small part can lack a mirror image. With 1, 6 of 52 shapes get
# other planes.
_TRIMMED = 0.8


@dataclass(frozen=True)
class SurfaceFeatures:
    """Surface samples in normalized coordinates, and their features."""

    field: Field
    frame: Normalization  # the map from mesh units to normalized coordinates
    samples: SurfaceSamples  # N samples, normalized
    features: Float32  # (N, D)
    change: Float64  # (B,) mean feature distance of two samples, for each of B intervals of the distance in space
    farthest: float  # upper end of the last interval of `change`, normalized

    def dissimilarity(self, images: Float64) -> float:
        """Return the dissimilarity of the symmetry that maps the samples to `images` (N, 3).

        It is the mean feature distance of the best 80 % of moved samples from their images, divided by the usual
        feature distance of samples that far apart. It is 0 for a perfect symmetry, about 1 by chance. If no sample
        moves, the result is 1.
        """
        distance = np.linalg.norm(images - self.samples.points, axis=1)
        moves = distance > STAYS
        if not moves.any():
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
    vertices = frame.apply(mesh.vertices)
    samples = samples_of(vertices, mesh.faces)
    if samples is None:  # no face has an area
        points = vertices[np.unique(mesh.faces)[:SAMPLES]]
        samples = SurfaceSamples(points, np.zeros_like(points), cKDTree(points), 2.0)
    features = np.asarray(field(frame.invert(samples.points)), np.float32)
    return SurfaceFeatures(field, frame, samples, features, *_change_with_distance(samples.points, features))


def _change_with_distance(points: Float64, features: Float32) -> tuple[Float64, float]:
    """Return `change` and `farthest` of `SurfaceFeatures` for the samples `points` (N, 3) with `features` (N, D)."""
    random = np.random.default_rng(0)
    a, b = random.integers(0, len(points), (2, 20 * SAMPLES))
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
