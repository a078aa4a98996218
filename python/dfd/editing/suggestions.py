"""Suggested handles: a few vertices, one for each kind of part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64
from dfd.editing.influence.counterparts import LEAST_ALIKE, Counterpart, CounterpartFinder
from dfd.geometry.topology import face_areas
from dfd.weights.bind import bind
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

SAMPLE, CANDIDATES = 4096, 1024  # vertices that stand for the shape, and those that may be suggested
REACH = 0.5  # so near in features a part's own vertices are to each other, and hardly those of another
LEAST_PART = 0.004  # of the shape: what looks like less of it than this is no part
ALIKE = 0.35  # feature distance: what is nearer to a handle than this goes with it


@dataclass(frozen=True)
class Suggestion:
    """A suggested handle."""

    vertex: int  # where to hold
    share: float  # part of the shape, by area, that looks more like it than like any other suggested one
    counterparts: tuple[Counterpart, ...]  # what would follow, its own place first


def suggest_handles(
    mesh: Mesh,
    features: Float32 | CompactFeatures,
    *,
    count: int = 12,
    planes: Sequence[SymmetryPlane] = (),
    finder: CounterpartFinder | None = None,
) -> list[Suggestion]:
    """Suggest handles, one for each kind of part: a hoof stands for all hooves, a horn for both.

    The first is where the shape looks least like the rest of itself, and each next one where it looks least like those
    before it: the tips that people take hold of, and in the end the body between them (Gonzalez, "Clustering to
    minimize the maximum intercluster distance", 1985).

    At most `count` are found, from the `features` (V, D) of the vertices, in full or compact; `planes` are those of
    symmetry of the shape, see `CounterpartFinder`.

    Raises ValueError if `count` is not at least 1, or no face has an area.
    """
    most = check.whole("suggest_handles", "count", count, minimum=1)
    random = np.random.default_rng(0)
    area = _areas(mesh)
    if not area.any():
        raise ArgumentError("mesh", "must have a face with an area, got none", "suggest_handles")
    # Drawn with repeats, so that each vertex counts by its area, however few there are.
    drawn, counts = np.unique(random.choice(len(area), SAMPLE, p=area / area.sum()), return_counts=True)
    order = random.permutation(len(drawn))
    some, weight = drawn[order], counts[order] / SAMPLE
    rows = features.rows(some) if isinstance(features, CompactFeatures) else features[some]
    candidates = np.arange(min(CANDIDATES, len(some)))
    # With a reach of 2 no distance of unit features is cut off.
    apart = 2.0 * (1.0 - bind(rows, candidates, reach=2.0))  # (sample, candidates)
    part = weight @ (apart < REACH) >= LEAST_PART
    candidates = candidates[part] if part.any() else candidates
    apart = apart[:, candidates]
    chosen = [int((weight @ apart).argmax())]
    while len(chosen) < most:
        nearest = apart[candidates][:, chosen].min(axis=1)
        if nearest.max() < ALIKE:
            break
        chosen.append(int(nearest.argmax()))
    shares = np.bincount(apart[:, chosen].argmin(axis=1), weight, minlength=len(chosen))
    finder = finder or CounterpartFinder(mesh)
    found = []
    for column, share in zip(chosen, shares, strict=True):
        vertex = int(some[candidates[column]])
        alike = bind(features, [vertex], reach=REACH)[:, 0]
        counterparts, _ = finder.find(alike, vertex, mesh.vertices[vertex], planes=planes)
        likes = tuple(one for one in counterparts if one is counterparts[0] or one.weight >= LEAST_ALIKE)
        found.append(Suggestion(vertex, float(share), likes))
    return found


def _areas(mesh: Mesh) -> Float64:
    """Return (V,) a third of the area of the faces around each vertex."""
    areas = np.repeat(face_areas(mesh.vertices, mesh.faces) / 3, 3)
    return np.bincount(mesh.faces.ravel(), areas, minlength=len(mesh.vertices)).astype(np.float64)
