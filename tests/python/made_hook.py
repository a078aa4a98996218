"""Make a shape without symmetry, and a plane that is parallel to no axis, for tests of mirror images."""

import numpy as np
from made_tube import tube

import dfd
from dfd.posing.transforms import rotation_matrix
from dfd.symmetry.plane import SymmetryPlane


def hook() -> dfd.Mesh:
    """Return a bent tube that is its own mirror image in no plane."""
    along = np.linspace(0, 1, 60)
    center = np.stack([along, 0.4 * np.sin(4 * along), 0.5 * along**2 * np.cos(3 * along)], axis=1)
    return tube(center, 0.12 - 0.08 * along)


def plane_of(degrees: float = 0.0, offset: float = 0.8) -> SymmetryPlane:
    """Return a plane that no axis is perpendicular to, tilted by an angle."""
    normal = rotation_matrix((0, 0, degrees)) @ rotation_matrix((15, 40, -25)) @ (1.0, 0.0, 0.0)
    return SymmetryPlane(tuple(normal), offset)
