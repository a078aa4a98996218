"""What a field is fitted to: points and their unit targets (paper, Eq. 3)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import nn

from dfd.views.render import Views

__all__ = ["PixelTargets", "PointTargets"]


class PointTargets:
    """Targets at points: (N, 3) normalized, and (N, d) unit rows.

    `directions` (d, D), orthonormal rows, lead from targets to features as the encoder gives them; None where the
    targets are what a field is to give.
    """

    def __init__(
        self,
        points: NDArray[np.float32],
        targets: NDArray[np.float32],
        directions: NDArray[np.float32] | None,
        device: torch.device,
    ) -> None:
        self.points, self.targets, self.directions, self.device = points, targets, directions, device
        self.dimension = targets.shape[1]
        self._points = torch.from_numpy(points).to(device)
        self._targets = torch.from_numpy(targets).to(device)

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """`count` of the points at random, (count, 3), and their targets, (count, D)."""
        chosen = torch.randint(len(self._points), (count,), generator=generator).to(self._points.device)
        return self._points[chosen], self._targets[chosen]


class PixelTargets:
    """Targets at the surface points of all views: Ω of Eq. 3.

    Tokens are read between their positions, bilinearly: a patch's token stands at the center of the patch. Only the
    tokens are kept, never features of pixels.

    Parameters
    ----------
    tokens
        (views, h, w, D), the grids that the encoder gave for the square images of `views`.
    """

    directions = None  # these targets are features as the encoder gives them

    def __init__(self, views: Views, tokens: NDArray[np.float32], device: torch.device) -> None:
        count, self._height, self._width, self.dimension = tokens.shape
        self.device = device
        self._table = torch.from_numpy(tokens.reshape(count * self._height * self._width, self.dimension)).to(device)
        self._points = torch.from_numpy(views.points).to(device)
        self._view = torch.from_numpy(views.view.astype(np.int64)).to(device)
        self._row = torch.from_numpy(views.row).to(device)
        self._column = torch.from_numpy(views.column).to(device)
        self._resolution = views.images.shape[1]

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """`count` of the points at random, (count, 3), and their targets, (count, D)."""
        chosen = torch.randint(len(self._points), (count,), generator=generator).to(self._points.device)
        return self._points[chosen], self.at(chosen)

    def at(self, chosen: torch.Tensor) -> torch.Tensor:
        """Unit targets Z/‖Z‖ of the chosen points, (B, D)."""
        indices, shares = self._corners(chosen)
        blended = nn.functional.embedding_bag(indices, self._table, per_sample_weights=shares, mode="sum")
        return nn.functional.normalize(blended, dim=1)

    def mean_at(self, chosen: NDArray[np.integer], group: NDArray[np.integer], count: int) -> NDArray[np.float32]:
        """Mean of unit tokens over each group of points, (count, D); zero where a group is empty.

        `group` (B,) numbers the group of each of the `chosen`. Nothing of size B×D is made.
        """
        indices, shares = self._corners(torch.from_numpy(np.asarray(chosen, np.int64)).to(self._table.device))
        size = np.bincount(group, minlength=count)
        weight = shares.cpu().numpy() / size[group][:, None]
        gather = sparse.csr_matrix(
            (weight.ravel(), (np.repeat(group, 4), indices.cpu().numpy().ravel())), shape=(count, len(self._table))
        )
        return np.asarray(gather @ nn.functional.normalize(self._table, dim=1).cpu().numpy(), np.float32)

    def _corners(self, chosen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The four tokens around each chosen sample, as rows of the table, and their shares: (B, 4) each."""
        top, lower = self._between(self._row[chosen], self._height)
        left, right = self._between(self._column[chosen], self._width)
        bottom, after = (top + 1).clamp_(max=self._height - 1), (left + 1).clamp_(max=self._width - 1)
        first = self._view[chosen] * self._height
        indices = torch.stack(
            [(first + y) * self._width + x for y, x in ((top, left), (top, after), (bottom, left), (bottom, after))], 1
        )
        shares = torch.stack([(1 - lower) * (1 - right), (1 - lower) * right, lower * (1 - right), lower * right], 1)
        return indices, shares

    def _between(self, pixel: torch.Tensor, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        position = ((pixel + 0.5) * (count / self._resolution) - 0.5).clamp_(0, count - 1)
        before = position.floor()
        return before.long(), position - before
