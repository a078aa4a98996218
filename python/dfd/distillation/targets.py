"""What a field is fitted to: points and their unit targets (paper, Eq. 3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dfd.common.threads import share
from dfd.views.render import Views

# torch takes seconds to import; only the fit draws with it.
if TYPE_CHECKING:
    import torch

__all__ = ["PAIRS", "PixelTargets", "PointTargets", "Targets", "TokenGrid", "mean_distance", "restore_contrast", "unit"]

PAIRS = 2000  # whose mean distance stands for that of all
LARGEST_STRETCH = 5.0  # more would only magnify noise, on a shape that looks the same everywhere
_GROUPS_AT_ONCE = 1000  # whose means one thread takes
_ROWS_AT_ONCE = 2048  # of tokens
_ROWS_IN_CACHE = 512  # whose squares stay in a core's cache until they are summed


class Targets:
    """Points, normalized (N, 3), and what a field should give there, unit rows of width `dimension`."""

    points: NDArray[np.float32]

    @property
    def dimension(self) -> int:
        """Width of a target."""
        raise NotImplementedError

    def rows(self, chosen: NDArray[np.integer]) -> NDArray[np.float32]:
        """Unit targets of the points of these numbers (B,), (B, d)."""
        raise NotImplementedError

    def at(self, chosen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The points of these numbers (B,), (B, 3), and their unit targets, (B, d), on the CPU."""
        import torch

        numbers = chosen.numpy()
        return torch.from_numpy(self.points[numbers]), torch.from_numpy(self.rows(numbers))

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """The same of `count` points at random."""
        import torch

        return self.at(torch.randint(len(self.points), (count,), generator=generator))


@dataclass(eq=False)
class PointTargets(Targets):
    """Targets at points.

    Attributes
    ----------
    points, targets
        (N, 3) normalized, and (N, d) unit rows.
    directions
        (d, D) orthonormal rows that lead from targets to features as the encoder gives them; None where the targets are
        what a field is to give.
    piece, boxes
        Of a surface in several connected components, (N,) the one that each point is on, and (P, 6) the corners of the
        boxes around them; else None.
    face
        (N,) the face that each point lies on, where it is known.
    """

    points: NDArray[np.float32]
    targets: NDArray[np.float32]
    directions: NDArray[np.float32] | None = None
    piece: NDArray[np.int32] | None = None
    boxes: NDArray[np.float64] | None = None
    face: NDArray[np.int64] | None = None

    @property
    def dimension(self) -> int:
        """Width d of a target."""
        return int(self.targets.shape[1])

    @property
    def features(self) -> NDArray[np.float32]:
        """(N, D) the targets as the encoder gives features."""
        return self.targets if self.directions is None else np.asarray(self.targets @ self.directions, np.float32)

    def rows(self, chosen: NDArray[np.integer]) -> NDArray[np.float32]:
        """Unit targets of the chosen points, (B, d)."""
        return np.asarray(self.targets[chosen])


