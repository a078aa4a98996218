"""Make closed tubes along any curve, to test bending."""

import numpy as np

from dfd import Mesh

AROUND = 24


def tube(points, radius=0.1):
    """Return a closed tube around `points` (K, 3), `radius` a number or (K,); ring k has vertices 24 k … 24 k + 23."""
    points = np.asarray(points, float)
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    beside = np.eye(3)[np.abs(along).max(axis=0).argmin()]
    across = np.cross(along, beside)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turn = np.arange(AROUND) * 2 * np.pi / AROUND
    around = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * np.cross(along, across)[:, None]
    rings = points[:, None] + np.broadcast_to(radius, len(points))[:, None, None] * around
    number = np.arange(len(points) * AROUND).reshape(-1, AROUND)
    a, b = number[:-1], np.roll(number, -1, axis=1)[:-1]
    c, d = number[1:], np.roll(number, -1, axis=1)[1:]
    sides = np.concatenate([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]).reshape(-1, 3)
    first, last = number.size, number.size + 1
    ends = [[first, (k + 1) % AROUND, k] for k in range(AROUND)]
    ends += [[last, number[-1, k], number[-1, (k + 1) % AROUND]] for k in range(AROUND)]
    vertices = np.concatenate([rings.reshape(-1, 3), points[:1], points[-1:]])
    return Mesh(vertices, np.concatenate([sides, ends]).astype(np.int32))


def straight(length=4.0, rings=81, radius=0.2):
    """Return a straight tube along +y from the origin."""
    along = np.linspace(0.0, length, rings)
    return tube(np.stack([0 * along, along, 0 * along], axis=1), radius)
