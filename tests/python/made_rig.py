"""Make a rigged shape with known joints."""

import numpy as np
import trimesh

import dfd
from bench.quality.anatomy import RiggedShape
from bench.quality.measures import area_fractions


def two_legs():
    """Return a body with two legs of two boxes each. Each box has one joint: root, leg.l, foot.l, leg.r, foot.r."""
    places = [(0, 4, 0), (-1, 2, 0), (-1, 0, 0), (1, 2, 0), (1, 0, 0)]
    sizes = [(6, 2, 2), (1, 1, 1), (1, 1, 1), (1, 1, 1), (1, 1, 1)]
    boxes = [trimesh.creation.box(size).apply_translation(at) for size, at in zip(sizes, places, strict=True)]
    made = trimesh.util.concatenate(boxes)
    mesh = dfd.Mesh(made.vertices, made.faces)
    names = ("root", "leg.l", "foot.l", "leg.r", "foot.r")
    return RiggedShape(
        "legs",
        mesh,
        area_fractions(mesh),
        names,
        np.array([-1, 0, 1, 0, 3]),
        np.repeat(np.arange(5), len(boxes[0].vertices)),
    )
