"""Compact the features for `dfd.bind` to about a tenth of their bytes. Weights stay within a tolerance.

The features of a shape vary mostly along few directions. They are projected to as few as the tolerance permits. Their
coordinates become entries of 8 or 16 bits. Equal features have equal entries: the weight at a handle is exactly 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.common.read_only import ReadOnlyArrays
from dfd.common.threads import get_num_threads, one_blas_thread

BLOCK = 16  # number of vertices that the kernels read together
BATCH = 512  # number of rows that are projected together; they fit the cache of a core
SPAN = 127  # largest absolute value of an 8-bit entry, in multiples of `CompactFeatures.step`
DIRECTION_SAMPLE = 16_384  # largest number of vertices from which the principal directions are computed
VERTEX_SAMPLE, HANDLE_SAMPLE = 4_096, 128  # largest numbers of vertices and handles in a `_Trial`
SAFETY = 0.8  # a format is accepted if weights on the samples have an error of at most SAFETY times the tolerance

Precision = Literal["int8", "float16"]


@dataclass(frozen=True, eq=False)
class CompactFeatures(ReadOnlyArrays):
    """Features (V, D) of a shape's vertices, projected and rounded. `dfd.bind` accepts them in place of the features.

    A feature z is stored as d entries: (z − mean) @ basis, in multiples of `step`.
    """

    shape: tuple[int, int]  #: (V, D) of the original features
    precision: Precision  #: type of an entry
    #: The entries, in B blocks of 16 vertices: (B, d, 16) uint16 for "float16", (B, d / 4 + 1, 16, 4) uint8 for "int8".
    #: For "int8", a vertex has d bytes, its entries plus 128, and 4 bytes, the int32 sum of its squared entries.
    blocks: NDArray[Any]
    basis: Float32  #: (D, d) orthonormal columns
    mean: Float32  #: (D,)
    step: float  #: the unit of an "int8" entry; 1 for "float16"
    radius: float  #: largest distance between the feature of a sample and its approximation by entries
    tolerance: float  #: the requested largest error of a weight
    error: float  #: the largest error of a weight on the samples

    def __repr__(self) -> str:
        stored = f"{self.dimensions} dimensions as {self.precision}"
        return f"CompactFeatures({self.shape[0]} × {self.shape[1]} in {stored}, error {self.error:.2g})"

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def dimensions(self) -> int:
        """Return the number d of entries per vertex."""
        return int(self.basis.shape[1])

    @property
    def nbytes(self) -> int:
        """Return the number of bytes that binding reads."""
        return self.blocks.nbytes

    def stored(self, indices: NDArray[np.integer[Any]]) -> Float32:
        """Return the entries (N, d) of the vertices `indices` (N,), in multiples of `step`."""
        block, lane = np.divmod(indices, BLOCK)
        if self.precision == "float16":
            return self.blocks[block, :, lane].view(np.float16).astype(np.float32)
        entries = self.blocks[block, :-1, lane].reshape(len(block), self.dimensions)
        return entries.astype(np.float32) - 128

    def rows(self, indices: NDArray[np.integer[Any]]) -> Float32:
        """Return approximate features (N, D) of vertices `indices` (N,). `project` maps these to the stored entries."""
        stored = self.stored(indices)
        stored *= self.step
        return stored @ self.basis.T + self.mean

    def principal(self, count: int) -> Float32:
        """Return the coordinates (V, min(`count`, d)) of all features along their first principal directions.

        In each direction (D,), the number with the largest magnitude is positive, so that results are reproducible.
        """
        sample = self.stored(np.arange(0, len(self), -(-len(self) // DIRECTION_SAMPLE))).astype(np.float64)
        mean = sample.mean(axis=0)
        axes = np.linalg.eigh((sample - mean).T @ (sample - mean))[1][:, ::-1][:, :count]
        full = self.basis @ axes
        axes *= self.step * np.where(np.take_along_axis(full, np.abs(full).argmax(axis=0)[None], axis=0) < 0, -1, 1)
        coordinates = np.empty((len(self), axes.shape[1]), np.float32)
        for start in range(0, len(self), BATCH):
            stored = self.stored(np.arange(start, min(start + BATCH, len(self))))
            coordinates[start : start + BATCH] = (stored - mean.astype(np.float32)) @ axes.astype(np.float32)
        return coordinates

    def project(self, rows: Float32) -> tuple[Float32, Float32]:
        """Return the entries (N, d) of handles with the features `rows` (N, D), and an offset (N,) for each handle.

        `dfd.bind` adds the offset to the squared distances between the handle and all vertices. The offset is the
        squared distance between the handle's feature and its approximation, minus the square of `radius`, at least 0.
        """
        centered = rows - self.mean
        stored = _rounded(centered @ self.basis, self.precision, self.step)
        residuals = np.square(centered - self.step * stored @ self.basis.T, dtype=np.float64).sum(axis=1)
        return stored, np.maximum(residuals - self.radius**2, 0.0).astype(np.float32)


@one_blas_thread()
def compact(
    features: Any, points: Any = None, *, tolerance: float = 0.01, progress: Callable[[int], object] | None = None
) -> CompactFeatures:
    """Compact `features` to as few dimensions and bits as the `tolerance` permits.

    Raises ValueError if `features` or `points` have the wrong array shape, are empty or are not finite, or 16 bits are
    too few for the tolerance.

    The time for small shapes grows with the cube of the number of dimensions: about 10 s for 2,048 random dimensions on
    one core. Features of vision networks, which vary along few directions, take less.

    Parameters
    ----------
    features
        (V, D) rows, a field with `points`, or `field.on(mesh)`. A field is evaluated in batches on several threads, so
        the full features are never in memory.
    points
        (V, 3) points at which a field is evaluated, in mesh units; only for a field.
    tolerance
        Largest permitted difference from weights by full float64 features, on sampled vertices and handles.
    progress
        A function that takes the number of newly finished rows; the number is negative if rows are computed again.

    Examples
    --------
    >>> import dfd
    >>> mesh = dfd.samples.chair().mesh
    >>> features = dfd.compact(dfd.distill(mesh).on(mesh))
    >>> weights = dfd.bind(features, [17])
    >>> features.error <= 0.01
    True
    """
    wanted = check.number("compact", "tolerance", tolerance, minimum=0, exclusive=True)
    source = _Source(features, points)
    random = np.random.default_rng(0)
    sample = source.rows(_sample(random, source.count, DIRECTION_SAMPLE)).astype(np.float64)
    mean = sample.mean(axis=0)
    centered = sample - mean
    directions = np.linalg.eigh(centered.T @ centered)[1][:, ::-1]
    centered = centered @ directions
    validation = source.rows(_sample(random, source.count, VERTEX_SAMPLE)).astype(np.float64)
    trials = [
        _Trial(rows, along, _sample(random, len(rows), HANDLE_SAMPLE))
        for rows, along in ((sample, centered), (validation, (validation - mean) @ directions))
    ]

    candidates = _candidates(source.dimension)
    sizes = sorted({min(dimensions, source.dimension) for _, _, dimensions in candidates})
    unrounded = dict(zip(sizes, np.maximum(*(trial.unrounded_errors(sizes) for trial in trials)), strict=True))
    for _, precision, dimensions in candidates:
        kept = min(dimensions, source.dimension)
        rotation = np.eye(kept)
        step = 1.0
        if precision == "int8":  # all dimensions share one step; after a random rotation, their ranges are similar
            rotation = random.standard_normal((kept, kept))
        if unrounded[kept] > wanted:  # a trial of many dimensions takes seconds
            continue
        if precision == "int8":
            rotation = np.linalg.qr(rotation)[0]
            step = float(1.02 * np.abs(centered[:, :kept] @ rotation).max() / SPAN or 1.0)
        if max(trial.error(rotation, precision, step) for trial in trials) <= SAFETY * wanted:
            break
    else:
        raise ArgumentError("tolerance", f"must be larger, because 16 bits are too few, got {wanted:g}", "compact")

    del sample, centered, validation  # frees memory before the rows are packed
    basis = np.zeros((source.dimension, dimensions), np.float32)
    basis[:, :kept] = directions[:, :kept] @ rotation
    center = mean.astype(np.float32)
    blocks, step = _packed(source, center, basis, precision, step, progress)
    error = max(trial.error(rotation, precision, step) for trial in trials)
    if not error <= wanted:
        reason = f"have a row so far from the others that the error is {error:g}, above `tolerance`, {wanted:g}"
        raise ArgumentError("features", reason, "compact")
    for array in (blocks, basis, center):
        array.flags.writeable = False
    radius = max(trial.radius(rotation, precision, step) for trial in trials)
    shape = source.count, source.dimension
    return CompactFeatures(shape, precision, blocks, basis, center, step, radius, wanted, error)


class _Source:
    """Feature rows, read from an array or computed by a field."""

    def __init__(self, features: Any, points: Any) -> None:
        from dfd.field.field import FieldOnMesh  # imported late, because `import dfd` does not need it

        self._field: Callable[[NDArray[Any]], Any] | None = None
        if isinstance(features, FieldOnMesh) and points is None:
            self._field = features.rows
            self._array = np.arange(features.shape[0])
        elif callable(features) and not tensors.is_tensor(features):
            if points is None:
                raise ArgumentError("points", "must be given for a field", "compact")
            self._field = features
            self._array = check.array("compact", "points", points, ("V", 3), dtype=np.float64)
        else:
            if points is not None:
                raise ArgumentError("points", "must not be given if `features` are rows", "compact")
            self._array = check.array("compact", "features", features, ("V", "D"), finite=False)
        self.count = len(self._array)
        if self.count == 0:
            raise ArgumentError("features", "must have at least one row, got none", "compact")
        self.dimension = self.rows(np.arange(1)).shape[1]

    def rows(self, which: slice | Int64) -> Float32:
        rows: NDArray[Any] = self._array[which]
        if self._field is not None:
            rows = np.asarray(tensors.shared("compact", "features", self._field(rows)), np.float32)
        if not np.isfinite(rows).all():
            raise ArgumentError("features", "must be finite", "compact")
        return rows


class _Trial:
    """Compare weights from entries with weights from full features in float64, on sampled vertices and handles.

    `features` (N, D) are the full features, `along` (N, D) are their coordinates along all principal directions, and
    `handles` (H,) are indices of rows. The reference weights are computed from `features`, because `along` has
    rounding errors. Entries are the first d coordinates in `along`, multiplied by `rotation` (d, d) and rounded.
    """

    def __init__(self, features: Float64, along: Float64, handles: Int64) -> None:
        self._vertices, self._handles = along[:VERTEX_SAMPLE].copy(), along[handles]
        self._weights = _weights(features[:VERTEX_SAMPLE], features[handles])

    def unrounded_errors(self, sizes: Sequence[int]) -> Float64:
        """Return the error without rounding for the first s coordinates, for each s in `sizes` (S,), which increase."""
        squares, start, errors = np.zeros_like(self._weights), 0, []
        for size in sizes:
            squares += _squares(self._vertices[:, start:size], self._handles[:, start:size])
            errors.append(np.abs(_weights_at(squares) - self._weights).max())
            start = size
        return np.array(errors)

    def error(self, rotation: Float64, precision: Precision, step: float) -> float:
        """Return the largest difference between a weight from entries and the reference weight."""
        vertices, handles = (_stored(rows, rotation, precision, step) for rows in (self._vertices, self._handles))
        if not (np.isfinite(vertices).all() and np.isfinite(handles).all()):
            return np.inf
        return float(np.abs(_weights(vertices, handles) - self._weights).max())

    def radius(self, rotation: Float64, precision: Precision, step: float) -> float:
        """Return the largest distance between a vertex's feature and its approximation by entries."""
        residuals = self._vertices.copy()
        residuals[:, : len(rotation)] -= _stored(self._vertices, rotation, precision, step) @ rotation.T
        return float(np.linalg.norm(residuals, axis=1).max())


