"""The slow twin of each kernel: the paper's equations in NumPy and float64, written to be read.

Tests hold the kernels to these; nothing else calls them. Arguments are taken as they come, without checks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.symmetry.plane import SymmetryPlane

__all__ = [
    "blend",
    "feature_weights",
    "field",
    "geodesic_falloff",
    "mirrored_blend",
    "positive_share",
    "subtract_fixed",
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


def field(network: Field, points: ArrayLike) -> Array:
    """(N, D) unit features of points (N, 3) in mesh units: the multilayer perceptron of the paper's supplement L."""
    # Rounded as the network's own input is: the shortest waves turn what is lost there into something to be seen.
    x = ((np.asarray(points, np.float64) - network.center) * network.scale).astype(np.float32).astype(np.float64)
    angles = [np.pi / 2 * 2**octave * x for octave in range(network.architecture.octaves)]
    x = np.concatenate([x, *[wave for angle in angles for wave in (np.sin(angle), np.cos(angle))]], axis=1)
    names = network.architecture.layer_names()
    of = {name: np.asarray(values, np.float64) for name, values in network.parameters.items()}
    for linear, norm in zip(names.linear, names.norms, strict=False):
        x = np.maximum(x @ of[f"{linear}.weight"].T + of[f"{linear}.bias"], 0.0)
        x = (x - x.mean(axis=1, keepdims=True)) / np.sqrt(x.var(axis=1, keepdims=True) + 1e-5)
        x = x * of[f"{norm}.weight"] + of[f"{norm}.bias"]
    x = x @ of[f"{names.linear[-1]}.weight"].T + of[f"{names.linear[-1]}.bias"]
    features: Array = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    return features
