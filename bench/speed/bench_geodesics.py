"""Suite for asv: distances along the surface."""

from __future__ import annotations

import numpy as np

import dfd

from .made_input import torus


class Geodesics:
    """A closed surface of so many faces."""

    params = (20_000, 200_000)
    param_names = ("faces",)

    def setup(self, faces: int) -> None:
        """Prepare what handles are measured with."""
        self.mesh = dfd.Mesh(*torus(faces))
        self.geodesics = dfd.Geodesics(self.mesh)
        self.geodesics.prepare()
        self.handles = np.linspace(0, len(self.mesh.vertices) - 1, 10).astype(np.int64)

    def time_prepare(self, faces: int) -> None:
        """What comes before the first handle."""
        dfd.Geodesics(self.mesh).prepare()

    def time_one_handle(self, faces: int) -> None:
        """Distances of all vertices from one handle."""
        self.geodesics.distances(self.handles[:1])

    def time_ten_handles(self, faces: int) -> None:
        """Distances of all vertices from ten handles."""
        self.geodesics.distances(self.handles)
