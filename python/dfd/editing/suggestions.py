"""Handles worth taking: a few vertices, one for each kind of part, that between them hold the whole shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.editing.instances import Instance, InstanceFinder
from dfd.geometry.topology import face_areas
from dfd.weights.bind import bind
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane

__all__ = ["Suggestion", "suggest_handles"]

SAMPLE, CANDIDATES = 4096, 512  # vertices that are to be held, and those that may hold them
REACH = 0.5  # so near in features a part's own vertices are to each other, and hardly those of another
LEAST_GAIN = 0.02  # of the shape: a handle that would hold less that is not held yet is not worth its number


@dataclass(frozen=True)
class Suggestion:
    """A handle worth taking.

    Attributes
    ----------
    vertex
        Where to hold.
    share
        Part of the shape, by area, that it holds better than those before it.
    instances
        What would follow, its own place first.
    """

    vertex: int
    share: float
    instances: tuple[Instance, ...]


def suggest_handles(
    mesh: Mesh,
    features: NDArray[np.float32] | CompactFeatures,
    *,
    count: int = 12,
    planes: Sequence[SymmetryPlane] = (),
    finder: InstanceFinder | None = None,
) -> list[Suggestion]:
    """Suggest handles, the one that holds most of the shape first.

    Each next one is the vertex that adds most to what is held, the sum over the surface of the largest weight: the
    greedy choice, which for such a sum is never far from the best (Nemhauser, Wolsey and Fisher, "An analysis of
    approximations for maximizing submodular set functions", 1978). One leg stands for all legs.

    Parameters
    ----------
    features
        (V, D) of the vertices, in full or compact.
    count
        At most so many.
    planes
        Planes of symmetry of the shape, see `InstanceFinder`.

    Raises
    ------
    ValueError
        If `count` is not at least 1.
    """
    most = check.whole("suggest_handles", "count", count, minimum=1)
    random = np.random.default_rng(0)
    area = _areas(mesh)
    chosen = area > 0
    some = random.choice(
        len(area), min(SAMPLE, int(chosen.sum())), replace=False, p=area / area.sum() if chosen.any() else None
    )
    rows = features.rows(some) if isinstance(features, CompactFeatures) else features[some]
    candidates = np.arange(min(CANDIDATES, len(some)))
    weights = bind(rows, candidates, reach=REACH)  # (sample, candidates)
    held = np.zeros(len(some), np.float32)
    finder = finder or InstanceFinder(mesh)
    found: list[Suggestion] = []
    while len(found) < most:
        gain = np.maximum(weights - held[:, None], 0).mean(axis=0)
        best = int(gain.argmax())
        if gain[best] < LEAST_GAIN and found:
            break
        held = np.maximum(held, weights[:, best])
        vertex = int(some[best])
        alike = bind(features, [vertex], reach=REACH)[:, 0]
        instances = finder.find(alike, vertex, mesh.vertices[vertex], planes=planes)
        found.append(Suggestion(vertex, float(gain[best]), instances))
    return found


def _areas(mesh: Mesh) -> NDArray[np.float64]:
    """(V,) a third of the area of the faces around each vertex."""
    areas = np.repeat(face_areas(mesh.vertices, mesh.faces) / 3, 3)
    return np.bincount(mesh.faces.ravel(), areas, minlength=len(mesh.vertices)).astype(np.float64)
