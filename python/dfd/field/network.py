"""A field's network in torch, to be fitted and to pass gradients through; a field itself needs no torch."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dfd.field.architecture import Architecture

__all__ = ["Network"]


class Network(nn.Module):
    """Normalized points (N, 3) to unit features (N, D), with the parameters of `dfd.field.architecture`."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        hidden: list[nn.Module] = []
        for layer in range(architecture.layers):
            entering = architecture.width if layer else architecture.inputs
            hidden += [nn.Linear(entering, architecture.width), nn.ReLU(), nn.LayerNorm(architecture.width)]
        self.network = nn.Sequential(*hidden, nn.Linear(architecture.width, architecture.dimension))

    @classmethod
    def seeded(cls, seed: int, architecture: Architecture) -> Network:
        """Return a network with the initial weights of `seed`; the caller's own random numbers stay as they were."""
        with torch.random.fork_rng(devices=()):
            torch.manual_seed(seed)
            return cls(architecture)

    @classmethod
    def of(cls, parameters: Mapping[str, NDArray[np.float32]], architecture: Architecture) -> Network:
        """Return the network with these parameters, which are not fitted any further."""
        with torch.device("meta"):  # no initial weights are drawn
            network = cls(architecture)
        state = {name: torch.tensor(values) for name, values in parameters.items()}
        network.load_state_dict(state, assign=True)
        return network.requires_grad_(False)

    def forward(self, points: Tensor) -> Tensor:
        """Features of (N, 3) float32 points; differentiable in them."""
        waves = [points]
        for octave in range(self.architecture.octaves):
            angle = points * (math.pi / 2 * 2**octave)
            waves += [angle.sin(), angle.cos()]
        return nn.functional.normalize(self.network(torch.cat(waves, dim=-1)), dim=-1)

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """The parameters, as a field takes them."""
        return {name: values.detach().cpu().numpy() for name, values in self.state_dict().items()}
