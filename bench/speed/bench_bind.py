"""Benchmarks for asv: bind handles, and make the compact features that `bind` reads."""

import numpy as np

import dfd

from .made_input import VERTICES, MadeInput, make_input


def setup_cache() -> MadeInput:
    """Make the input once for all benchmarks."""
    return make_input()


class Bind:
    """Bind 1, 10 and 100 handles to compact features, without and with fixed points and locality."""

    params = ((1, 10, 100), (False, True))
    param_names = ("handles", "constrained")

    def setup(self, made: MadeInput, handles: int, constrained: bool) -> None:
        """Allocate the weights."""
        self.call = made.binding(handles, constrained=constrained)

    def time_bind(self, made: MadeInput, handles: int, constrained: bool) -> None:
        """Bind once."""
        self.call()


class Full:
    """Bind 1 and 10 handles to the full float32 features of a tenth of the vertices."""

    params = (1, 10)
    param_names = ("handles",)

    def setup(self, made: MadeInput, handles: int) -> None:
        """Make the features, and allocate the weights."""
        self.features = made.features(VERTICES // 10)
        self.handles = np.arange(handles)
        self.out = np.empty((len(self.features), handles), np.float32)

    def time_bind(self, made: MadeInput, handles: int) -> None:
        """Bind once."""
        dfd.bind(self.features, self.handles, out=self.out)


class Compact:
    """Make compact features from full features."""

    params = (20_000, 100_000)
    param_names = ("vertices",)

    def setup(self, made: MadeInput, vertices: int) -> None:
        """Make the full features."""
        self.features = made.features(vertices)

    def time_compact(self, made: MadeInput, vertices: int) -> None:
        """Make the compact features once."""
        dfd.compact(self.features)
