"""The slow twin of each kernel: the paper's equations in NumPy and float64, written to be read.

Tests hold the kernels to these; nothing else calls them. Arguments are taken as they come, without checks.
"""

from dfd.reference.deformation import (
    bind,
    feature_weights,
    geodesic_falloff,
    pose,
    positive_share,
    subtract_fixed,
    surface_distances,
)
from dfd.reference.networks import field, fit_gradients, kinds_of_parts
from dfd.reference.shading import blend, facing, paint, ray_directions

__all__ = [
    "bind",
    "blend",
    "facing",
    "feature_weights",
    "field",
    "fit_gradients",
    "geodesic_falloff",
    "kinds_of_parts",
    "paint",
    "pose",
    "positive_share",
    "ray_directions",
    "subtract_fixed",
    "surface_distances",
]