def _stored(rows: Float64, rotation: Float64, precision: Precision, step: float) -> Float64:
    return step * _rounded(rows[:, : len(rotation)] @ rotation, precision, step).astype(np.float64)


def _weights(vertices: Float64, handles: Float64) -> Float64:
    """Return the weights (V, H) of Equations 4 and 5."""
    return _weights_at(_squares(vertices, handles))


def _squares(vertices: Float64, handles: Float64) -> Float64:
    """Return the squared distances (V, H)."""
    sums: Float64 = np.square(vertices).sum(axis=1)[:, None] + np.square(handles).sum(axis=1)
    return sums - 2.0 * vertices @ handles.T


def _weights_at(squares: Float64) -> Float64:
    return np.maximum(1.0 - np.sqrt(np.maximum(squares, 0.0)), 0.0)


def _sample(random: np.random.Generator, count: int, size: int) -> Int64:
    """Return at most `size` distinct random indices below `count`."""
    return random.choice(count, min(count, size), replace=False)


def _candidates(dimension: int) -> list[tuple[int, Precision, int]]:
    """Return (bytes per vertex, precision, number of dimensions) of each format to try, the smallest first."""
    options: list[tuple[int, Precision, int]] = []
    most = -(-dimension // 4) * 4
    for size in (*range(8, 64, 8), *range(64, 256, 16), *range(256, most, 64), most):
        size = min(size, most)
        options += [(size + 4, "int8", size), (2 * size, "float16", min(size, dimension))]
    return sorted(set(options))


def _rounded(projected: NDArray[Any], precision: Precision, step: float) -> Float32:
    """Return the entries of projected rows, in multiples of `step`."""
    if precision == "float16":
        with np.errstate(over="ignore"):
            return projected.astype(np.float16).astype(np.float32)
    return np.clip(np.rint(projected / step), -SPAN, SPAN).astype(np.float32)


def _packed(
    source: _Source,
    mean: Float32,
    basis: Float32,
    precision: Precision,
    step: float,
    progress: Callable[[int], object] | None,
) -> tuple[NDArray[Any], float]:
    """Return the blocks of all rows, and the step. The step is increased if a row outside the samples needs it."""
    count, dimensions, is_float16 = source.count, basis.shape[1], precision == "float16"
    shape = (dimensions, BLOCK) if is_float16 else (dimensions // 4 + 1, BLOCK, 4)
    # np.empty allocates huge memory pages, and np.zeros does not.
    blocks: NDArray[Any] = np.empty((-(-count // BLOCK), *shape), np.uint16 if is_float16 else np.uint8)

    def pack(start: int) -> float:
        """Fill the blocks of the batch from row `start`, and return its largest magnitude before rounding."""
        stop = min(start + BATCH, count)
        projected = (source.rows(slice(start, stop)) - mean) @ basis
        padded = np.zeros((-(-(stop - start) // BLOCK) * BLOCK, dimensions), np.float32)
        padded[: stop - start] = _rounded(projected, precision, step)
        rows = padded.reshape(-1, BLOCK, dimensions)
        into = blocks[start // BLOCK : start // BLOCK + len(rows)]
        if is_float16:
            into[:] = rows.astype(np.float16).view(np.uint16).transpose(0, 2, 1)
        else:
            into[:, :-1] = (rows + 128).astype(np.uint8).reshape(-1, BLOCK, dimensions // 4, 4).transpose(0, 2, 1, 3)
            squares = np.square(rows).sum(axis=2, dtype=np.float64).astype(np.int32)
            into[:, -1] = squares.view(np.uint8).reshape(-1, BLOCK, 4)
        return float(np.abs(projected).max())

    starts = range(0, count, BATCH)
    with one_blas_thread(), ThreadPoolExecutor(get_num_threads(), "dfd") as pool:
        try:
            for start, largest in zip(starts, pool.map(pack, starts), strict=True):
                if not is_float16 and largest > (SPAN + 0.5) * step:
                    break
                if is_float16 and largest > float(np.finfo(np.float16).max):
                    raise ArgumentError("features", "have a row too far from the others for 16 bits", "compact")
                if progress is not None:
                    progress(min(BATCH, count - start))
            else:
                return blocks, step
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    if progress is not None:
        progress(-start)
    return _packed(source, mean, basis, precision, 1.02 * largest / SPAN, progress)
