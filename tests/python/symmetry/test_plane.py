"""Test mirror planes: their reflections, and planes as text."""

import numpy as np
import pytest
from symmetry.shapes import creature

from dfd.symmetry.plane import SymmetryPlane, axis_plane, plane_from_text


def test_reflection_and_distance_agree():
    normal = np.array([1.0, 2.0, -2.0]) / 3
    plane = SymmetryPlane(tuple(normal), 0.7)
    points = np.random.default_rng(0).normal(size=(20, 3))
    mirrored = plane.reflect(points)
    np.testing.assert_allclose(plane.signed_distance(mirrored), -plane.signed_distance(points), atol=1e-12)
    np.testing.assert_allclose(np.cross(mirrored - points, normal), 0, atol=1e-12)
    np.testing.assert_allclose(plane.reflect(mirrored), points, atol=1e-12)


def test_axis_plane_stands_at_the_center_of_the_box():
    assert axis_plane(creature(offset=(5, 0, 0)), "x").offset == pytest.approx(5.0)
    with pytest.raises(ValueError, match="`axis` must be one of x, y, z, got 'w'"):
        axis_plane(creature(), "w")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((1, 1, 0), 0.0), "`normal` must have length 1"),
        (((1, 0), 0.0), r"`normal` must have shape \(3,\)"),
        (((1, 0, 0), float("nan")), "`offset` must be finite, got nan"),
        (((1, 0, 0), 0.0, 0.0, 0.0, -1.0), "`band` must be at least 0, got -1"),
    ],
)
def test_a_plane_that_is_none_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        SymmetryPlane(*arguments)


@pytest.mark.parametrize(
    ("text", "normal", "offset"),
    [
        ("x", (1, 0, 0), 5.0),
        (" y ", (0, 1, 0), None),
        ("x=0.1", (1, 0, 0), 0.1),
        ("z = -2e-1", (0, 0, 1), -0.2),
        ("0.6,0,0.8=0.5", (0.6, 0, 0.8), 0.5),
        ("0, 0, 7 = 1", (0, 0, 1), 1.0),
    ],
)
def test_planes_as_people_write_them(text, normal, offset):
    mesh = creature(offset=(5, 0, 0))
    plane = plane_from_text(text, mesh)
    assert plane.normal == pytest.approx(normal)
    assert offset is None or plane.offset == pytest.approx(offset)
    assert plane.band == pytest.approx(0.03 * mesh.extents.max())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("w", "must have the form x, x=0.1 or 0.6,0,0.8=0.1, got 'w'"),
        ("", "must have the form"),
        ("x=", "must have the form"),
        ("1,2=0", "must have the form"),
        ("x=1=2", "must have the form"),
        ("0,0,0=1", "must have a normal other than 0, got '0,0,0=1'"),
        ("x=nan", "must have finite numbers"),
    ],
)
def test_what_is_no_plane_is_refused(text, message):
    with pytest.raises(ValueError, match="plane_from_text: `text` " + message):
        plane_from_text(text, creature())
