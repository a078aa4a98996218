"""Edits as values."""

import math

import pytest
from sheet import grid

from dfd.editing.edit import Edit, Fixed, Handle, symmetry_on
from dfd.editing.points import Place, place_on


@pytest.fixture(scope="module")
def mesh():
    return grid(9)


def test_two_handles_at_one_place_are_refused(mesh):
    with pytest.raises(ValueError, match="`handles` must lie at distinct places, got two at 4: handle 1 and handle 2"):
        Edit((Handle(1, place_on(mesh, 4)), Handle(2, place_on(mesh, 4))))


def test_a_place_is_fixed_once(mesh):
    with pytest.raises(ValueError, match="`fixed` must be free places, but 4 is fixed already"):
        Edit(fixed=(Fixed(place_on(mesh, 4)), Fixed(place_on(mesh, 4))))


def test_places_are_named_as_the_command_line_takes_them(mesh):
    assert str(place_on(mesh, 4)) == "4"
    assert str(Place((0.5, -1.0, 2.0))) == "0.5,-1,2"


def test_a_place_follows_its_vertex_to_the_mesh_at_hand(mesh):
    assert place_on(mesh, Place((0.0, 0.0, 0.0), 4)) == place_on(mesh, 4)


@pytest.mark.parametrize("at", [81, -1, 2.0, True, "four", (1, 2), (1, 2, math.nan), None, [[1, 2, 3]]])
def test_what_is_no_place_is_refused(mesh, at):
    with pytest.raises(ValueError, match="`at` must"):
        place_on(mesh, at)


@pytest.mark.parametrize(
    ("plane", "band", "message"),
    [
        ("w", None, "`plane` must be like x, x=0.1 or 0.6,0,0.8=0.1, got 'w'"),
        (1, None, "`plane` must be a text such as x or x=0.1, or a SymmetryPlane, got int"),
        ("x", -1, "`band` must be at least 0, got -1"),
        ("x", math.nan, "`band` must be finite"),
    ],
)
def test_what_is_no_plane_is_refused(mesh, plane, band, message):
    with pytest.raises(ValueError, match=message):
        symmetry_on(mesh, plane, band)


def test_a_band_of_zero_is_the_paper_s_hard_cut(mesh):
    assert symmetry_on(mesh, "x", 0).band == 0.0
