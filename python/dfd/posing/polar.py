"""Divide transforms into a stretch, a rotation and a translation, which are blended separately."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dfd.common.linear_algebra import Bool, Float64

ROUNDING = 1e-12  # smaller entries of a stretch, minus the identity, are rounding errors
SINGULAR = 1e-14  # a singular value below this fraction of the largest one counts as 0
LEAST_COSINE = 1e-9  # least real part of a quaternion by which its imaginary part is divided


class Motions(NamedTuple):
    """Affine transforms p ↦ p + `change` p + `shift`, and the rotations in them."""

    change: Float64  # (N, 3, 3) linear part minus the identity
    shift: Float64  # (N, 3) mesh units
    places: Float64  # (N, 3) centers of the stretches; with `pivoted`, also of the rotations
    turns: Float64  # (N, 3) rotation vectors in radians; rotations by more than half a turn are kept
    pivoted: bool  # whether a displacement of the place is a translation, instead of a part of a screw motion

    def mirrored(self, reflection: Float64) -> Motions:
        """Return the mirror images of the transforms. `reflection` is the matrix (3, 4) of the mirror plane."""
        linear, across = reflection[:, :3], reflection[:, 3]
        return Motions(
            linear @ self.change @ linear,
            (self.change @ across + self.shift) @ linear.T,
            self.places @ linear.T + across,
            -self.turns @ linear.T,  # a reflection reverses the direction of rotation
            self.pivoted,
        )

    def towards(self, turn: Float64) -> Motions:
        """Return the transforms, rotated the way that is nearer to `turn` (3,), of the two ways up to one turn."""
        angle = np.linalg.norm(self.turns, axis=1, keepdims=True)
        other = self.turns * (1 - 2 * np.pi / np.where(angle > 0, angle, np.inf))
        goal = _quaternions(turn[None] / 2)[0]
        nearer = _quaternions(other / 2) @ goal > _quaternions(self.turns / 2) @ goal
        return self._replace(turns=np.where(nearer[:, None] & (angle > 0), other, self.turns))

    def rows(self) -> Float64:
        """Return rows (N, 19) of `dfd::Polar`: half of the rotation, its shift, the stretch, its shift, a translation.

        The row of a transform that is not finite is that of the identity.
        """
        with np.errstate(all="ignore"):
            rows = self._rows()
        rows[~np.isfinite(rows).all(axis=1)] = [1.0] + [0.0] * 18
        return rows

    def _rows(self) -> Float64:
        whole = _turned(_quaternions(self.turns), np.eye(3)[:, None] - 0.0).transpose(1, 2, 0)  # R − I
        stretch = self.change + np.einsum("nji,njk->nik", whole, self.change + np.eye(3))  # RᵀA − I
        stretch[np.abs(stretch) < ROUNDING] = 0
        half, places = _quaternions(self.turns / 2), self.places
        moved = np.einsum("nij,nj->ni", self.change, places) + self.shift
        if self.pivoted:
            shift, translation = -_turned(half, places), moved
        else:  # with the matrix H of half of the rotation, the shift is (I + H)⁻¹ times that of the whole rigid motion
            rigid = moved - np.einsum("nij,nj->ni", whole, places)
            tangent = half[:, 1:] / np.maximum(half[:, :1], LEAST_COSINE)
            shift, translation = (rigid - np.cross(tangent, rigid)) / 2, np.zeros_like(rigid)
        entries = stretch[:, [0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]]
        stretch_shift = -np.einsum("nij,nj->ni", stretch, places)
        return np.concatenate([half, shift, entries, stretch_shift, translation], axis=1)


def turns_of(maps: Float64) -> Float64:
    """Return the rotation vectors (N, 3), in radians, of the polar decompositions A = R S of `maps` (N, 3, 3)."""
    rows = polar_decomposition(maps)
    sine = np.linalg.norm(rows[:, 1:4], axis=1, keepdims=True)
    angle = 2 * np.arctan2(sine, rows[:, :1])
    return np.asarray(rows[:, 1:4] * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0))


def _quaternions(turns: Float64) -> Float64:
    """Return the unit quaternions w, x, y, z (N, 4) of rotation vectors (N, 3) in radians; their signs are kept."""
    angle = np.linalg.norm(turns, axis=1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), turns * (np.sinc(angle / (2 * np.pi)) / 2)], axis=1)


def _turned(quaternions: Float64, points: Float64) -> Float64:
    """Return R p − p (..., N, 3) for the rotations R of `quaternions` (N, 4) and `points` p (..., N, 3)."""
    w, v = quaternions[:, :1], quaternions[:, 1:]
    return np.asarray(2 * np.cross(v, w * points + np.cross(v, points)), np.float64)


def polar_decomposition(maps: Float64) -> Float64:
    """Return the polar decomposition A = R S of each of `maps` (N, 3, 3), as rows (N, 10).

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
