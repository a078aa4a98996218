"""Test the search for mirror planes: at any position, with asymmetric parts, and on asymmetric shapes."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from symmetry.shapes import FoldedField, about_y, creature, mirror_x, mirror_xz, table

import dfd
from dfd.mesh.mesh import Mesh
from dfd.symmetry import search
from dfd.symmetry.search import scored_planes

TURNS = [np.eye(3), *Rotation.random(3, random_state=7).as_matrix()]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("armed", [False, True])
def test_the_plane_is_found_however_the_shape_is_turned_and_armed(turn, armed):
    offset = (3.0, -1.0, 20.0)
    mesh = creature(turn, offset, armed=armed)
    planes = dfd.symmetry_planes(mesh, FoldedField(mirror_x, turn, offset))
    assert len(planes) == 1
    normal = turn[:, 0]
    along = abs(np.dot(planes[0].normal, normal))
    assert np.degrees(np.arccos(min(along, 1))) < (1.5 if armed else 0.3)
    height = planes[0].signed_distance([offset])[0]
    assert abs(height) < (0.03 if armed else 0.005)
    assert planes[0].relative_score < 0.1
    assert planes[0].band == pytest.approx(0.03 * mesh.extents.max())


def test_a_plane_that_is_nearly_of_the_coordinates_is_of_them():
    (plane,) = dfd.symmetry_planes(creature(), FoldedField(mirror_x))
    assert plane.normal == (1.0, 0.0, 0.0)
    assert plane.offset == 0.0
    assert plane.score == pytest.approx(0.0, abs=1e-5)
    (plane,) = dfd.symmetry_planes(creature(armed=True), FoldedField(mirror_x))
    assert plane.normal == (1.0, 0.0, 0.0)
    assert plane.offset == 0.0


def test_several_planes_are_ranked_and_merged():
    planes = dfd.symmetry_planes(table(4), FoldedField(about_y(4)))
    assert not planes  # the features have rotational symmetry, but no mirror plane
    both = dfd.symmetry_planes(table(4), FoldedField(mirror_xz))
    assert sorted(plane.normal for plane in both) == [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)]
    assert [plane.relative_score for plane in both] == sorted(plane.relative_score for plane in both)


def test_features_decide_and_not_the_form_alone():
    """Every plane through the center of a ball is a mirror plane, but its features have only one."""
    ball = trimesh.creation.icosphere(4)
    planes = dfd.symmetry_planes(Mesh(ball.vertices, ball.faces), FoldedField(mirror_x))
    assert [plane.normal for plane in planes] == [(1.0, 0.0, 0.0)]


def test_the_own_plane_of_a_flat_shape_is_none():
    plate = creature()
    flat = Mesh(plate.vertices * [1, 1, 0.02], plate.faces)
    planes = dfd.symmetry_planes(flat, FoldedField(mirror_x))
    assert [plane.normal for plane in planes] == [(1.0, 0.0, 0.0)]
    sheet = Mesh(plate.vertices * [1, 1, 0], plate.faces)
    assert [plane.normal for plane in dfd.symmetry_planes(sheet, FoldedField(mirror_x))] == [(1.0, 0.0, 0.0)]


def test_a_shape_without_symmetry_has_none():
    assert dfd.symmetry_planes(creature(armed=True), FoldedField(lambda points: points)) == []


def test_a_threshold_goes_by_the_score_of_the_paper():
    field, mesh = FoldedField(mirror_x), creature()
    planes = dfd.symmetry_planes(mesh, field, threshold=9.0)
    assert planes == scored_planes(field, mesh)
    (plane,) = dfd.symmetry_planes(mesh, field, threshold=0.1)
    reflected = np.linalg.norm(field(mesh.vertices) - field(plane.reflect(mesh.vertices)), axis=1).mean()
    assert plane.score == pytest.approx(reflected, abs=1e-6)


def test_the_planes_of_the_paper_stay_available():
    field, mesh = FoldedField(mirror_x), creature()
    planes = dfd.symmetry_planes(mesh, field, threshold=9.0, candidates="axes")
    assert sorted(plane.normal for plane in planes) == [(0, 0, 1), (0, 1, 0), (1, 0, 0)]
    assert all(plane.signed_distance([mesh.bounds.mean(axis=0)])[0] == pytest.approx(0, abs=1e-9) for plane in planes)
    (plane,) = dfd.symmetry_planes(mesh, field, candidates="axes")
    assert plane.normal == (1.0, 0.0, 0.0)


def test_the_score_of_the_paper_is_of_all_vertices(monkeypatch):
    monkeypatch.setattr(search, "_SCORED_VERTICES", 100)
    field, mesh = FoldedField(mirror_x), creature()
    for plane in dfd.symmetry_planes(mesh, field, threshold=9.0, candidates="axes"):
        apart = np.linalg.norm(field(mesh.vertices) - field(plane.reflect(mesh.vertices)), axis=1)
        assert plane.score == pytest.approx(apart.mean(), abs=1e-6)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_size_does_not_matter(scale):
    mesh = creature()
    field = FoldedField(mirror_x)
    (plane,) = dfd.symmetry_planes(Mesh(mesh.vertices * scale, mesh.faces), lambda points: field(points / scale))
    assert plane.normal == (1.0, 0.0, 0.0)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("change", [None, "doubled", "shifted", "smaller", "some alone", "most alone"])
def test_exactly_mirrored_vertices_give_the_exact_offset(axis, change):
    random = np.random.default_rng(2)
    one = random.random((100, 3))
    place, middle = one, 0.3
    if change == "shifted":
        place, middle = one - 0.7, 0.3 - 0.7
    if change == "smaller":
        place, middle = 0.01 * one, 0.003
    other = place.copy()
    other[:, axis] = 2 * middle - other[:, axis]
    more = {"doubled": place, "some alone": random.random((150, 3)), "most alone": random.random((250, 3))}
    vertices = random.permutation(np.concatenate([place, other, more.get(change, one[:0])]))
    found = search._offset_of_pairs(vertices, axis)
    assert found == (None if change == "most alone" else pytest.approx(middle, abs=1e-12))


@pytest.mark.parametrize("vertices", [np.zeros((3, 3)), np.eye(3), np.arange(9.0).reshape(3, 3)])
def test_meshes_of_one_face_or_none_with_an_area(vertices):
    planes = dfd.symmetry_planes(Mesh(vertices, [(0, 1, 2)]), FoldedField(lambda points: points))
    assert all(np.isfinite([*plane.normal, plane.offset, plane.score]).all() for plane in planes)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"threshold": -0.5}, "`threshold` must be at least 0, got -0.5"),
        ({"threshold": float("nan")}, "`threshold` must be finite"),
        ({"candidates": "all"}, "`candidates` must be one of any, axes, got 'all'"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(ValueError, match="symmetry_planes: " + message):
        dfd.symmetry_planes(creature(), FoldedField(mirror_x), **options)
