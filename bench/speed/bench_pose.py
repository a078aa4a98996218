"""Suite for asv: posing and dragging."""

from __future__ import annotations

import numpy as np

import dfd

from .made_input import MadeInput, make_input

VERTICES = 500_000


def setup_cache() -> MadeInput:
    """Make the input once for all of them."""
    return make_input(VERTICES)


class Pose:
    """Vertices in float32 and float64, one handle and a hundred."""

    params = ((1, 100), ("float32", "float64"))
    param_names = ("handles", "type")

    def setup(self, made: MadeInput, handles: int, dtype: str) -> None:
        """Bind, and allocate the vertices."""
        self.weights = dfd.bind(made.compact, made.handles(handles)) / handles
        self.transforms = made.transforms[:handles]
        self.vertices = made.vertices.astype(dtype)
        self.out = np.empty_like(self.vertices)
        self.plane = dfd.SymmetryPlane((1.0, 0.0, 0.0), 0.0, band=0.01)
        self.positions = self.vertices[made.handles(handles)]
        self.drag = dfd.Drag(self.vertices, self.weights, self.transforms, [0])

    def time_pose(self, made: MadeInput, handles: int, dtype: str) -> None:
        """All handles move."""
        dfd.pose(self.vertices, self.weights, self.transforms, out=self.out)

    def time_mirrored(self, made: MadeInput, handles: int, dtype: str) -> None:
        """All handles move, across a plane with a band."""
        dfd.pose(
            self.vertices, self.weights, self.transforms, symmetry=self.plane, handles=self.positions, out=self.out
        )

    def time_drag(self, made: MadeInput, handles: int, dtype: str) -> None:
        """One handle moves, the others rest."""
        self.drag.pose(self.transforms[:1], out=self.out)
