"""Check the arguments of `dfd.pose` and `dfd.Drag`, and convert them for the kernel."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

import dfd._core as _core
from dfd.common import check, tensors
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64, Int64


def read_points(function: str, vertices: Any) -> NDArray[Any]:
    """Return `vertices` as an array (V, 3) of float32 or float64, without a copy if it already is such an array."""
    points = tensors.shared(function, "vertices", vertices)
    given = points.dtype.newbyteorder("=") if isinstance(points, np.ndarray) else None
    dtype = np.float32 if given in (np.float32, np.float16) else np.float64
    return check.array(function, "vertices", points, ("V", 3), dtype=dtype, finite=False)


def read_weights(function: str, weights: Any, vertex_count: int) -> Float32:
    """Return `weights` (V, H) as float32, without a copy if the type is float32 and rows or columns are contiguous."""
    matrix = tensors.shared(function, "weights", weights)
    if (
        isinstance(matrix, np.ndarray)
        and matrix.dtype == np.float32
        and matrix.ndim == 2
        and len(matrix) == vertex_count
        and tensors.lines_contiguous(matrix)
    ):
        return matrix
    return check.array(function, "weights", matrix, (vertex_count, "H"), finite=False)


def empty_like(points: NDArray[Any], batch: int | None = None) -> NDArray[Any]:
    """Return a new uninitialized array with the array shape and type of `points`, or (`batch`, V, 3) for a batch."""
    empty = _core.empty_float32 if points.dtype == np.float32 else _core.empty_float64
    if batch is None:
        return empty(*points.shape)
    return empty(batch * len(points), 3).reshape(batch, *points.shape)


def target(
    function: str, out: Any, points: NDArray[Any], inputs: dict[str, NDArray[Any] | None], batch: int | None = None
) -> NDArray[Any]:
    """Return the array for the posed vertices: `out`, or a new array if `out` is None."""
    if out is None:
        return empty_like(points, batch)
    shape = points.shape if batch is None else (batch, *points.shape)
    return tensors.output(function, out, shape, points.dtype, inputs)


def read_batch(function: str, name: str, value: Any, count: int) -> Float64:
    """Return `value` as a batch of transforms (B, `count`, 3, 4). If it is no batch, B is 1."""
    array = np.asarray(tensors.shared(function, name, value))
    if array.ndim != 4:
        return read_affine(function, name, array, count)[np.newaxis]
    if array.shape[1] != count or array.shape[2:] not in ((3, 4), (4, 4)):
        reason = f"must have shape (B, {count}, 3, 4) or (B, {count}, 4, 4), got {array.shape}"
        raise ArgumentError(name, reason, function)
    batch = len(array)
    return read_affine(function, name, array.reshape(-1, *array.shape[2:]), batch * count).reshape(batch, count, 3, 4)


def read_affine(function: str, name: str, value: Any, count: int | None) -> Float64:
    """Return `value` as transforms (`count`, 3, 4). If `count` is None, return a single transform (1, 3, 4)."""
    array = np.asarray(tensors.shared(function, name, value))
    if array.shape == (count, 3, 4) and array.dtype == np.float64 and array.flags.c_contiguous:
        return array  # the kernel checks that the numbers are finite
    if count is None:
        array = array[np.newaxis] if array.ndim == 2 else array
    elif array.size == 0 and count == 0:
        return np.zeros((0, 3, 4))
    if array.ndim != 3 or array.shape[1:] not in ((3, 4), (4, 4)) or len(array) != (1 if count is None else count):
        leading = "" if count is None else f"{count}, "
        shape = np.shape(value) if count is None else array.shape
        raise ArgumentError(name, f"must have shape ({leading}3, 4) or ({leading}4, 4), got {shape}", function)
    result = check.array(function, name, array, ("H", "R", 4), dtype=np.float64)
    error = np.abs(result[:, 3:] - (0.0, 0.0, 0.0, 1.0)).max(axis=(1, 2), initial=0.0)
    if error.max(initial=0.0) > 1e-6:
        found = result[error.argmax(), 3].tolist()
        raise ArgumentError(name, f"must have the bottom row [0, 0, 0, 1], got {found}", function)
    return np.ascontiguousarray(result[:, :3])


def handle_positions(
    function: str, handles: Any, vertices: NDArray[Any], weights: Float32
) -> tuple[Int64 | None, Float64]:
    """Return the vertices (H,) and positions (H, 3) of the handles. If positions are given, the vertices are None."""
    count = weights.shape[1]
    if handles is None:
        if len(vertices) == 0:
            return None, np.zeros((count, 3))
        indices = weights.argmax(axis=0)
    else:
        array = np.asarray(tensors.shared(function, "handles", handles))
        if array.ndim == 2:
            return None, check.array(function, "handles", array, (count, 3), dtype=np.float64)
        indices = check.vertex_indices(function, "handles", array, len(vertices))
        if len(indices) != count:
            reason = f"must have {count} entries, one per column of `weights`, got {len(indices)}"
            raise ArgumentError("handles", reason, function)
    return indices, np.ascontiguousarray(vertices[indices], np.float64)


def handle_weight_matrix(function: str, handle_weights: Any, weights: Float32, indices: Int64 | None) -> Float64:
    """Return the matrix (H, H) whose row j has the weights of all handles at the position of handle j."""
    count = weights.shape[1]
    if handle_weights is not None:
        return check.array(function, "handle_weights", handle_weights, (count, count), dtype=np.float64)
    if indices is None:
        if len(weights) == 0:
            return np.eye(count)
        raise ArgumentError("handle_weights", "must be given to interpolate, if `handles` are positions", function)
    return check.array(function, "weights", weights[indices], (count, count), dtype=np.float64)
