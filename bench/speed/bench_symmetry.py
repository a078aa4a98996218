"""Suite for asv: mirror planes and rotations."""

from __future__ import annotations

import dfd

from .made_input import mirrored_field, torus


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
