"""Test which components of a part are mirror images of each other, and how accurate their planes are."""

import numpy as np
import pytest
from made_hook import hook, plane_of
from made_tube import tube
from scipy.spatial import cKDTree

from dfd.posing.transforms import rotation_matrix
from dfd.symmetry import pair as module
from dfd.symmetry.fit import SurfaceSamples, fitted, samples_of
from dfd.symmetry.pair import isometry
from dfd.symmetry.plane import SymmetryPlane


def sampled(mesh, vertices):
    return samples_of(vertices, mesh.faces)


@pytest.fixture(scope="module")
def pair():
    """Return a hook and its mirror image in `plane_of()`."""
    mesh = hook()
    return sampled(mesh, mesh.vertices), sampled(mesh, plane_of().reflect(mesh.vertices))


def error(found, one):
    """Return the largest distance between the image of a component and its true mirror image, in its sizes."""
    images = one.points @ found[:, :3].T + found[:, 3]
    return float(np.linalg.norm(images - plane_of().reflect(one.points), axis=1).max()) / one.size


def test_the_plane_of_the_shape_is_used_as_it_is_if_it_fits(pair):
    np.testing.assert_array_equal(isometry(*pair, [plane_of(60), plane_of()]), plane_of().reflection[:3])
    near = plane_of(0, 0.82)
    np.testing.assert_array_equal(isometry(*pair, [near]), near.reflection[:3])


@pytest.mark.parametrize("offset", [0.72, 0.9])
def test_a_plane_that_nearly_fits_is_improved(pair, offset):
    given = plane_of(0, offset)
    assert error(given.reflection[:3], pair[0]) > 0.1
    assert error(isometry(*pair, [given]), pair[0]) < 0.04


def test_a_plane_that_does_not_fit_is_no_mirror_image(pair):
    assert isometry(*pair, [plane_of(30), plane_of(0, 2.0)]) is None
    assert isometry(*pair, [plane_of(0, 0.95)]) is None  # it misses by 0.07 of the size


def test_without_planes_the_plane_between_both_is_found(pair):
    assert error(isometry(*pair, None), pair[0]) < 0.01


def test_a_rotated_copy_is_neither_a_mirror_image_nor_a_translation(pair):
    mesh, turn = hook(), rotation_matrix((0, 30, 0))
    assert isometry(pair[0], sampled(mesh, mesh.vertices @ turn.T + (2, 0, 1)), None) is None


def test_of_two_wheels_the_translation_is_found_and_not_a_mirror_image():
    line = np.linspace(-0.1, 0.1, 9)
    wheel = tube(np.stack([line, 0 * line, 0 * line], axis=1), 0.5)
    found = isometry(sampled(wheel, wheel.vertices), sampled(wheel, wheel.vertices + (2, 0, 0)), None)
    np.testing.assert_allclose(found, np.column_stack([np.eye(3), (2, 0, 0)]), atol=1e-6)


def test_two_components_at_one_place_have_no_plane_between_them(pair):
    assert isometry(pair[0], pair[0], None) is None


def test_ends_that_differ_do_not_move_the_plane(pair):
    """The mirror image lacks its tip, as if the border of the part were elsewhere on the other side."""
    mesh = hook()
    images = plane_of().reflect(mesh.vertices)
    cut = mesh.faces[(mesh.vertices[mesh.faces].max(axis=1) < (0.93, 9, 9)).all(axis=1)]
    other = samples_of(images, cut)
    assert error(isometry(pair[0], other, [plane_of(0, 0.9)]), pair[0]) < 0.06


def test_faces_without_area_are_no_component():
    assert samples_of(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)) is None


@pytest.mark.parametrize(("lean", "reflected"), [(0.05, True), (0.0, False)])
def test_a_plane_must_fit_better_by_a_quarter_than_a_translation(lean, reflected):
    """A short tube leans, and its mirror image has waves, so neither fits exactly."""
    line = np.linspace(-0.5, 0.5, 40)
    one = tube(np.stack([line, lean * (np.sin(3 * line) + line), 0 * line], axis=1), 0.2 + 0.1 * lean * line)
    image = one.vertices * (-1, 1, 1) + (2, 0, 0)
    waves = 0.1 * np.sin(9 * image[:, :1] + 2) * (0, 0, 1)
    found = isometry(sampled(one, one.vertices), sampled(one, image + waves), None)
    assert found is not None
    assert (np.linalg.det(found[:, :3]) < 0) == reflected


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_the_plane_between_two_components_does_not_depend_on_the_unit(unit):
    mesh, plane = hook(), plane_of()
    one, other = (sampled(mesh, unit * points) for points in (mesh.vertices, plane.reflect(mesh.vertices)))
    found = isometry(one, other, None)
    np.testing.assert_allclose(found[:, :3], plane.reflection[:3, :3], atol=0.01)
    np.testing.assert_allclose(found[:, 3] / unit, plane.reflection[:3, 3], atol=0.01)


def reflected(one, plane):
    """Return the exact mirror images of the samples of a component."""
    points = plane.reflect(one.points)
    normals = one.normals @ plane.reflection[:3, :3]
    return SurfaceSamples(points, normals, cKDTree(points), one.size)


@pytest.mark.parametrize(("angle", "offset"), [(0, 0.8), (4, 0.85), (12, 0.7)])
def test_the_fit_finds_the_exact_plane_between_exact_mirror_images(pair, angle, offset):
    start = plane_of(angle, offset)
    found = fitted(pair[0], reflected(pair[0], plane_of()), start)
    assert error(found.reflection[:3], pair[0]) < 1e-9


def test_a_mirror_image_of_another_size_is_none():
    mesh = hook()
    larger = plane_of().reflect(1.4 * mesh.vertices)
    assert isometry(sampled(mesh, mesh.vertices), sampled(mesh, larger), None) is None


@pytest.mark.parametrize(("apart", "found"), [(0.0008, False), (0.0015, True)])
def test_components_must_be_apart_by_a_thousandth_of_their_size(pair, apart, found):
    one, normal = pair[0], np.asarray(plane_of().normal)
    plane = SymmetryPlane(tuple(normal), float(one.points.mean(axis=0) @ normal) + apart * one.size / 2)
    assert (isometry(one, reflected(one, plane), None) is not None) == found


def test_the_misfit_is_the_distance_from_tangent_planes_nearby_and_from_samples_elsewhere():
    """Two flat strips, of which one is twice as long, and a third one beside them."""
    random = np.random.default_rng(0)

    def strip(length, height):
        points = np.column_stack([random.uniform(0, length, 800), random.uniform(0, 0.3, 800), np.full(800, height)])
        return SurfaceSamples(points, np.tile([0.0, 0, 1], (800, 1)), cKDTree(points), float(np.hypot(length, 0.3)))

    one, long, above = strip(1, 0), strip(2, 0), strip(1, 0.05)
    assert module._misfit(one, above, np.eye(3, 4)) == pytest.approx(0.05 / one.size, rel=1e-6)
    apart = one.tree.query(long.points)[0]
    squares = np.sort(np.square(np.where(apart > 0.1 * one.size, apart, 0)))[: int(0.85 * 800)]
    wanted = np.sqrt(squares.mean()) / one.size
    assert wanted > 0.2
    assert module._misfit(one, long, np.eye(3, 4)) == pytest.approx(wanted, rel=1e-6)
    assert module._misfit(long, one, np.eye(3, 4)) == pytest.approx(wanted * one.size / long.size, rel=1e-6)
