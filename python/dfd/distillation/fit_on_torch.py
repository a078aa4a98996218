"""The fit by torch: of targets of any kind, on any device."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from dfd.common.progress import Stages
from dfd.common.torch_threads import one_thread
from dfd.field.architecture import Architecture
from dfd.field.network import Network

if TYPE_CHECKING:
    from dfd.distillation.settings import DistillSettings
    from dfd.distillation.targets import Targets
    from dfd.runs.fit_state import FitState, Stateful

__all__ = ["fit_on_torch"]


def fit_on_torch(
    targets: Targets,
    settings: DistillSettings,
    *,
    device: torch.device,
    stages: Stages,
    state: FitState | None = None,
) -> tuple[dict[str, NDArray[np.float32]], list[float]]:
    """Return a network's parameters and the loss of every step; see `dfd.distillation.fit.fit`.

    On a processor it is one thread's work: steps are many and small, and two threads would wait for each other longer
    than they save.
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
    return network.arrays(), values
