"""The data of the fit: points and their unit target features (paper, Eq. 3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dfd.common.linear_algebra import Float32, Float64, Int32, Int64, principal_directions
from dfd.common.threads import parallel_ranges
from dfd.views.render import Views

# torch takes seconds to import, and only the fit needs it.
if TYPE_CHECKING:
    import torch

PAIRS = 2000  # sampled pairs that estimate a mean distance
LARGEST_STRETCH = 5.0  # bound: a shape with equal features everywhere would only get amplified noise
_GROUPS_AT_ONCE = 1000  # means per task
_ROWS_AT_ONCE = 2048  # tokens per task
_ROWS_IN_CACHE = 512  # rows whose squares stay in a core's cache until they are summed


class Targets:
    """Normalized points (N, 3) and their target features, unit rows of width `dimension`."""

    points: Float32

    @property
    def dimension(self) -> int:
        """Return the width of a target."""
        raise NotImplementedError

    def rows(self, chosen: NDArray[np.integer]) -> Float32:
        """Return unit targets (B, d) of the points with indices `chosen` (B,)."""
        raise NotImplementedError

    def at(self, chosen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the points (B, 3) with indices `chosen` (B,), and their unit targets (B, d), on the CPU."""
        import torch

        numbers = chosen.numpy()
        return torch.from_numpy(self.points[numbers]), torch.from_numpy(self.rows(numbers))

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """Return what `at` returns for `count` random points."""
        import torch

        return self.at(torch.randint(len(self.points), (count,), generator=generator))


@dataclass(eq=False)
class PointTargets(Targets):
    """One target for each surface sample."""

    # points, targets: (N, 3) normalized, and (N, d) unit rows
    points: Float32
    targets: Float32
    # directions: (d, D) orthonormal rows that map targets to the encoder's features; None if the targets already are
    # the final features
    directions: Float32 | None = None
    # component, boxes: None if the surface is one connected component; else (N,) the component of each point, and
    # (P, 6) the lower and upper corners of the components' boxes
    component: Int32 | None = None
    boxes: Float64 | None = None
    face: Int64 | None = None  # (N,) the face that each point lies on, if known

    @property
    def dimension(self) -> int:
        """Return the width d of a target."""
        return int(self.targets.shape[1])

    @property
    def features(self) -> Float32:
        """Return the targets (N, D) as features of the encoder."""
        return self.targets if self.directions is None else np.asarray(self.targets @ self.directions, np.float32)

    def rows(self, chosen: NDArray[np.integer]) -> Float32:
        """Return unit targets (B, d) of the chosen points."""
        return np.asarray(self.targets[chosen])


class TokenGrid:
    """Interpolates the (height, width) tokens of each image bilinearly at the surface points of `views`.

    A token lies at the center of its patch.
    """

    def __init__(self, views: Views, height: int, width: int) -> None:
        self.size = len(views.images) * height * width
        self._height, self._width = height, width
        self._view, self._row, self._column = views.view, views.row, views.column
        self._resolution = views.images.shape[1]

    def corners(self, chosen: NDArray[np.integer]) -> tuple[Int64, Float32]:
        """Return indices and weights (B, 4) of the four tokens around each point; indices run by image, row, column."""
        top, lower = self._between(self._row[chosen], self._height)
        left, right = self._between(self._column[chosen], self._width)
        bottom, after = np.minimum(top + 1, self._height - 1), np.minimum(left + 1, self._width - 1)
        first = self._view[chosen].astype(np.int64) * self._height
        indices = np.stack(
            [(first + y) * self._width + x for y, x in ((top, left), (top, after), (bottom, left), (bottom, after))], 1
        )
        weights = np.stack([(1 - lower) * (1 - right), (1 - lower) * right, lower * (1 - right), lower * right], 1)
        return indices, weights

    def means(self, chosen: NDArray[np.integer], group: NDArray[np.integer], count: int) -> sparse.csr_matrix:
        """Return a matrix (count, tokens) that averages tokens over each group; rows of empty groups are empty.

        `group` (B,) is the group of each of the `chosen`.
        """
        indices, weights = self.corners(chosen)
        size = np.bincount(group, minlength=count)
        weight = weights / size[group][:, None].astype(np.float32)
        return sparse.csr_matrix((weight.ravel(), (np.repeat(group, 4), indices.ravel())), shape=(count, self.size))

    def _between(self, pixel: Float32, count: int) -> tuple[Int64, Float32]:
        cells = np.float32(count / self._resolution)
        position = ((pixel + np.float32(0.5)) * cells - np.float32(0.5)).clip(0, count - 1)
        before = position.astype(np.int64)
        return before, position - before.astype(np.float32)


