"""Rotational symmetry: the axis and the order of tables, and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from symmetry.shapes import FoldedField, about_y, creature, mirror_x, table

from dfd.mesh.mesh import Mesh
from dfd.symmetry.rotation import RotationalSymmetry, rotational_symmetries

TURN = Rotation.random(random_state=3).as_matrix()


@pytest.mark.parametrize("legs", [3, 4, 5])
@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_the_axis_and_the_order_of_a_table(legs: int, turn: np.ndarray) -> None:
    offset = (2.0, 0.0, -1.0)
    (found,) = rotational_symmetries(FoldedField(about_y(legs), turn, offset), table(legs, turn, offset))
    assert found.order == legs
    assert abs(np.dot(found.axis, turn[:, 1])) > np.cos(np.radians(0.5))
    beside = np.cross(np.asarray(found.point) - offset, turn[:, 1])
    assert np.linalg.norm(beside) < 0.01
    assert found.score < 0.1
    assert found.relative_score < 0.1


def test_a_shape_that_only_has_a_mirror_plane_has_none() -> None:
    assert rotational_symmetries(FoldedField(mirror_x), creature()) == []
    assert rotational_symmetries(FoldedField(about_y(2)), Mesh(np.zeros((3, 3)), [(0, 1, 2)])) == []


def test_turns_are_turns() -> None:
    symmetry = RotationalSymmetry((0, 0, 1), (1, 0, 5), 4)
    assert np.allclose(symmetry.rotate([[2, 0, 0]]), [[1, 1, 0]])
    assert np.allclose(symmetry.rotate([[2, 0, 0]], steps=-1), [[1, -1, 0]])
    assert symmetry.transforms.shape == (4, 3, 4)
    assert np.allclose(symmetry.transforms[0], np.eye(3, 4))
    points = np.random.default_rng(0).normal(size=(9, 3))
    turned = points
    for _ in range(4):
        turned = symmetry.rotate(turned)
    assert np.allclose(turned, points)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0, 0, 1), (0, 0, 0), 1), "`order` must be a whole number of at least 2, got 1"),
        (((0, 0, 1), (0, 0, 0), 2.0), "`order` must be a whole number, got 2.0"),
        (((0, 1, 1), (0, 0, 0), 2), "`axis` must have length 1"),
        (((0, 0, 1), (0, np.nan, 0), 2), "`point` must be finite"),
    ],
)
def test_what_is_no_rotation_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ValueError, match="RotationalSymmetry: " + message):
        RotationalSymmetry(*arguments)


def test_a_bad_threshold_is_refused() -> None:
    with pytest.raises(ValueError, match="rotational_symmetries: `threshold` must be at least 0, got -1"):
        rotational_symmetries(FoldedField(mirror_x), creature(), threshold=-1)
