"""Define array types, and compute unit vectors, sums by group, distinct pairs and principal directions."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Bool = NDArray[np.bool_]
Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
UInt8 = NDArray[np.uint8]


def unit(rows: NDArray[np.floating], *, least: float = 0.0) -> Float64:
    """Return the rows (N, D) scaled to length 1; rows whose length is at most `least` become 0."""
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, lengths, out=np.zeros(np.shape(rows)), where=lengths > least, casting="same_kind")


def group_sums(group: NDArray[np.integer], rows: NDArray[np.floating], count: int) -> Float64:
    """Return the sum of `rows` (N, D) in each group, (`count`, D). Row i belongs to the group with index `group[i]`."""
    return np.stack([np.bincount(group, column, count) for column in rows.T], axis=1)


def distinct_pairs(pairs: NDArray[np.integer], count: int) -> tuple[Int64, Int64]:
    """Return the distinct pairs (E, 2) in `pairs` (N, 2), and the index (N,) of each of `pairs` among them.

    The entries are integers from 0 to `count` − 1. Pairs that differ only in the order of their entries are equal. The
    distinct pairs are sorted, each with its lower entry first.
    """
    low, high = np.sort(pairs, axis=1).astype(np.int64).T
    keys, which = np.unique(low * count + high, return_inverse=True)
    return np.stack(np.divmod(keys, count), axis=1), which.reshape(-1)


Real = TypeVar("Real", np.float32, np.float64)


def principal_directions(rows: NDArray[Real], count: int | None = None) -> NDArray[Real]:
    """Return the eigenvectors of RᵀR, where R is `rows` (N, D), in the order from largest to smallest eigenvalue.

    The eigenvectors are the orthonormal rows of the result, (min(`count`, D), D), or (D, D) if `count` is None. If the
    mean of `rows` is 0, the eigenvectors are the directions of the principal components.
    """
    axes: NDArray[Real] = np.linalg.eigh(rows.T @ rows)[1].T[::-1]
    return np.ascontiguousarray(axes[:count])


def nearest_rotations(matrices: Float64) -> Float64:
    """Return the rotations (G, 3, 3) nearest to matrices with a positive determinant; the identity for all others.

    The method: Higham, "Computing the Polar Decomposition", 1986.
    """
    found = unit(matrices.reshape(-1, 9)).reshape(-1, 3, 3)
    regular = np.linalg.det(found) > 1e-6
    found[~regular] = np.eye(3)
    for _ in range(12):  # Newton's iteration converges quadratically
        cofactors = np.cross(found[:, [1, 2, 0]], found[:, [2, 0, 1]])
        found = (found + cofactors / np.einsum("gi,gi->g", found[:, 0], cofactors[:, 0])[:, None, None]) / 2
    return found
