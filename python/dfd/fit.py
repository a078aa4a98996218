"""Fitting a field to the tokens of all views: the loss of Eq. 3 over surface points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from dfd.descent import descend
from dfd.field import Field
from dfd.progress import Stages

if TYPE_CHECKING:
    from dfd.checkpoint import FitState

__all__ = ["Samples", "fit"]


@dataclass(frozen=True)
class Samples:
    """Surface points, and the place in an image where each is seen.

    Attributes
    ----------
    points
        (P, 3) float32, normalised coordinates.
    view
        (P,) index of the image.
    row, column
        (P,) pixel coordinates; whole numbers are pixel centres.
    """

    points: NDArray[np.float32]
    view: NDArray[np.integer]
    row: NDArray[np.floating | np.integer]
    column: NDArray[np.floating | np.integer]

    def __len__(self) -> int:
        """Number of points P."""
        return len(self.points)


def fit(
    field: Field,
    samples: Samples,
    tokens: NDArray[np.float32],
    resolution: int,
    *,
    steps: int,
    batch: int,
    learning_rate: float,
    generator: torch.Generator,
    stages: Stages,
    state: FitState | None = None,
) -> list[float]:
    """Fit `field` in place to `tokens` at `samples`; return the loss of every step.

    Every step draws `batch` of the points at random, blends each one's target from the four tokens around it and
    follows the gradient of the mean of ‖Φ(P) − Z/‖Z‖‖² (Eq. 3) with Adam under a one-cycle rate.

    Parameters
    ----------
    tokens
        (views, h, w, D), the grids that the encoder gave for square images.
    resolution
        Pixels along an image's side: the unit of `samples.row` and `samples.column`.
    steps, batch, learning_rate
        Length of the fit, points per step, and the peak of the one-cycle rate.
    generator
        Draws the points; on the CPU whatever the field's device.
    state
        Where the run is kept while it lasts, and taken up again.
    """
    device = field.center.device
    points = torch.from_numpy(samples.points).to(device)
    corners = TokenGrid(tokens, samples, resolution, device)

    def draw() -> tuple[torch.Tensor, torch.Tensor]:
        chosen = torch.randint(len(samples), (batch,), generator=generator).to(device)
        return points[chosen], corners.at(chosen)

    return descend(
        field, draw, steps=steps, learning_rate=learning_rate, generator=generator, stages=stages, state=state
    )


class TokenGrid:
    """Tokens read between their places, bilinearly: a patch's token stands at the centre of the patch."""

    def __init__(self, tokens: NDArray[np.float32], samples: Samples, resolution: int, device: torch.device) -> None:
        views, self._height, self._width, dimension = tokens.shape
        self._table = torch.from_numpy(tokens.reshape(views * self._height * self._width, dimension)).to(device)
        self._view = torch.from_numpy(samples.view.astype(np.int64)).to(device)
        self._row = torch.from_numpy(samples.row.astype(np.float32)).to(device)
        self._column = torch.from_numpy(samples.column.astype(np.float32)).to(device)
        self._resolution = resolution

    def at(self, chosen: torch.Tensor) -> torch.Tensor:
        """Unit targets Z/‖Z‖ of the chosen samples, (B, D)."""
        top, lower = self._between(self._row[chosen], self._height)
        left, right = self._between(self._column[chosen], self._width)
        bottom, after = (top + 1).clamp_(max=self._height - 1), (left + 1).clamp_(max=self._width - 1)
        first = self._view[chosen] * self._height
        indices = torch.stack(
            [(first + y) * self._width + x for y, x in ((top, left), (top, after), (bottom, left), (bottom, after))], 1
        )
        shares = torch.stack([(1 - lower) * (1 - right), (1 - lower) * right, lower * (1 - right), lower * right], 1)
        blended = nn.functional.embedding_bag(indices, self._table, per_sample_weights=shares, mode="sum")
        return nn.functional.normalize(blended, dim=1)

    def _between(self, pixel: torch.Tensor, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        place = ((pixel + 0.5) * (count / self._resolution) - 0.5).clamp_(0, count - 1)
        before = place.floor()
        return before.long(), place - before
