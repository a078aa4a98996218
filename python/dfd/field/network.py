"""Evaluate a field's network in torch, for fits and for gradients; all other evaluations use the C++ kernel."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from dfd.common.linear_algebra import Float32
from dfd.field.architecture import Architecture


class Network(nn.Module):
    """A map from normalized points (N, 3) to features (N, D), with the parameters of `dfd.field.architecture`.

    The parameters of the linear maps have no values until `draw` is called. `of` returns a network with known values.
    """

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.architecture = architecture
        hidden: list[nn.Module] = []
        for layer in range(architecture.layers):
            entering = architecture.width if layer else architecture.inputs
            hidden += [_linear(entering, architecture.width), nn.ReLU(), nn.LayerNorm(architecture.width)]
        self.network = nn.Sequential(*hidden, _linear(architecture.width, architecture.dimension))

    def draw(self, generator: torch.Generator) -> Network:
        """Draw the linear maps' parameters with a CPU `generator`, uniformly in [−1 / √n, 1 / √n] for n inputs."""
        with torch.no_grad():
            for layer in self.network:
                if isinstance(layer, nn.Linear):
                    bound = 1 / math.sqrt(layer.in_features)
                    for part in (layer.weight, layer.bias):
                        part.uniform_(-bound, bound, generator=generator)
        return self

    @classmethod
    def of(cls, parameters: Mapping[str, Float32], architecture: Architecture) -> Network:
        """Return the network with these `parameters`; torch computes no gradients for them."""
        network = cls(architecture)
        state = {name: torch.tensor(values) for name, values in parameters.items()}
        network.load_state_dict(state, assign=True)
        return network.requires_grad_(False)

    def forward(self, points: Tensor) -> Tensor:
        """Return the float32 features (N, D) of `points` (N, 3); the features are differentiable in `points`."""
        waves = [points]
        for octave in range(self.architecture.octaves):
            angle = points * (math.pi / 2 * 2**octave)
            waves += [angle.sin(), angle.cos()]
        return nn.functional.normalize(self.network(torch.cat(waves, dim=-1)), dim=-1)

    def arrays(self) -> dict[str, Float32]:
        """Return the parameters by name, for `Field`."""
        return {name: values.detach().cpu().numpy() for name, values in self.state_dict().items()}


def _linear(entering: int, leaving: int) -> nn.Linear:
    """Return a linear map without values; `nn.Linear` itself would draw values from torch's global generator."""
    return nn.utils.skip_init(nn.Linear, entering, leaving)  # type: ignore[no-untyped-call]
