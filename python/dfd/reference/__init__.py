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
from dfd.reference.networks import field, kinds_of_parts

__all__ = [
    "bind",
    "feature_weights",
    "field",
    "geodesic_falloff",
    "kinds_of_parts",
    "pose",
    "positive_share",
    "subtract_fixed",
    "surface_distances",
]
