"""Make a table, and a probe that finds the up direction from the surface alone, without pictures."""

from dataclasses import replace

import numpy as np

import dfd
from dfd.upright.probe import FORMS, TERMS, VECTORS, UpProbe

TABLE_LEGS = ((-0.9, -0.4), (-0.9, 0.4), (0.9, -0.4), (0.9, 0.4))


def box(low, high):
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def table():
    """Return an upright table with +y up, which is longer along x than along z."""
    parts = [box((-1, 0.9, -0.5), (1, 1.0, 0.5))]
    parts += [box((x - 0.05, 0, z - 0.05), (x + 0.05, 0.9, z + 0.05)) for x, z in TABLE_LEGS]
    vertices = np.concatenate([corners for corners, _ in parts])
    faces = np.concatenate([faces + 8 * number for number, (_, faces) in enumerate(parts)])
    return dfd.Mesh(vertices, faces)


def probe_of(encoder, **changes):
    """Return a probe without weights for pictures: only stability, faces that face up, and mirror planes count."""
    odds = np.zeros(len(TERMS))
    odds[[TERMS.index("stable"), TERMS.index("facing up"), TERMS.index("mirrors flat")]] = 15.0, 7.5, 30.0
    own = encoder.settings()
    plain = UpProbe(
        np.zeros(encoder.dimension, np.float32),
        np.zeros((len(FORMS), encoder.dimension), np.float32),
        np.zeros((len(VECTORS), encoder.dimension), np.float32),
        np.stack([odds] * 3),
        0.0,
        0.0,
        0.0,
        str(own["encoder_weights"]),
        int(own["encoder_block"]),
    )
    return replace(plain, **changes)
