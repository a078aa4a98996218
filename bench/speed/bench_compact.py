"""Suite for asv: compact features."""

from __future__ import annotations

import dfd

from .made_input import make_input


class Compact:
    """Full features of so many vertices."""

    params = (20_000, 100_000)
    param_names = ("vertices",)

    def setup(self, vertices: int) -> None:
        """Make the features."""
        self.features = make_input(vertices).features()

    def time_compact(self, vertices: int) -> None:
        """Choose dimensions, project and round."""
        dfd.compact(self.features)
