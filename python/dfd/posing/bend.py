"""Bend and twist along a curve; each cross-section moves rigidly, so the thickness does not change."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from dfd.common.linear_algebra import Float64

FINE = 512  # steps of the curve; at a joint of 90°, a step rotates by one or two degrees
EASE = 0.25  # share of the length over which a bend begins gradually, so that the base has no corner
LEAST_JOINT = 0.06  # smallest half width of a joint, relative to the length


def bend_maps(nodes: Float64, radius: Float64, bend: ArrayLike, twist: float, joint: float | None = None) -> Float64:
    """Return the rigid maps (513, 3, 4) of the cross-sections at equal steps along a curve; the first is the identity.

    The cross-section at s rotates by R(s) T(s): a share R of the bend, and a share T of the twist about the curve. The
    point c(s) of the curve moves to c̃(s) = c(0) + ∫ R c′, and a point p of the cross-section to
    c̃(s) + R(s) T(s) (p − c(s)).

    Parameters
    ----------
    nodes
        (K, 3) the resting curve at equal steps of its length, from base to tip.
    radius
        (K,) the mean distance of the surface from the curve.
    bend
        (3,) the rotation of the tip, as a rotation vector in degrees.
    twist
        The rotation of the tip about the curve, in degrees.
    joint
        The position on the curve, in [0, 1], of the whole rotation; None distributes it over the length.
    """
    at, fine = np.linspace(0.0, 1.0, len(nodes)), np.linspace(0.0, 1.0, FINE + 1)
    curve = np.stack([np.interp(fine, at, axis) for axis in nodes.T], axis=1)
    steps = np.diff(curve, axis=0)
    length = float(np.linalg.norm(steps, axis=1).sum())
    whole = np.radians(np.asarray(bend, np.float64))
    if not (whole.any() or twist):
        return np.tile(np.eye(3, 4), (FINE + 1, 1, 1))
    if joint is None:
        eased = np.where(fine < EASE, fine**2 / (2 * EASE), fine - EASE / 2)
        turned = eased / eased[-1]
    else:
        # With a narrower joint, the surface on the inner side of the bend would cross itself.
        thick = float(np.interp(joint, at, radius)) / max(length, 1e-300)
        half = max(LEAST_JOINT, thick * max(0.75, 0.9 * float(np.linalg.norm(whole))))
        ramp = np.clip((fine - joint + half) / (2 * half), 0.0, 1.0)
        turned = ramp * ramp * (3 - 2 * ramp)
        turned = (turned - turned[0]) / max(turned[-1] - turned[0], 1e-12)
    turn = Rotation.from_rotvec(turned[:, None] * whole).as_matrix()
    middle = Rotation.from_rotvec((turned[1:] + turned[:-1])[:, None] / 2 * whole)
    moved = curve[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(middle.apply(steps), axis=0)])
    if twist:
        along = np.gradient(curve, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        turn = turn @ Rotation.from_rotvec(np.radians(twist) * turned[:, None] * along).as_matrix()
    maps = np.concatenate([turn, (moved - np.einsum("kij,kj->ki", turn, curve))[:, :, None]], axis=2)
    maps[turned == 0.0] = np.eye(3, 4)  # the exact identity leaves positions unchanged to the bit
    return maps


class Sections:
    """Vertices with positions on a curve, which the maps of its cross-sections move.

    Parameters
    ----------
    vertices
        (N,) indices.
    parameter
        (N,) the position of each vertex on the curve, in [0, 1].
    """

    def __init__(self, vertices: NDArray[np.integer], parameter: NDArray[np.floating]) -> None:
        moving = np.flatnonzero(parameter > 0)
        moving = moving[np.argsort(parameter[moving], kind="stable")]
        self.vertices = vertices[moving]
        at = np.asarray(parameter[moving], np.float64) * FINE
        self._below = np.minimum(at.astype(np.int64), FINE - 1)
        above = at - self._below
        self._shares = np.stack([1 - above, above], axis=1)
        self._columns = (4 * self._below[:, None] + np.arange(8)).astype(np.int32).ravel()
        self._rows = np.arange(0, 8 * len(moving) + 1, 8, dtype=np.int32)
        self._rest = np.full((len(moving), 3), np.nan)  # the resting positions of the previous call
        self._products = np.empty(8 * len(moving))  # the shares times these positions

    def move(self, points: Float64, maps: Float64) -> None:
        """Move the vertices in `points` (V, 3), in place, by interpolating the two nearest of `maps` (513, 3, 4)."""
        turns = (maps != np.eye(3, 4)).any(axis=(1, 2))
        first = int(np.searchsorted(self._below, int(turns.argmax()) - 1)) if turns.any() else len(self._below)
        rest = points[self.vertices]
        if not np.array_equal(rest, self._rest):  # they are equal during a drag
            self._rest = rest
            placed = np.concatenate([rest, np.ones((len(rest), 1))], axis=1)
            self._products = (self._shares[:, :, None] * placed[:, None]).ravel()
        # A row holds a position, (x, y, z, 1), times the shares of both maps. So one product moves all vertices.
        entries = self._products[8 * first :], self._columns[8 * first :], self._rows[: len(rest) - first + 1]
        each = csr_array(entries, shape=(len(rest) - first, maps.size // 3))
        points[self.vertices[first:]] = each @ maps.transpose(0, 2, 1).reshape(-1, 3)
