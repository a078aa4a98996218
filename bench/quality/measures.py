"""Numbers that say how good weights are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import dfd
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.geometry.topology import face_areas

MOVES = 0.01  # a vertex of less weight stays where it is, as far as anyone can see

Weights = NDArray[np.floating]  # (V, H), a column a handle
Labels = NDArray[np.integer]  # (V,) the part of each vertex, −1 for none
Handles = NDArray[np.integer]  # (H,) vertices


def area_fractions(mesh: dfd.Mesh) -> Float64:
    """(V,) how much of the surface belongs to each vertex, a third of each of its faces; they sum to 1."""
    thirds = np.repeat(face_areas(mesh.vertices, mesh.faces) / 3, 3)
    areas = np.bincount(mesh.faces.ravel(), thirds, minlength=len(mesh.vertices))
    return areas / areas.sum()


def draw_handles(labels: Labels, each: int, seed: int = 0) -> Int64:
    """Vertices to grab: `each` of every part, or all of a smaller part; part after part."""
    generator = np.random.default_rng(seed)
    parts = [np.flatnonzero(labels == part) for part in range(labels.max() + 1)]
    return np.concatenate([generator.choice(part, min(each, len(part)), replace=False) for part in parts])


def average_precision(scores: NDArray[np.floating], relevant: Bool) -> float:
    """Area under precision against recall when vertices are ranked by `scores`; equal scores count as one step."""
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(relevant[order])
    last = np.append(np.diff(scores[order]) != 0, True)
    found, ranked = hits[last], np.flatnonzero(last) + 1
    return float((np.diff(found, prepend=0) * found / ranked).sum() / hits[-1])


def handle_precision(weights: Weights, labels: Labels, handles: Handles) -> Float64:
    """Average precision (H,) with which each handle's column ranks its own kind of part first.

    Neither the handle itself nor vertices without a part count; NaN where a part is nothing but its handle.
    """
    precision = np.full(len(handles), np.nan)
    for column, handle in enumerate(handles):
        counts = labels >= 0
        counts[handle] = False
        relevant = (labels == labels[handle])[counts]
        if relevant.any():
            precision[column] = average_precision(weights[counts, column], relevant)
    return precision


def part_precision(weights: Weights, labels: Labels, handles: Handles) -> dict[int, float]:
    """Mean average precision of the handles in every part that has more than its handle."""
    precision, part = handle_precision(weights, labels, handles), labels[handles]
    known = ~np.isnan(precision)
    return {int(each): float(precision[known & (part == each)].mean()) for each in np.unique(part[known])}


def spread(weights: Weights, labels: Labels, handles: Handles) -> tuple[float, float]:
    """How many times more weight the same kind of part gets than the rest, and the share of vertices that move.

    The ratio is the median over handles, the share their mean; vertices without a part do not count.
    """
    ratios, moving = [], []
    counts = labels >= 0
    for column, handle in enumerate(handles):
        same = labels == labels[handle]
        moving.append((weights[counts, column] > MOVES).mean())
        if (counts & ~same).any():
            ratios.append(weights[same, column].mean() / max(weights[counts & ~same, column].mean(), 1e-6))
    return float(np.median(ratios)) if ratios else float("nan"), float(np.mean(moving))


def mirror_image(vertices: NDArray[np.floating]) -> tuple[Float64, Float64]:
    """The image (V, 3) of every vertex across x, and its distance (V,) to a vertex, of the longest side of the box."""
    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    image = (vertices - center) * [-1, 1, 1] + center
    miss, _ = cKDTree(vertices).query(image)
    return image, miss / np.ptp(vertices, axis=0).max()


def difference(weights: Weights, reference: Weights) -> float:
    """Mean of |W − W'| over vertices and handles, relative to the mean of the reference W'."""
    return float(np.abs(weights - reference).mean() / max(reference.mean(), 1e-12))


def dirichlet_energy(weights: Weights, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> float:
    """∫ ‖∇w‖² over the surface, mean over the columns; the same for a shape of any size. Less is smoother.

    Weights are linear over every face; faces without area have none.
    """
    corners = (vertices / max(np.ptp(vertices, axis=0).max(), 1e-300))[faces]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # the edge across from each corner
    double_area = np.linalg.norm(np.cross(opposite[:, 0], opposite[:, 1]), axis=1)
    sound = double_area > 1e-14
    products = np.einsum("fck,fdk->fcd", opposite[sound], opposite[sound]) / (2 * double_area[sound, None, None])
    values = weights[faces[sound]].astype(np.float64)
    return float(np.einsum("fch,fcd,fdh->", values, products, values, optimize=True) / weights.shape[1])
