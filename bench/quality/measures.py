"""Compare weights with labelled parts: by average precision, and by soft IoU."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

import dfd
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.geometry.topology import vertex_areas

Weights = NDArray[np.floating]  # (V, H) weights, with a column for each handle
Labels = NDArray[np.integer]  # (V,) index of each vertex's part, −1 for none
Handles = NDArray[np.integer]  # (H,) vertex indices


def area_fractions(mesh: dfd.Mesh) -> Float64:
    """Return each vertex's fraction (V,) of the surface area: a third of the area of the faces at the vertex."""
    areas = vertex_areas(mesh.vertices, mesh.faces)
    return areas / areas.sum()


def draw_handles(labels: Labels, each: int, seed: int = 0) -> Int64:
    """Return random vertices (H,): `each` vertices of every part, or all vertices of a part that has fewer."""
    generator = np.random.default_rng(seed)
    parts = [np.flatnonzero(labels == part) for part in range(labels.max() + 1)]
    return np.concatenate([generator.choice(part, min(each, len(part)), replace=False) for part in parts])


def average_precision(scores: NDArray[np.floating], relevant: Bool) -> float:
    """Rank vertices by `scores` (V,), ties at one rank. Return the average precision of finding `relevant` (V,)."""
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(relevant[order])
    last = np.append(np.diff(scores[order]) != 0, True)
    found, ranked = hits[last], np.flatnonzero(last) + 1
    return float((np.diff(found, prepend=0) * found / ranked).sum() / hits[-1])


def handle_precision(weights: Weights, labels: Labels, handles: Handles) -> Float64:
    """Rank vertices by each handle's weights, and return the average precision (H,) for the handle's part.

    The handle itself and vertices without a part are not ranked. If the part has no other vertex, the result is NaN.
    """
    precision = np.full(len(handles), np.nan)
    for column, handle in enumerate(handles):
        counts = labels >= 0
        counts[handle] = False
        relevant = (labels == labels[handle])[counts]
        if relevant.any():
            precision[column] = average_precision(weights[counts, column], relevant)
    return precision


def mean_over_labels(labels: Labels, values: Any) -> float:
    """Average the `values` (H,) of handles with equal `labels` (H,), then average these means. NaN is ignored."""
    known = ~np.isnan(values)
    return float(np.mean([np.asarray(values)[known & (labels == each)].mean() for each in np.unique(labels[known])]))


def session_of(mesh: dfd.Mesh, field: dfd.Field) -> dfd.Deformer:
    """Return a session with the preset with which the field was distilled."""
    return dfd.Deformer(mesh, field, preset=field.settings.get("preset", "default"))


def weights_of_each(session: dfd.Deformer, vertices: Handles, level: int = 0) -> list[Float64]:
    """Return the weights (V,) of a handle at each of `vertices` (H,). `session` must have no other handles."""
    found = []
    for vertex in vertices.tolist():
        held = session.add(vertex, level=level)
        found.append(session.following[:, 0].astype(np.float64))
        session.remove(held)
    return found


def soft_iou(areas: Float64, weights: NDArray[Any], truth: Bool) -> float:
    """Return Σ min(w, t) / Σ max(w, t) for weights w (V,) and the mask `truth` t (V,), with terms weighted by area."""
    return float(areas @ np.minimum(weights, truth) / max(areas @ np.maximum(weights, truth), 1e-12))
