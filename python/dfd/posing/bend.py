"""Bend and twist a part along a curve. Each cross-section moves rigidly, so the part keeps its thickness."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from dfd.common.linear_algebra import Float64

STEPS = 512  # number of steps into which the curve is divided
EASE = 0.25  # fraction of the length, from the base, over which a bend begins gradually, so that there is no crease
LEAST_JOINT = 0.06  # smallest half length of a joint, as a fraction of the curve's length


def bend_maps(nodes: Float64, radius: Float64, bend: ArrayLike, twist: float, joint: float | None = None) -> Float64:
    """Return the rigid maps (513, 3, 4) of the cross-sections at equal steps along a curve; the first is the identity.

    The cross-section at the point c(s) of the curve rotates by R(s) T(s). R(s) is a fraction of the bend. T(s) is the
    same fraction of the twist, about the tangent of the curve. The point c(s) moves to c̃(s) = c(0) + ∫ R c′, and a
    point p of the cross-section moves to c̃(s) + R(s) T(s) (p − c(s)).

    Parameters
    ----------
    nodes
        (K, 3) points of the curve before the bend, at equal distances along it, from base to tip.
    radius
        (K,) root mean squared distance of the surface from each of these points, in the unit of `nodes`.
    bend
        (3,) the rotation of the tip, as a rotation vector in degrees.
    twist
        The rotation of the tip about the curve, in degrees.
    joint
        The position of a joint on the curve, from base (0) to tip (1). None distributes the rotation over the length.
    """
    at, fine = np.linspace(0.0, 1.0, len(nodes)), np.linspace(0.0, 1.0, STEPS + 1)
    curve = np.stack([np.interp(fine, at, axis) for axis in nodes.T], axis=1)
    steps = np.diff(curve, axis=0)
    length = float(np.linalg.norm(steps, axis=1).sum())
    rotation = np.radians(np.asarray(bend, np.float64))
    if not (rotation.any() or twist):
        return np.tile(np.eye(3, 4), (STEPS + 1, 1, 1))
    if joint is None:
        eased = np.where(fine < EASE, fine**2 / (2 * EASE), fine - EASE / 2)
        share = eased / eased[-1]
    else:
        # With a shorter joint, the surface on the inner side of the bend would intersect itself.
        thick = float(np.interp(joint, at, radius)) / max(length, 1e-300)
        half = max(LEAST_JOINT, thick * max(0.75, 0.9 * float(np.linalg.norm(rotation))))
        ramp = np.clip((fine - joint + half) / (2 * half), 0.0, 1.0)
        share = ramp * ramp * (3 - 2 * ramp)
        share = (share - share[0]) / max(share[-1] - share[0], 1e-12)
    turns = Rotation.from_rotvec(share[:, None] * rotation).as_matrix()
    middle = Rotation.from_rotvec((share[1:] + share[:-1])[:, None] / 2 * rotation)
    moved = curve[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(middle.apply(steps), axis=0)])
    if twist:
        along = np.gradient(curve, axis=0)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        turns = turns @ Rotation.from_rotvec(np.radians(twist) * share[:, None] * along).as_matrix()
    maps = np.concatenate([turns, (moved - np.einsum("kij,kj->ki", turns, curve))[:, :, None]], axis=2)
    maps[share == 0.0] = np.eye(3, 4)  # the exact identity keeps positions bit for bit
    return maps


def turn_maps(center: Float64, turn: Float64) -> Float64:
    """Return rigid maps (513, 3, 4): rotations about `center` (3,) by equal steps up to the vector `turn`, degrees."""
    share = np.linspace(0.0, 1.0, STEPS + 1)[:, None]
    turns = Rotation.from_rotvec(share * np.radians(turn)).as_matrix()
    return np.concatenate([turns, (center - turns @ center)[:, :, None]], axis=2)


class Sections:
    """Vertices that follow the cross-sections of a curve.

    Parameters
    ----------
    vertices
        (N,) vertex indices.
    parameter
        (N,) position on the curve, in [0, 1], of the cross-section that each vertex follows. Vertices at 0 do not move.
    """

    def __init__(self, vertices: NDArray[np.integer], parameter: NDArray[np.floating]) -> None:
        moving = np.flatnonzero(parameter > 0)
        moving = moving[np.argsort(parameter[moving], kind="stable")]
        self.vertices = vertices[moving]
        at = np.asarray(parameter[moving], np.float64) * STEPS
        self._below = np.minimum(at.astype(np.int64), STEPS - 1)
        above = at - self._below
        self._shares = np.stack([1 - above, above], axis=1)  # weights of the two nearest maps of each vertex
        self._columns = (4 * self._below[:, None] + np.arange(8)).astype(np.int32).ravel()
        self._rows = 8 * np.arange(len(moving) + 1, dtype=np.int32)
        self._rest = np.full((len(moving), 3), np.nan)  # the positions in the previous call of `move`
        self._products = np.empty(8 * len(moving))  # these positions (x, y, z, 1), multiplied by `_shares`

    def move(self, points: Float64, maps: Float64) -> None:
        """Move the vertices in `points` (V, 3), in place. `maps` (513, 3, 4) are interpolated at their parameters."""
        moves = (maps != np.eye(3, 4)).any(axis=(1, 2))
        first = int(np.searchsorted(self._below, int(moves.argmax()) - 1)) if moves.any() else len(self._below)
        rest = points[self.vertices]
        if not np.array_equal(rest, self._rest):  # during a drag, the positions are those of the previous call
            self._rest = rest
            placed = np.concatenate([rest, np.ones((len(rest), 1))], axis=1)
            self._products = (self._shares[:, :, None] * placed[:, None]).ravel()
        # A row of the matrix has a position (x, y, z, 1) twice, multiplied by the shares of the two nearest maps.
        entries = self._products[8 * first :], self._columns[8 * first :], self._rows[: len(rest) - first + 1]
        each = csr_array(entries, shape=(len(rest) - first, maps.size // 3))
        points[self.vertices[first:]] = each @ maps.transpose(0, 2, 1).reshape(-1, 3)
