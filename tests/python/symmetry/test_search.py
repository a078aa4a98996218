"""Symmetry planes: reflections that are reflections, and the true plane among three."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import dfd
from dfd.symmetry.plane import SymmetryPlane, axis_name, axis_plane
from dfd.symmetry.search import scored_planes


class MirrorField:
    """Features that know |x − 5| and y and z: alike across the plane x = 5 and across no other."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        x, y, z = (np.asarray(points) - [5.0, 0.0, 0.0]).T
        rows = np.stack([np.abs(x), y, z, np.ones(len(x))], 1)
        return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


@pytest.fixture
def cloud() -> SimpleNamespace:
    vertices = np.random.default_rng(3).uniform(-1, 1, (500, 3)) + [5.0, 0.0, 0.0]
    vertices = np.concatenate([vertices, vertices * [-1, 1, 1] + [10.0, 0, 0]])
    return SimpleNamespace(vertices=vertices, bounds=np.array([vertices.min(0), vertices.max(0)]))


def test_only_the_true_plane_is_found(cloud: SimpleNamespace) -> None:
    (plane,) = dfd.symmetry_planes(MirrorField(), cloud)
    assert plane.normal == (1.0, 0.0, 0.0)
    assert plane.offset == pytest.approx(5.0)
    assert plane.score == pytest.approx(0.0, abs=1e-6)
    scores = [other.score for other in scored_planes(MirrorField(), cloud)]
    assert scores == sorted(scores)
    assert scores[1] > 0.3


def test_a_large_threshold_takes_every_plane(cloud: SimpleNamespace) -> None:
    assert len(dfd.symmetry_planes(MirrorField(), cloud, threshold=2.0)) == 3


class HalfMirrorField:
    """Features that know |x − 5| and a little of its sign, and of y and z; `tilt` says how little of y's sign."""

    def __init__(self, tilt: float) -> None:
        self.tilt = tilt

    def __call__(self, points: np.ndarray) -> np.ndarray:
        x, y, z = (np.asarray(points) - [5.0, 0.0, 0.0]).T
        rows = np.stack([np.abs(x) + 0.01 * x, np.abs(y) + self.tilt * y, z, np.ones(len(x))], 1)
        return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize(("tilt", "found"), [(0.012, ["x", "y"]), (0.09, ["x"])])
def test_a_plane_far_less_alike_than_the_best_is_none(cloud: SimpleNamespace, tilt: float, found: list[str]) -> None:
    field = HalfMirrorField(tilt)
    assert scored_planes(field, cloud)[1].score < 0.1
    assert [axis_name(plane.normal) for plane in dfd.symmetry_planes(field, cloud)] == found
    # The paper's rule, asked for by its ε, takes both.
    assert len(dfd.symmetry_planes(field, cloud, threshold=0.1)) == 2


def test_reflection_matrix_and_distance_agree() -> None:
    normal = np.array([1.0, 2.0, -2.0]) / 3
    plane = SymmetryPlane(tuple(normal), 0.7)
    points = np.random.default_rng(0).normal(size=(20, 3))
    mirrored = plane.reflect(points)
    np.testing.assert_allclose(plane.signed_distance(mirrored), -plane.signed_distance(points), atol=1e-12)
    np.testing.assert_allclose(points @ plane.matrix()[:, :3].T + plane.matrix()[:, 3], mirrored, atol=1e-12)
    np.testing.assert_allclose(plane.reflect(mirrored), points, atol=1e-12)


def test_axis_plane_stands_at_the_box_centre(cloud: SimpleNamespace) -> None:
    assert axis_plane(cloud, "x").offset == pytest.approx(5.0)
    with pytest.raises(ValueError, match="`axis` must be x, y or z, got 'w'"):
        axis_plane(cloud, "w")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((1, 1, 0), 0.0), "`normal` must have length 1"),
        (((1, 0), 0.0), r"`normal` must have shape \(3,\)"),
        (((1, 0, 0), float("nan")), "`offset` must be finite, got nan"),
        (((1, 0, 0), 0.0, 0.0, 0.0, -1.0), "`band` must be at least 0, got -1"),
    ],
)
def test_a_plane_that_is_none_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SymmetryPlane(*arguments)


def test_a_bad_threshold_is_refused(cloud: SimpleNamespace) -> None:
    with pytest.raises(ValueError, match="`threshold` must be at least 0, got -0.5"):
        dfd.symmetry_planes(MirrorField(), cloud, threshold=-0.5)
