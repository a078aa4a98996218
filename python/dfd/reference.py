"""The slow twin of each kernel: the paper's equations in NumPy and float64, written to be read.

Tests hold the kernels to these; nothing else calls them. Arguments are taken as they come, without checks.
"""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from dfd.symmetry.plane import SymmetryPlane

__all__ = [
    "blend",
    "feature_weights",
    "geodesic_falloff",
    "mirrored_blend",
    "positive_share",
    "subtract_fixed",
    "surface_distances",
]

Array = NDArray[np.float64]


def feature_weights(features: ArrayLike, handles: ArrayLike) -> Array:
    """(V, H) weights of features (V, D) for handle rows (H, D): max(1 − ‖Z_i − Z_j‖₂, 0), Eq. 4 and 5."""
    z, h = np.asarray(features, np.float64), np.asarray(handles, np.float64)
    distances = [np.linalg.norm(z - row, axis=1) for row in h]
    weights: Array = np.maximum(1.0 - np.array(distances).reshape(len(h), len(z)).T, 0.0)
    return weights


def subtract_fixed(weights: ArrayLike, fixed_weights: ArrayLike) -> Array:
    """(V, H) weights less the largest weight (V, P) of any fixed point, at least 0, Eq. 6."""
    w, f = np.asarray(weights, np.float64), np.asarray(fixed_weights, np.float64)
    held: Array = f.max(axis=1, keepdims=True, initial=0.0)
    return np.maximum(w - held, 0.0)


def geodesic_falloff(weights: ArrayLike, geodesic: ArrayLike, locality: ArrayLike) -> Array:
    """(V, H) weights times (1 − G)^λ for geodesic distances (H, V) in [0, 1] and λ of every handle, Eq. 7."""
    w, g = np.asarray(weights, np.float64), np.asarray(geodesic, np.float64)
    falloff: Array = (1.0 - g.T) ** np.asarray(locality, np.float64)
    return w * falloff


def blend(vertices: ArrayLike, weights: ArrayLike, transforms: ArrayLike, default: ArrayLike | None = None) -> Array:
    """(V, 3) vertices moved by transforms (H, 3, 4) with weights (V, H), and by D₀ for what is left of 1, Eq. 1."""
    v, w, d = (np.asarray(value, np.float64) for value in (vertices, weights, transforms))
    rest = np.eye(3, 4) if default is None else np.asarray(default, np.float64)
    left = np.maximum(1.0 - w.sum(axis=1), 0.0)
    blended = left[:, None, None] * rest[:3] + np.einsum("vh,hij->vij", w, d[:, :3])
    moved: Array = np.einsum("vij,vj->vi", blended, np.column_stack([v, np.ones(len(v))]))
    return moved


def positive_share(vertices: ArrayLike, symmetry: SymmetryPlane) -> Array:
    """(V,) how much of each vertex is on the positive side: a step at the plane, or a smoothstep over ±band."""
    heights: Array = np.asarray(vertices, np.float64) @ np.asarray(symmetry.normal) - symmetry.offset
    if symmetry.band == 0:
        return np.where(heights >= 0, 1.0, 0.0)
    t: Array = np.clip(heights / (2 * symmetry.band) + 0.5, 0.0, 1.0)
    return t * t * (3 - 2 * t)


def mirrored_blend(
    vertices: ArrayLike,
    weights: ArrayLike,
    transforms: ArrayLike,
    symmetry: SymmetryPlane,
    positive: ArrayLike,
    default: ArrayLike | None = None,
) -> Array:
    """(V, 3) vertices moved by Eq. 8: D_k on the handle's own side (H booleans: the positive one), R D_k R beyond."""
    normal = np.asarray(symmetry.normal, np.float64)
    reflection = np.eye(4)
    reflection[:3, :3] -= 2.0 * np.outer(normal, normal)
    reflection[:3, 3] = 2.0 * symmetry.offset * normal
    own = np.zeros((len(np.asarray(transforms)), 4, 4))
    own[:, 3, 3] = 1.0
    own[:, :3] = np.asarray(transforms, np.float64)[:, :3]
    other = reflection @ own @ reflection
    side = np.asarray(positive, bool)[:, None, None]
    above = blend(vertices, weights, np.where(side, own, other), default)
    below = blend(vertices, weights, np.where(side, other, own), default)
    share = positive_share(vertices, symmetry)[:, None]
    mixed: Array = share * above + (1.0 - share) * below
    return mixed


def surface_distances(vertices: ArrayLike, faces: ArrayLike, links: ArrayLike, source: int) -> Array:
    """(V,) distances along faces (F, 3) and links (L, 2) of vertices (V, 3) from one of them; infinite where cut off.

    Source: Novotni and Klein, "Computing geodesic distances on triangular meshes", 2002.
    """
    points = np.asarray(vertices, np.float64)
    triangles = np.asarray(faces, np.int64).reshape(-1, 3)
    pairs = np.asarray(links, np.int64).reshape(-1, 2)
    distance = np.full(len(points), np.inf)
    passed = np.zeros(len(points), bool)
    distance[source] = 0.0
    front = [(0.0, source)]

    def length(a: int, b: int) -> float:
        return float(np.linalg.norm(points[a] - points[b]))

    def offer(vertex: int, value: float) -> None:
        if not passed[vertex] and value < distance[vertex]:
            distance[vertex] = value
            heapq.heappush(front, (value, vertex))

    while front:
        here, vertex = heapq.heappop(front)
        if passed[vertex]:
            continue
        passed[vertex] = True
        for corners in triangles[(triangles == vertex).any(axis=1)]:
            turned = np.roll(corners, -int(np.argmax(corners == vertex)))
            for x, y in (turned[1:], turned[:0:-1]):
                offer(x, here + length(vertex, x))
                if passed[y]:
                    sides = length(vertex, y), length(vertex, x), length(y, x)
                    offer(x, _across_triangle(here, distance[y], *sides))
        for a, b in pairs[(pairs == vertex).any(axis=1)]:
            offer(b if a == vertex else a, here + length(a, b))
    return distance


def _across_triangle(a: float, b: float, side: float, to_a: float, to_b: float) -> float:
    """Distance of a triangle's third corner from a point in its plane, `a` and `b` away from the ends of `side`."""
    if side == 0:
        return np.inf
    source = (a * a - b * b + side * side) / (2 * side)
    corner = (to_a * to_a - to_b * to_b + side * side) / (2 * side)
    below, above = a * a - source**2, max(to_a * to_a - corner**2, 0.0)
    if below < 0 or below + above == 0:
        return np.inf
    height = below**0.5 + above**0.5
    crossing = source + (corner - source) * below**0.5 / height
    return float(np.hypot(corner - source, height)) if 0 <= crossing <= side else np.inf
