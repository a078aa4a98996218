"""Test the polar decomposition of linear maps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dfd.posing.polar import polar_decomposition

LINE = np.array([[0.0, 1, 0], [0, 0, 0], [0, 0, 0]])  # (x, y, z) -> (y, 0, 0)


def _parts(maps):
    """Return the rotations (N, 3, 3) and stretches (N, 3, 3) of `maps` (N, 3, 3)."""
    rows = polar_decomposition(np.asarray(maps, np.float64))
    xx, yy, zz, yz, zx, xy = rows[:, 4:].T
    stretch = np.array([[xx + 1, xy, zx], [xy, yy + 1, yz], [zx, yz, zz + 1]]).transpose(2, 0, 1)
    assert (rows[:, 0] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, :4], axis=1), 1, atol=1e-14)
    return Rotation.from_quat(rows[:, :4], scalar_first=True).as_matrix(), stretch


def test_a_rotation_times_a_stretch_gives_the_map():
    maps = np.random.default_rng(5).normal(size=(2000, 3, 3))
    for some in (maps, 1e150 * maps, np.concatenate([LINE[None], maps[:9] * [1, 1, 0], maps[:9, :1] * maps[9:18]])):
        rotation, stretch = _parts(some)
        np.testing.assert_allclose(rotation @ stretch, some, atol=1e-12 * np.abs(some).max())
        np.testing.assert_allclose(np.linalg.det(rotation), 1)


@pytest.mark.parametrize("x", [2.0, 0.5, 0.0, -1.0, 1e100])
def test_a_map_that_only_stretches_has_exactly_no_rotation(x):
    for diagonal in ([1, 1, 1], [x, 1, 1], [x, x, 1], [x, x, x], [x, 1.5, 2.5]):
        row = polar_decomposition(np.diag(diagonal)[None].astype(float))[0]
        turned = x < 0 and diagonal.count(x) == 2  # a half turn, not a mirror image
        assert turned or row[:4].tolist() == [1, 0, 0, 0]
        assert turned or row[4:].tolist() == [*(np.array(diagonal) - 1.0), 0, 0, 0]


def test_a_rotation_has_exactly_no_stretch():
    assert not polar_decomposition(Rotation.random(200, rng=np.random.default_rng(1)).as_matrix())[:, 4:].any()


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_a_singular_map_has_the_smallest_rotation_that_it_permits(rank):
    random = np.random.default_rng(rank)
    for goal in Rotation.from_rotvec(random.uniform(-0.8, 0.8, (30, 3))):
        direction = np.linalg.qr(random.normal(size=(3, 3)))[0][:, :rank]
        rotation, _ = _parts((goal.as_matrix() @ direction @ direction.T)[None])
        np.testing.assert_allclose(rotation[0] @ direction, goal.as_matrix() @ direction, atol=1e-12)
        assert Rotation.from_matrix(rotation[0]).magnitude() <= goal.magnitude() + 1e-7


def test_a_mirroring_map_has_the_smaller_of_four_rotations():
    for map_ in np.random.default_rng(3).normal(size=(50, 3, 3)):
        if np.linalg.det(map_) > 0:
            continue
        u, _, vt = np.linalg.svd(map_)
        flips = [np.diag(signs) for signs in ([-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1])]
        rotation, _ = _parts(map_[None])
        np.testing.assert_allclose(np.trace(rotation[0]), max(np.trace(u @ flip @ vt) for flip in flips), atol=1e-12)


def test_a_map_that_is_not_finite_is_left_to_the_kernel():
    assert polar_decomposition(np.full((1, 3, 3), np.nan)).tolist() == [[1.0] + [0.0] * 9]
