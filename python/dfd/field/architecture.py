"""Define the sizes of a field's neural network, and the names and array shapes of its parameters.

The names are those in a torch `Sequential` of linear maps, ReLUs and LayerNorms. Layer k, counted from 0, has the
linear map `network.{3 k}`. A hidden layer k also has the LayerNorm `network.{3 k + 2}`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dfd.common import check
from dfd.common.errors import ArgumentError


@dataclass(frozen=True)
class Architecture:
    """The sizes of a field's network."""

    dimension: int  # dimension D of a feature
    width: int = 256  # number of neurons of a hidden layer
    layers: int = 4  # number of hidden layers
    octaves: int = 0  # number of octaves of the positional encoding: sines and cosines of coordinates as further inputs

    def __post_init__(self) -> None:
        """Check the sizes."""
        for name in ("dimension", "width", "layers"):
            check.whole("Field", name, getattr(self, name), minimum=1)
        check.whole("Field", "octaves", self.octaves, minimum=0, maximum=check.MOST_OCTAVES)

    @classmethod
    def of(cls, parameters: Mapping[str, ArrayLike], octaves: int) -> Architecture:
        """Return the architecture of a network with these `parameters` and this number of `octaves`.

        Raises ValueError if a parameter is missing or unknown, or has the wrong array shape.
        """
        found = {name: np.shape(values) for name, values in parameters.items()}
        layers = (len(found) - 2) // 4
        last, first = found.get(f"network.{3 * layers}.weight", ()), found.get("network.0.weight", ())
        if layers < 1 or len(found) != 4 * layers + 2 or len(last) != 2 or len(first) != 2:
            raise ArgumentError("parameters", f"must be those of a network, got {_listed(found) or 'none'}", "Field")
        architecture = cls(int(last[0]), int(first[0]), layers, octaves)
        wanted = architecture.shapes()
        odd = [name for name in wanted if found.get(name) != wanted[name]]
        if odd:
            have = {name: found[name] for name in odd if name in found}
            needed = _listed({name: wanted[name] for name in odd})
            raise ArgumentError("parameters", f"must hold {needed}, got {_listed(have) or 'nothing'}", "Field")
        return architecture

    @property
    def inputs(self) -> int:
        """Return the number of inputs of the network."""
        return 3 + 6 * self.octaves

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the array shape of each parameter by name. Each linear map and LayerNorm has a weight and a bias."""
        shapes: dict[str, tuple[int, ...]] = {}
        for layer in range(self.layers + 1):
            name, entering = f"network.{3 * layer}", self.width if layer else self.inputs
            leaving = self.width if layer < self.layers else self.dimension
            shapes |= {f"{name}.weight": (leaving, entering), f"{name}.bias": (leaving,)}
            if layer < self.layers:
                shapes |= {f"network.{3 * layer + 2}.{part}": (self.width,) for part in ("weight", "bias")}
        return shapes


def _listed(shapes: Mapping[str, tuple[int, ...]]) -> str:
    some = [f"{name} {shape}" for name, shape in list(shapes.items())[:4]]
    return ", ".join(some) + (", …" if len(shapes) > 4 else "")
