"""The fit: a field follows the gradient towards targets at points (paper, Eq. 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.common.progress import Stages
from dfd.distillation.fit_on_kernels import fit_on_kernels
from dfd.distillation.targets import PointTargets, Targets
from dfd.field.field import Field

# torch takes seconds to import; the fit to points on a processor does without.
if TYPE_CHECKING:
    import torch

    from dfd.distillation.settings import DistillSettings
    from dfd.runs.fit_state import FitState

__all__ = ["fit", "widen"]


def fit(
    targets: Targets,
    settings: DistillSettings,
    *,
    center: NDArray[np.float64],
    scale: float,
    device: str | torch.device,
    stages: Stages,
    state: FitState | None = None,
) -> Field:
    """Return a field fitted to `targets`, with the loss of every step in its settings.

    Every step follows the gradient of the mean of ‖Φ(P) − Z‖² over a batch, with Adam under a one-cycle rate: by our
    own kernels where the targets are points that are known from the start and a processor computes, else by torch.

    Parameters
    ----------
    center, scale
        The normalization that the points have gone through, which the field will do.
    device
        Where it is computed.
    state
        Where the run is kept while it lasts, and taken up again.

    Raises
    ------
    ValueError
        If the loss leaves the finite numbers.
    """
    parameters: dict[str, Any]
    if isinstance(targets, PointTargets) and str(device) == "cpu":
        parameters, losses = fit_on_kernels(targets, settings, stages=stages, state=state)
    else:
        import torch

        from dfd.distillation.fit_on_torch import fit_on_torch

        parameters, losses = fit_on_torch(targets, settings, device=torch.device(device), stages=stages, state=state)
    if not all(np.isfinite(values).all() for values in parameters.values()):
        rate = settings.learning_rate
        raise ValueError(f"distill: `learning_rate` {rate:g} is too high: the fit left the finite numbers")
    return Field(parameters, octaves=settings.octaves, center=center, scale=scale, settings={"losses": losses})


def widen(field: Field, directions: NDArray[np.float32]) -> Field:
    """Return the field whose features are those of `field` (width d) times `directions` (d, D): of width D.

    The directions are orthonormal, so that lengths stay as they are, and the last layer can do it.
    """
    last = field.architecture.layer_names().linear[-1]
    turned = {name: directions.T @ field.parameters[name] for name in (f"{last}.weight", f"{last}.bias")}
    return Field(
        {**field.parameters, **turned},
        octaves=field.architecture.octaves,
        center=field.center,
        scale=field.scale,
        settings=field.settings,
        pieces=None if field.pieces is None else field.pieces.widened(directions),
    )
