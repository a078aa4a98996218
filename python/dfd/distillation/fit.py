"""The fit: a field follows the gradient towards targets at points (paper, Eq. 3)."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dfd.common.progress import Stages
from dfd.common.torch_threads import one_thread
from dfd.field.architecture import Architecture
from dfd.field.field import Field
from dfd.field.network import Network

if TYPE_CHECKING:
    from dfd.distillation.settings import DistillSettings
    from dfd.runs.fit_state import FitState, Stateful

__all__ = ["Targets", "fit", "widen"]


class Targets(Protocol):
    """Points, normalized, and what a field should give there."""

    @property
    def dimension(self) -> int:
        """Length d of a target."""

    def draw(self, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """`count` points at random, (count, 3), and their unit targets, (count, d)."""


def fit(
    targets: Targets,
    settings: DistillSettings,
    *,
    center: NDArray[np.float64],
    scale: float,
    device: torch.device,
    stages: Stages,
    state: FitState | None = None,
) -> Field:
    """Return a field fitted to `targets`, with the loss of every step in its settings.

    Every step follows the gradient of the mean of ‖Φ(P) − Z‖² over a batch, with Adam under a one-cycle rate. On a
    processor it is one thread's work: steps are many and small, and two threads would wait for each other longer than
    they save.

    Parameters
    ----------
    center, scale
        The normalization that the points have gone through, which the field will do.
    device
        Where torch computes.
    state
        Where the run is kept while it lasts, and taken up again.

    Raises
    ------
    ValueError
        If the loss leaves the finite numbers.
    """
    steps, learning_rate = settings.steps, settings.learning_rate
    generator = torch.Generator().manual_seed(settings.seed)
    network = Network.seeded(settings.seed, Architecture(targets.dimension, octaves=settings.octaves)).to(device)
    optimizer = torch.optim.Adam(network.parameters(), lr=learning_rate, fused=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, learning_rate, total_steps=max(steps, 2))
    parts: dict[str, Stateful] = {"network": network.network, "optimizer": optimizer, "schedule": schedule}
    losses = state.restore(parts, generator, steps) if state else []
    alone = one_thread() if device.type == "cpu" else nullcontext()
    with alone, stages.stage("fit", steps) as advance:
        advance(len(losses))
        for _ in range(len(losses), steps):
            points, wanted = (drawn.to(device) for drawn in targets.draw(settings.batch, generator))
            loss = (network(points) - wanted).square().sum(dim=1).mean()
            optimizer.zero_grad(set_to_none=True)
            torch.autograd.backward(loss)
            optimizer.step()
            schedule.step()
            losses.append(loss.detach())
            if state is not None:
                state.keep(losses, parts, generator)
            advance()
    values: list[float] = torch.stack([loss.cpu() for loss in losses]).tolist() if losses else []
    if not all(torch.isfinite(parameter).all() for parameter in network.parameters()):
        raise ValueError(f"distill: `learning_rate` {learning_rate:g} is too high: the fit left the finite numbers")
    return Field(network.arrays(), octaves=settings.octaves, center=center, scale=scale, settings={"losses": values})


def widen(field: Field, directions: NDArray[np.float32]) -> Field:
    """Return the field whose features are those of `field` (width d) times `directions` (d, D): of width D.

    The directions are orthonormal, so that lengths stay as they are, and the last layer can do it.
    """
    last = field.architecture.layer_names().linear[-1]
    basis = torch.from_numpy(directions).T
    names = [f"{last}.{part}" for part in ("weight", "bias")]
    turned = {name: (basis @ torch.tensor(field.parameters[name])).numpy() for name in names}
    return Field(
        {**field.parameters, **turned},
        octaves=field.architecture.octaves,
        center=field.center,
        scale=field.scale,
        settings=field.settings,
    )
