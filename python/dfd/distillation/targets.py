"""Store the data to which a field is fitted: surface points and their target features (paper, Eq. 3)."""

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

if TYPE_CHECKING:  # torch takes seconds to import, and only the fit needs it
    import torch

PAIRS = 2000  # number of random pairs of features from which a mean distance is estimated
LARGEST_STRETCH = 5.0  # largest factor by which features are scaled about their mean, so that noise stays small
_GROUPS_AT_ONCE = 1000  # number of mean tokens that one task of `parallel_ranges` computes
_ROWS_AT_ONCE = 2048  # number of tokens that one task of `parallel_ranges` scales to unit length
_ROWS_IN_CACHE = 512  # number of rows that fit into a core's cache


class Targets:
    """Surface points (N, 3) in normalized coordinates, each with a target of unit length and `dimension` numbers."""

    points: Float32

    @property
    def dimension(self) -> int:
        """Return the dimension of a target."""
        return self.rows(np.zeros(1, np.int64)).shape[1]

    def rows(self, chosen: NDArray[np.integer]) -> Float32:
        """Return the targets (B, d) of the points with indices `chosen` (B,)."""
        raise NotImplementedError

    def at(self, chosen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the points (B, 3) with indices `chosen` (B,), and their targets (B, d), on the CPU."""
        import torch

        indices = chosen.numpy()
        return torch.from_numpy(self.points[indices]), torch.from_numpy(self.rows(indices))

    def pictures(self) -> list[torch.Tensor]:
        """Return the indices (N,) of the points of each picture; pictures without points are left out."""
        raise NotImplementedError

    def draw(self, count: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        """Return B = `count` random points (B, 3) and their targets (B, d), on the CPU."""
        import torch

        return self.at(torch.randint(len(self.points), (count,), generator=generator))


@dataclass(eq=False)
class PointTargets(Targets):
    """One target for each surface sample."""

    points: Float32  # (N, 3) normalized
    targets: Float32  # (N, d) rows of unit length
    directions: Float32 | None = None  # (d, D) orthonormal rows that map targets to features; None for the identity
    # `component` and `boxes` are None if the surface has one connected component.
    component: Int32 | None = None  # (N,) the component of each point
    boxes: Float64 | None = None  # (P, 6) the lower and upper corners of the components' boxes
    face: Int64 | None = None  # (N,) the face of the rendered surface on which each point lies; None if unknown

    @property
    def features(self) -> Float32:
        """Return the features (N, D) of the points: the targets multiplied by `directions`."""
        return self.targets if self.directions is None else np.asarray(self.targets @ self.directions, np.float32)

    def rows(self, chosen: NDArray[np.integer]) -> Float32:
        """Return the targets (B, d) of the chosen points."""
        return np.asarray(self.targets[chosen])


class TokenGrid:
    """Bilinear interpolation of the `height` × `width` tokens of each picture at the surface points of `views`.

    A token is the encoder's feature at the center of a patch. The tokens are ordered by picture, row and column.
    """

    def __init__(self, views: Views, height: int, width: int) -> None:
        self.size = len(views.images) * height * width
        self._height, self._width = height, width
        self._view, self._row, self._column = views.view, views.row, views.column
        self._resolution = views.images.shape[1]

    def corners(self, chosen: NDArray[np.integer]) -> tuple[Int64, Float32]:
        """Return the indices and weights (B, 4) of the four tokens around each of the points `chosen` (B,)."""
        top, lower = self._between(self._row[chosen], self._height)
        left, right = self._between(self._column[chosen], self._width)
        bottom, after = np.minimum(top + 1, self._height - 1), np.minimum(left + 1, self._width - 1)
        first = self._view[chosen].astype(np.int64) * self._height
        corners = (top, left), (top, after), (bottom, left), (bottom, after)
        indices = np.stack([(first + y) * self._width + x for y, x in corners], 1)
        weights = np.stack([(1 - lower) * (1 - right), (1 - lower) * right, lower * (1 - right), lower * right], 1)
        return indices, weights

    def means(self, chosen: NDArray[np.integer], group: NDArray[np.integer], count: int) -> sparse.csr_matrix:
        """Return the matrix (count, tokens) whose product with the tokens is the mean interpolated token of each group.

        `group` (B,) is the group of each of the points `chosen` (B,). Rows of groups without points are 0.
        """
        indices, weights = self.corners(chosen)
        size = np.bincount(group, minlength=count)
        weight = weights / size[group][:, None].astype(np.float32)
        return sparse.csr_matrix((weight.ravel(), (np.repeat(group, 4), indices.ravel())), shape=(count, self.size))

    def _between(self, pixel: Float32, count: int) -> tuple[Int64, Float32]:
        """Return the index of the token before each `pixel` (B,), and the weight of the token after it.

        `pixel` is a row or a column of the picture. Along this axis, the picture has `count` tokens.
        """
        cells = np.float32(count / self._resolution)
        position = ((pixel + np.float32(0.5)) * cells - np.float32(0.5)).clip(0, count - 1)
        before = position.astype(np.int64)
        return before, position - before.astype(np.float32)


class PixelTargets(Targets):
    """Targets at the surface points of all pixels (Eq. 3), interpolated from `tokens` (pictures, h, w, D)."""

    directions = None  # these targets are features of the encoder

    def __init__(self, views: Views, tokens: Float32) -> None:
        self.grid = TokenGrid(views, *tokens.shape[1:3])
        self._table = tokens.reshape(-1, tokens.shape[3])
        self._view = views.view
        self.points = views.points

    def pictures(self) -> list[torch.Tensor]:
        """Return the indices (N,) of the points of each picture; pictures without points are left out."""
        import torch

        return [torch.from_numpy(np.flatnonzero(self._view == each)) for each in np.unique(self._view)]

    def rows(self, chosen: NDArray[np.integer]) -> Float32:
        """Return the interpolated tokens (B, D) of the points `chosen` (B,), scaled to unit length."""
        import torch

        indices, weights = (torch.from_numpy(each) for each in self.grid.corners(chosen))
        table = torch.from_numpy(self._table)
        blended = torch.nn.functional.embedding_bag(indices, table, mode="sum", per_sample_weights=weights)
        return torch.nn.functional.normalize(blended, dim=1).numpy()

    def means_by(self, weights: sparse.csr_matrix) -> Float32:
        """Scale the tokens to unit length, and return the product (N, D) of `weights` (N, tokens) and the tokens."""
        table = np.empty(self._table.shape, np.float32)

        def normalize(begin: int, end: int) -> None:
            table[begin:end] = unit(self._table[begin:end])

        parallel_ranges(len(table), _ROWS_AT_ONCE, normalize)
        mean = np.empty((weights.shape[0], table.shape[1]), np.float32)

        def fill(begin: int, end: int) -> None:
            mean[begin:end] = weights[begin:end] @ table

        parallel_ranges(len(mean), _GROUPS_AT_ONCE, fill)
        return mean


def side_by_side(by_up: Sequence[PointTargets], shares: Sequence[float] | NDArray[np.floating]) -> PointTargets:
    """Combine the targets for several up directions; squared distances of features become weighted means.

    `by_up` contains the targets for each up direction. `shares` are the weights of these directions, with sum 1. The
    targets have the same points, except points that the diffusion for a direction did not reach. The concatenated
    features are projected to principal directions, so that the result has as many dimensions as the first targets.
    """
    if len(by_up) == 1:
        return by_up[0]
    first = by_up[0]
    nearest = [cKDTree(each.points).query(first.points)[1] for each in by_up]
    rows = [np.sqrt(share) * each.features[at] for share, each, at in zip(shares, by_up, nearest, strict=True)]
    together = np.concatenate(rows, axis=1, dtype=np.float32)
    directions = principal_directions(together, first.dimension)
    return replace(first, targets=unit(together @ directions.T), directions=None)


def restore_contrast(rows: Float32, distance: float, generator: np.random.Generator, *, least: float = 1.0) -> Float32:
    """Return `rows` (N, D), scaled about their mean and then to unit length, so that their mean distance is `distance`.

    The scaling factor lies in [`least`, `LARGEST_STRETCH`]. The mean distance is estimated from random pairs of rows.
    """
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
    """Return `rows` (N, D), scaled to unit length; rows shorter than 1e-6 are divided by 1e-6."""
    result = np.empty(rows.shape, np.float32)
    for begin in range(0, len(rows), _ROWS_IN_CACHE):
        some = rows[begin : begin + _ROWS_IN_CACHE]
        length = np.maximum(np.linalg.norm(some, axis=1, keepdims=True), np.float32(1e-6))
        np.divide(some, length, out=result[begin : begin + _ROWS_IN_CACHE])
    return result


def mean_distance(one: Float32, other: Float32) -> float:
    """Return the mean distance between row i of `one` (N, D) and row i of `other`."""
    return float(np.linalg.norm(one - other, axis=1).mean())
