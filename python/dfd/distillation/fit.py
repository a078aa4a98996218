"""The fit: a field follows the gradient towards targets at points (paper, Eq. 3), in torch on every device."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from dfd.common.parallel import share
from dfd.common.progress import Stages
from dfd.common.torch_threads import one_thread
from dfd.field.architecture import Architecture
from dfd.field.field import Field
from dfd.field.network import Network

if TYPE_CHECKING:
    from torch.optim.lr_scheduler import LRScheduler

    from dfd.distillation.settings import DistillSettings
    from dfd.distillation.targets import Targets

__all__ = ["fit", "widen"]

_LEAST_PART, _MOST_PARTS = 192, 8  # points of a batch that a thread takes, and how many such parts there are


def fit(
    targets: Targets,
    settings: DistillSettings,
    *,
    center: NDArray[np.float64],
    scale: float,
    device: str | torch.device,
    stages: Stages,
) -> Field:
    """Return a field fitted to `targets`, with the loss of every step in its settings.

    Every step follows the gradient of the mean of ‖Φ(P) − Z‖² over a batch, with Adam. All that is random, the
    network's first parameters and the points of each step, comes from one generator on the CPU, so that a seed means
    the same on every device; what differs is the order in which a device adds, to about 1e-3 of a feature.

    Parameters
    ----------
    center, scale
        The normalization that the points have gone through, which the field will do.
    device
        Where it is computed: on the CPU with as many threads as the kernels use, to the same bits for any number.

    Raises
    ------
    ValueError
        If the loss leaves the finite numbers.
    """
    architecture = Architecture(
        targets.dimension, width=settings.width, layers=settings.layers, octaves=settings.octaves
    )
    generator = torch.Generator().manual_seed(settings.seed)
    network = Network(architecture).draw(generator).to(device)
    batches, steps = _batches(targets, settings, generator)
    optimizer = torch.optim.Adam(network.parameters(), lr=settings.learning_rate, fused=True)
    schedule = _schedule(optimizer, settings, steps)
    losses: list[torch.Tensor] = []
    with _exact_float32(), one_thread(), stages.stage("fit", steps) as advance:
        for points, wanted in batches:
            losses.append(_set_gradients(network, points.to(device), wanted.to(device)))
            optimizer.step()
            schedule.step()
            advance()
    parameters = network.arrays()
    if not all(np.isfinite(values).all() for values in parameters.values()):
        rate = settings.learning_rate
        raise ValueError(f"distill: `learning_rate` {rate:g} is too high: the fit left the finite numbers")
    told = {"losses": torch.stack(losses).tolist()}
    return Field(parameters, octaves=settings.octaves, center=center, scale=scale, settings=told)


def _set_gradients(network: Network, points: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Set the gradients of the mean of ‖Φ(P) − Z‖² over a batch, (B, 3) points and (B, d) targets; return that mean.

    On the CPU each thread takes parts of the batch, whose gradients are added in order: torch's own threads wait for
    each other many times in a step, which on a busy machine takes twenty times as long.
    """
    parameters = list(network.parameters())
    size = len(points) if points.is_cuda else max(_LEAST_PART, -(-len(points) // _MOST_PARTS))
    parts = [(points[begin : begin + size], wanted[begin : begin + size]) for begin in range(0, len(points), size)]
    found: list[tuple[torch.Tensor, ...]] = [()] * len(parts)

    def differentiate(begin: int, end: int) -> None:
        torch.set_num_threads(1)  # it counts for each thread apart
        for part in range(begin, end):
            some, their = parts[part]
            loss = (network(some) - their).square().sum() / len(points)
            found[part] = (loss.detach(), *torch.autograd.grad(loss, parameters))

    share(len(parts), 1, differentiate)
    loss: torch.Tensor
    loss, *gradients = (functools.reduce(torch.add, each) for each in zip(*found, strict=True))
    for parameter, gradient in zip(parameters, gradients, strict=True):
        parameter.grad = gradient
    return loss


def _batches(
    targets: Targets, settings: DistillSettings, generator: torch.Generator
) -> tuple[Iterator[tuple[torch.Tensor, torch.Tensor]], int]:
    """Points and targets of every step, and how many steps there are.

    Either so many `steps` of points drawn at random, or so many `epochs`, in each of which every point comes once.
    """
    batch = settings.batch
    if settings.steps is not None:
        return (targets.draw(batch, generator) for _ in range(settings.steps)), settings.steps

    def shuffled(epochs: int) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        for _ in range(epochs):
            order = torch.randperm(len(targets.points), generator=generator)
            for chosen in order.split(batch):  # type: ignore[no-untyped-call]
                yield targets.at(chosen)

    assert settings.epochs is not None
    return shuffled(settings.epochs), settings.epochs * math.ceil(len(targets.points) / batch)


def _schedule(optimizer: torch.optim.Optimizer, settings: DistillSettings, steps: int) -> LRScheduler:
    """The rate of every step: constant, or up to its peak and down again (Smith and Topin 2019)."""
    if settings.schedule == "constant":
        return torch.optim.lr_scheduler.ConstantLR(optimizer, factor=1.0)
    return torch.optim.lr_scheduler.OneCycleLR(optimizer, settings.learning_rate, total_steps=max(steps, 2))


@contextmanager
def _exact_float32() -> Iterator[None]:
    """Let torch multiply in float32, not in fewer bits, and then as before."""
    precision = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision("highest")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(precision)


def widen(field: Field, directions: NDArray[np.float32]) -> Field:
    """Return the field whose features are those of `field` (width d) times `directions` (d, D): of width D.

    The directions are orthonormal, so that lengths stay as they are, and the last layer can do it.
    """
    last = field.architecture.layer_names().linear[-1]
    turned: dict[str, Any] = {
        name: directions.T @ field.parameters[name] for name in (f"{last}.weight", f"{last}.bias")
    }
    return Field(
        {**field.parameters, **turned},
        octaves=field.architecture.octaves,
        center=field.center,
        scale=field.scale,
        settings=field.settings,
        pieces=None if field.pieces is None else field.pieces.widened(directions),
    )
