"""The steps of a fit: a field follows the gradient towards targets at points (paper, Eq. 3)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from dfd.common.progress import Stages
from dfd.common.torch_threads import one_thread
from dfd.field.field import Field

if TYPE_CHECKING:
    from dfd.runs.checkpoint import FitState, Stateful

__all__ = ["descend"]


def descend(
    field: Field,
    draw: Callable[[], tuple[Tensor, Tensor]],
    *,
    steps: int,
    learning_rate: float,
    generator: torch.Generator,
    stages: Stages,
    state: FitState | None = None,
) -> list[float]:
    """Fit `field` in place; return the loss of every step.

    Every step follows the gradient of the mean of ‖Φ(P) − Z‖² over what `draw` gives, with Adam under a one-cycle rate.
    On a processor it is one thread's work: steps are many and small, and two threads would wait for each other longer
    than they save.

    Parameters
    ----------
    draw
        Gives the points P (B, 3) of a step, normalised, and their unit targets Z (B, D), on the field's device.
    generator
        All that `draw` draws with.
    state
        Where the run is kept while it lasts, and taken up again.

    Raises
    ------
    ValueError
        If the loss leaves the finite numbers.
    """
    optimizer = torch.optim.Adam(field.parameters(), lr=learning_rate, fused=True)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, learning_rate, total_steps=max(steps, 2))
    parts: dict[str, Stateful] = {"network": field.network, "optimizer": optimizer, "schedule": schedule}
    losses = state.restore(parts, generator) if state else []
    field.train()
    alone = one_thread() if field.center.device.type == "cpu" else nullcontext()
    with alone, stages.stage("fit", steps) as advance:
        advance(len(losses))
        for _ in range(len(losses), steps):
            points, targets = draw()
            loss = (field.from_normalized(points) - targets).square().sum(dim=1).mean()
            optimizer.zero_grad(set_to_none=True)
            torch.autograd.backward(loss)
            optimizer.step()
            schedule.step()
            losses.append(loss.detach())
            if state is not None:
                state.keep(losses, parts, generator)
            advance()
    field.eval().requires_grad_(False)
    values: list[float] = torch.stack([loss.cpu() for loss in losses]).tolist() if losses else []
    if not all(torch.isfinite(parameter).all() for parameter in field.parameters()):
        raise ValueError(f"distill: `learning_rate` {learning_rate:g} is too high: the fit left the finite numbers")
    return values