class TokenGrid:
    """Which tokens each surface point of `views` is read from, where an image has (height, width) of them.

    Tokens are interpolated bilinearly: a patch's token stands at the center of the patch.
    """

    def __init__(self, views: Views, height: int, width: int) -> None:
        self.size = len(views.images) * height * width
        self._height, self._width = height, width
        self._view, self._row, self._column = views.view, views.row, views.column
        self._resolution = views.images.shape[1]

    def corners(self, chosen: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """The four tokens around each chosen point, numbered image by image, row by row, and their shares: (B, 4)."""
        top, lower = self._between(self._row[chosen], self._height)
        left, right = self._between(self._column[chosen], self._width)
        bottom, after = np.minimum(top + 1, self._height - 1), np.minimum(left + 1, self._width - 1)
        first = self._view[chosen].astype(np.int64) * self._height
        indices = np.stack(
            [(first + y) * self._width + x for y, x in ((top, left), (top, after), (bottom, left), (bottom, after))], 1
        )
        shares = np.stack([(1 - lower) * (1 - right), (1 - lower) * right, lower * (1 - right), lower * right], 1)
        return indices, shares

    def means(self, chosen: NDArray[np.integer], group: NDArray[np.integer], count: int) -> sparse.csr_matrix:
        """(count, tokens) shares of all tokens in the mean of each group of points; none where a group is empty.

        `group` (B,) numbers the group of each of the `chosen`.
        """
        indices, shares = self.corners(chosen)
        size = np.bincount(group, minlength=count)
        weight = shares / size[group][:, None].astype(np.float32)
        return sparse.csr_matrix((weight.ravel(), (np.repeat(group, 4), indices.ravel())), shape=(count, self.size))

    def _between(self, pixel: NDArray[np.float32], count: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        cells = np.float32(count / self._resolution)
        position = ((pixel + np.float32(0.5)) * cells - np.float32(0.5)).clip(0, count - 1)
        before = position.astype(np.int64)
        return before, position - before.astype(np.float32)


class PixelTargets(Targets):
    """Targets at the surface points of all views: Ω of Eq. 3.

    Only the tokens are kept, never features of pixels.

    Parameters
    ----------
    tokens
        (views, h, w, D), the grids that the encoder gave for the square images of `views`.
    """

    directions = None  # these targets are features as the encoder gives them

    def __init__(self, views: Views, tokens: NDArray[np.float32]) -> None:
        self.grid = TokenGrid(views, *tokens.shape[1:3])
        self._table = tokens.reshape(-1, tokens.shape[3])
        self.points = views.points

    @property
    def dimension(self) -> int:
        """Width D of a token."""
        return int(self._table.shape[1])

    def rows(self, chosen: NDArray[np.integer]) -> NDArray[np.float32]:
        """Unit targets Z/‖Z‖ of the chosen points, (B, D)."""
        import torch

        indices, shares = (torch.from_numpy(each) for each in self.grid.corners(chosen))
        table = torch.from_numpy(self._table)
        blended = torch.nn.functional.embedding_bag(indices, table, mode="sum", per_sample_weights=shares)
        return torch.nn.functional.normalize(blended, dim=1).numpy()

    def means_by(self, shares: sparse.csr_matrix) -> NDArray[np.float32]:
        """Sums of unit tokens by `shares` (N, tokens), such as `TokenGrid.means` gives, (N, D)."""
        table = np.empty(self._table.shape, np.float32)

        def shorten(begin: int, end: int) -> None:
            table[begin:end] = unit(self._table[begin:end])

        share(len(table), _ROWS_AT_ONCE, shorten)
        mean = np.empty((shares.shape[0], self.dimension), np.float32)

        def fill(begin: int, end: int) -> None:
            mean[begin:end] = shares[begin:end] @ table

        share(len(mean), _GROUPS_AT_ONCE, fill)
        return mean


def restore_contrast(
    rows: NDArray[np.float32], distance: float, generator: np.random.Generator, *, least: float = 1.0
) -> NDArray[np.float32]:
    """Move unit `rows` (N, D) about their mean, `least` to `LARGEST_STRETCH` times, to a mean distance of pairs."""
    one, other = generator.integers(0, len(rows), (2, PAIRS))
    mean = rows.mean(axis=0)
    from_mean = rows - mean
    pairs = from_mean[one], from_mean[other]

    def stretched(some: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
        return unit(mean + np.float32(factor) * some)

    low, high = least, LARGEST_STRETCH
    for _ in range(20):  # bisection: the distance grows with the factor
        middle = (low + high) / 2
        if mean_distance(*(stretched(some, middle) for some in pairs)) < distance:
            low = middle
        else:
            high = middle
    return stretched(from_mean, low)


def unit(rows: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return `rows` (N, D) at unit length; one of hardly any length stays short."""
    result = np.empty(rows.shape, np.float32)
    for begin in range(0, len(rows), _ROWS_IN_CACHE):
        some = rows[begin : begin + _ROWS_IN_CACHE]
        length = np.maximum(np.linalg.norm(some, axis=1, keepdims=True), np.float32(1e-6))
        np.divide(some, length, out=result[begin : begin + _ROWS_IN_CACHE])
    return result


def mean_distance(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return the mean distance between the rows (N, D) of `one` and those of `other`."""
    return float(np.linalg.norm(one - other, axis=1).mean())
