"""Divide linear maps into a stretch and a rotation, which are blended separately."""

import numpy as np

from dfd.common.linear_algebra import Bool, Float64

ROUNDING = 1e-12  # smaller entries of a stretch, minus the identity, are rounding errors
SINGULAR = 1e-14  # a singular value below this fraction of the largest one counts as 0


def polar_decomposition(maps: Float64) -> Float64:
    """Return the polar decomposition A = R S of each of `maps` (N, 3, 3), as rows (N, 10) for the kernel.

    A row has the unit quaternion (w, x, y, z) of the rotation R, with w >= 0, and the entries xx, yy, zz, yz, zx, xy of
    the symmetric stretch S, minus the identity. If A mirrors, S reflects along one of its axes or along all three,
    whichever makes R the smaller rotation. If A is singular, R is as small as A permits. The row of a map that is not
    finite is that of the identity.
    """
    from scipy.spatial.transform import Rotation

    if not len(maps):
        return np.empty((0, 10))
    finite = np.isfinite(maps).all(axis=(1, 2), keepdims=True)
    u, sizes, v = _singular_values(np.where(finite, maps, np.eye(3)))
    signs = _reflection(np.einsum("nij,nij->nj", u, v), np.linalg.det(u) * np.linalg.det(v) < 0, sizes)
    rotation = Rotation.from_matrix((u * signs[:, None]) @ v.transpose(0, 2, 1)).as_quat(scalar_first=True)
    rotation[rotation[:, 0] < 0] *= -1
    stretch = (v * (signs * sizes - 1)[:, None]) @ v.transpose(0, 2, 1)
    stretch[np.abs(stretch) < ROUNDING] = 0
    return np.concatenate([rotation, stretch[:, [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]]], axis=1)


def _singular_values(maps: Float64) -> tuple[Float64, Float64, Float64]:
    """Return U (N, 3, 3), singular values (N, 3) and V (N, 3, 3), with U as near to V as singular `maps` permit."""
    u, sizes, vt = np.linalg.svd(maps)
    known = ~_vanish(sizes)
    if not known.all():
        # Each map minus its null space is a rotation from V to U. Between both null spaces, the smallest one is added.
        u, v = u * known[:, None], vt.transpose(0, 2, 1) * known[:, None]
        free = (np.eye(3) - u @ u.transpose(0, 2, 1)) @ (np.eye(3) - v @ v.transpose(0, 2, 1))
        left, _, right = np.linalg.svd(u @ v.transpose(0, 2, 1) + free)
        u = left @ right @ vt.transpose(0, 2, 1)
    return u, sizes, vt.transpose(0, 2, 1)


def _vanish(sizes: Float64) -> Bool:
    """Return which of the singular values `sizes` (N, 3) count as 0."""
    return np.asarray(sizes <= SINGULAR * sizes[:, :1], bool)


def _reflection(agreement: Float64, mirrored: Bool, sizes: Float64) -> Float64:
    """Return signs (N, 3) of the singular values: all 1, or where a map is `mirrored` (N,), a reflection.

    `agreement` (N, 3) are the products of the columns of U and V. Their sum is the trace of R, which is larger for
    smaller rotations. The reflection is along a direction whose singular value vanishes, if there is one.
    """
    candidates = 1 - 2 * np.vstack([np.eye(3), np.ones(3)])
    traces = agreement @ candidates.T
    singular = _vanish(sizes)
    traces[(singular.sum(axis=1, keepdims=True) > 0) & ~np.pad(singular, ((0, 0), (0, 1)))] = -np.inf
    return np.where(mirrored[:, None], candidates[traces.argmax(axis=1)], 1.0)