class PixelTargets(Targets):
    """Holds targets at the surface points of all views, Ω of Eq. 3, and interpolates them from tokens on demand.

    Parameters
    ----------
    tokens
        (views, h, w, D), the encoder's tokens of the square images of `views`.
    """

    directions = None  # these targets are features of the encoder

    def __init__(self, views: Views, tokens: Float32) -> None:
        self.grid = TokenGrid(views, *tokens.shape[1:3])
        self._table = tokens.reshape(-1, tokens.shape[3])
        self.points = views.points

    @property
    def dimension(self) -> int:
        """Return the width D of a token."""
        return int(self._table.shape[1])

    def rows(self, chosen: NDArray[np.integer]) -> Float32:
        """Return unit targets Z/‖Z‖ (B, D) of the chosen points."""
        import torch

        indices, weights = (torch.from_numpy(each) for each in self.grid.corners(chosen))
        table = torch.from_numpy(self._table)
        blended = torch.nn.functional.embedding_bag(indices, table, mode="sum", per_sample_weights=weights)
        return torch.nn.functional.normalize(blended, dim=1).numpy()

    def means_by(self, weights: sparse.csr_matrix) -> Float32:
        """Return `weights` (N, tokens), for example of `TokenGrid.means`, times the unit tokens: (N, D)."""
        table = np.empty(self._table.shape, np.float32)

        def shorten(begin: int, end: int) -> None:
            table[begin:end] = unit(self._table[begin:end])

        parallel_ranges(len(table), _ROWS_AT_ONCE, shorten)
        mean = np.empty((weights.shape[0], self.dimension), np.float32)

        def fill(begin: int, end: int) -> None:
            mean[begin:end] = weights[begin:end] @ table

        parallel_ranges(len(mean), _GROUPS_AT_ONCE, fill)
        return mean


def side_by_side(seen: Sequence[PointTargets], shares: Sequence[float] | NDArray[np.floating]) -> PointTargets:
    """Return targets whose squared distances are the mean of those of `seen`, weighted by `shares`, which sum to 1.

    All of `seen` were smoothed at the same points; points that diffusion did not reach may be missing. Main directions
    reduce the result to the width of the first, because pictures of one shape in two up directions differ little.
    """
    if len(seen) == 1:
        return seen[0]
    first = seen[0]
    nearest = [cKDTree(each.points).query(first.points)[1] for each in seen]
    rows = [np.sqrt(share) * each.features[at] for share, each, at in zip(shares, seen, nearest, strict=True)]
    together = np.concatenate(rows, axis=1, dtype=np.float32)
    directions = principal_directions(together, first.dimension)
    return replace(first, targets=unit(together @ directions.T), directions=None)


def restore_contrast(rows: Float32, distance: float, generator: np.random.Generator, *, least: float = 1.0) -> Float32:
    """Scale unit `rows` (N, D) about their mean to the mean pairwise `distance`, by `least` … `LARGEST_STRETCH`."""
    one, other = generator.integers(0, len(rows), (2, PAIRS))
    mean = rows.mean(axis=0)
    from_mean = rows - mean
    pairs = from_mean[one], from_mean[other]

    def stretched(some: Float32, factor: float) -> Float32:
        return unit(mean + np.float32(factor) * some)

    low, high = least, LARGEST_STRETCH
    for _ in range(20):  # bisection works because the distance grows with the factor
        middle = (low + high) / 2
        if mean_distance(*(stretched(some, middle) for some in pairs)) < distance:
            low = middle
        else:
            high = middle
    return stretched(from_mean, low)


def unit(rows: Float32) -> Float32:
    """Return `rows` (N, D) at unit length; rows shorter than 1e-6 stay short."""
    result = np.empty(rows.shape, np.float32)
    for begin in range(0, len(rows), _ROWS_IN_CACHE):
        some = rows[begin : begin + _ROWS_IN_CACHE]
        length = np.maximum(np.linalg.norm(some, axis=1, keepdims=True), np.float32(1e-6))
        np.divide(some, length, out=result[begin : begin + _ROWS_IN_CACHE])
    return result


def mean_distance(one: Float32, other: Float32) -> float:
    """Return the mean distance between the rows (N, D) of `one` and those of `other`."""
    return float(np.linalg.norm(one - other, axis=1).mean())
