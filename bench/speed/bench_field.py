"""Benchmarks for asv: evaluate a field, find mirror planes, and compute distances along the surface."""

import numpy as np

import dfd

from .made_input import mirrored_field, torus


class Evaluate:
    """Evaluate a field whose network has the default size."""

    params = (1_000, 50_000)
    param_names = ("points",)

    def setup(self, points: int) -> None:
        """Make the field and the points."""
        self.field = mirrored_field()
        self.points = np.random.default_rng(0).uniform(-1, 1, (points, 3))

    def time_evaluate(self, points: int) -> None:
        """Evaluate all points."""
        self.field(self.points)


class Symmetry:
    """Find the mirror planes of a surface that equals its mirror image."""

    def setup(self) -> None:
        """Make the mesh, and a field with equal features on both sides."""
        self.mesh = torus(20_000)
        self.field = mirrored_field()

    def time_planes(self) -> None:
        """Find all mirror planes."""
        dfd.symmetry_planes(self.mesh, self.field)


class Geodesics:
    """Compute distances along a closed surface."""

    params = (20_000, 200_000)
    param_names = ("faces",)

    def setup(self, faces: int) -> None:
        """Make the mesh, and prepare its distances."""
        self.mesh = torus(faces)
        self.geodesics = dfd.Geodesics(self.mesh)
        self.geodesics.prepare()
        self.handles = np.linspace(0, len(self.mesh.vertices) - 1, 10).astype(np.int64)

    def time_prepare(self, faces: int) -> None:
        """Prepare the distances of a mesh."""
        dfd.Geodesics(self.mesh).prepare()

    def time_one_handle(self, faces: int) -> None:
        """Compute the distances of all vertices from one handle."""
        self.geodesics.distances(self.handles[:1])

    def time_ten_handles(self, faces: int) -> None:
        """Compute the distances of all vertices from ten handles."""
        self.geodesics.distances(self.handles)
