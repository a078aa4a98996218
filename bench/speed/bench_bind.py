"""Suite for asv: binding."""

from __future__ import annotations

import numpy as np

import dfd

from .machine import reading
from .made_input import make_input

VERTICES = 500_000


class Bind:
    """Compact features, so many handles."""

    params = (1, 10, 100)
    param_names = ("handles",)

    def setup(self, handles: int) -> None:
        """Make the input and a place for the weights."""
        self.made = make_input(VERTICES)
        self.handles = self.made.handles(handles)
        self.out = np.empty((VERTICES, handles), np.float32)
        self.read = reading(self.made.compact.blocks)

    def time_bind(self, handles: int) -> None:
        """Weights into an array that is there already."""
        dfd.bind(self.made.compact, self.handles, out=self.out)

    def time_read_ceiling(self, handles: int) -> None:
        """Reading the same bytes."""
        self.read()


class Constrained:
    """Ten handles, three fixed points, and locality by distances in float32 or float16."""

    params = ("float32", "float16")
    param_names = ("distances",)

    def setup(self, distances: str) -> None:
        """Make the input, distances and a place for the weights."""
        self.made = make_input(VERTICES)
        self.geodesic = np.random.default_rng(0).random((10, VERTICES), dtype=np.float32).astype(distances)
        self.out = np.empty((VERTICES, 10), np.float32)

    def time_bind(self, distances: str) -> None:
        """Everything in one pass."""
        dfd.bind(
            self.made.compact,
            self.made.handles(10),
            fixed=[1, 2, 3],
            geodesic=self.geodesic,
            locality=2.0,
            out=self.out,
        )


class Full:
    """Full float32 features, read where they lie."""

    params = (1, 10)
    param_names = ("handles",)

    def setup(self, handles: int) -> None:
        """Make a tenth of the vertices' features."""
        made = make_input(VERTICES)
        self.features = made.features(VERTICES // 10)
        self.handles = np.arange(handles)
        self.out = np.empty((len(self.features), handles), np.float32)

    def time_bind(self, handles: int) -> None:
        """Weights into an array that is there already."""
        dfd.bind(self.features, self.handles, out=self.out)
