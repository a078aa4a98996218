"""Suite for asv: evaluating a field, and what it says of symmetry."""

from __future__ import annotations

import numpy as np

import dfd

from .made_input import mirrored_field, torus


class Evaluate:
    """A network of the usual size."""

    params = (1_000, 50_000)
    param_names = ("points",)

    def setup(self, points: int) -> None:
        """Make the field and the points."""
        self.field = mirrored_field()
        self.points = np.random.default_rng(0).uniform(-1, 1, (points, 3))

    def time_evaluate(self, points: int) -> None:
        """Features of all points."""
        self.field(self.points)


class Symmetry:
    """A surface that is its own mirror image."""

    def setup(self) -> None:
        """Make the mesh and a field that sees both sides alike."""
        self.mesh = dfd.Mesh(*torus(20_000))
        self.field = mirrored_field()

    def time_planes(self) -> None:
        """All mirror planes."""
        dfd.symmetry_planes(self.field, self.mesh)

    def time_rotations(self) -> None:
        """All rotations."""
        dfd.rotational_symmetries(self.field, self.mesh)
