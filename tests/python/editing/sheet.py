"""A made sheet at any resolution."""

import numpy as np

from dfd.mesh.mesh import Mesh

__all__ = ["grid"]


def grid(size):
    """A wavy sheet of size × size vertices over the unit square, centered on x = 0."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.5, 0.5, size), np.linspace(0, 1, size)))
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + size], 1), np.stack([corner + 1, corner + size + 1, corner + size], 1)]
    )
    return Mesh(np.stack([x, 0.1 * np.cos(3 * x) * z, z], axis=1), faces)
