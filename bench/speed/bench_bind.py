"""Suite for asv: binding, and the compact features that it reads."""

from __future__ import annotations

import numpy as np

import dfd

from .made_input import MadeInput, make_input

VERTICES = 500_000


def setup_cache() -> MadeInput:
    """Make the input once for all of them."""
    return make_input(VERTICES)


class Bind:
    """Compact features, so many handles."""

    params = (1, 10, 100)
    param_names = ("handles",)

    def setup(self, made: MadeInput, handles: int) -> None:
        """Allocate the weights."""
        self.handles = made.handles(handles)
        self.out = np.empty((VERTICES, handles), np.float32)

    def time_bind(self, made: MadeInput, handles: int) -> None:
        """Weights into an array that is there already."""
        dfd.bind(made.compact, self.handles, out=self.out)


class Constrained:
    """Ten handles, three fixed points, and locality."""

    def setup(self, made: MadeInput) -> None:
        """Make distances, and allocate the weights."""
        self.handles = made.handles(10)
        self.geodesic = np.random.default_rng(0).random((10, VERTICES), dtype=np.float32)
        self.out = np.empty((VERTICES, 10), np.float32)

    def time_bind(self, made: MadeInput) -> None:
        """Everything in one pass."""
        dfd.bind(made.compact, self.handles, fixed=[1, 2, 3], geodesic=self.geodesic, locality=2.0, out=self.out)


class Full:
    """Full float32 features, read where they lie."""

    params = (1, 10)
    param_names = ("handles",)

    def setup(self, made: MadeInput, handles: int) -> None:
        """Make a tenth of the vertices' features."""
        self.features = made.features(VERTICES // 10)
        self.handles = np.arange(handles)
        self.out = np.empty((len(self.features), handles), np.float32)

    def time_bind(self, made: MadeInput, handles: int) -> None:
        """Weights into an array that is there already."""
        dfd.bind(self.features, self.handles, out=self.out)


class Compact:
    """Full features of so many vertices."""

    params = (20_000, 100_000)
    param_names = ("vertices",)

    def setup(self, made: MadeInput, vertices: int) -> None:
        """Make the features."""
        self.features = made.features(vertices)

    def time_compact(self, made: MadeInput, vertices: int) -> None:
        """Choose dimensions, project and round."""
        dfd.compact(self.features)
