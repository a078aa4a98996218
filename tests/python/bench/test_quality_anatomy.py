"""Test the scores for subtrees and for pairs of joints, on boxes with known joints."""

import numpy as np
from made_rig import two_legs

from bench.quality.mirrored import pairs_of


def test_a_band_leaves_the_foot_behind():
    shape = two_legs()
    vertex = int(np.flatnonzero(shape.of_vertex == 1)[0])
    whole, left = shape.judge(vertex, np.isin(shape.of_vertex, [1, 2]))
    assert (whole, left) == (1.0, 0.0)
    band, left = shape.judge(vertex, shape.of_vertex == 1)
    assert np.allclose((band, left), 0.5)


def test_a_pair_is_judged_by_the_mirror_image_of_its_left_side():
    shape = two_legs()
    (leg, foot) = pairs_of(shape)
    assert leg.axis == foot.axis == 0
    assert set(leg.left) == set(np.flatnonzero(np.isin(shape.of_vertex, [1, 2])))
    moved = np.zeros((len(shape.mesh.vertices), 3))
    moved[foot.left], moved[foot.right] = (0.1, 0.2, 0), (-0.1, 0.2, 0)
    assert foot.error(moved) == 0
    moved[foot.right] = (0.1, 0.2, 0)
    assert np.isclose(foot.error(moved), 0.2 / foot.size)
