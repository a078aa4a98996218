"""Suite for asv: evaluating a field."""

from __future__ import annotations

import numpy as np

from .made_input import mirrored_field


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
