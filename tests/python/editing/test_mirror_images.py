"""Test which components of a part are mirror images of each other, and how accurate their planes are."""

import numpy as np
import pytest
from made_hook import hook, plane_of
from made_tube import tube

import dfd
from dfd.editing.influence.mirror_images import Component, component_of, mirror_image
from dfd.posing.transforms import rotation_matrix


def sampled(mesh: dfd.Mesh, vertices: np.ndarray) -> Component:
    found = component_of(vertices, mesh.faces)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def pair() -> tuple[Component, Component]:
    """Return a hook and its mirror image in `plane_of()`."""
    mesh = hook()
    return sampled(mesh, mesh.vertices), sampled(mesh, plane_of().reflect(mesh.vertices))


def error(found: np.ndarray | None, one: Component) -> float:
    """Return the largest distance between the image of a component and its true mirror image, in its sizes."""
    assert found is not None
    images = one.points @ found[:, :3].T + found[:, 3]
    return float(np.linalg.norm(images - plane_of().reflect(one.points), axis=1).max()) / one.size


def test_the_plane_of_the_shape_is_used_as_it_is_if_it_fits(pair):
    np.testing.assert_array_equal(mirror_image(*pair, [plane_of(60), plane_of()]), plane_of().reflection[:3])
    near = plane_of(0, 0.82)
    np.testing.assert_array_equal(mirror_image(*pair, [near]), near.reflection[:3])


@pytest.mark.parametrize("offset", [0.72, 0.9])
def test_a_plane_that_nearly_fits_is_improved(pair, offset):
    given = plane_of(0, offset)
    assert error(given.reflection[:3], pair[0]) > 0.1
    assert error(mirror_image(*pair, [given]), pair[0]) < 0.04


def test_a_plane_that_does_not_fit_is_no_mirror_image(pair):
    assert mirror_image(*pair, [plane_of(30), plane_of(0, 2.0)]) is None
    assert mirror_image(*pair, [plane_of(0, 0.95)]) is None  # it misses by 0.07 of the size


def test_without_planes_the_plane_between_both_is_found(pair):
    assert error(mirror_image(*pair, None), pair[0]) < 0.01


def test_a_moved_copy_is_no_mirror_image(pair):
    mesh, turn = hook(), rotation_matrix((0, 30, 0))
    assert mirror_image(pair[0], sampled(mesh, mesh.vertices @ turn.T + (2, 0, 1)), None) is None


def test_two_wheels_that_a_translation_maps_are_no_mirror_images():
    line = np.linspace(-0.1, 0.1, 9)
    wheel = tube(np.stack([line, 0 * line, 0 * line], axis=1), 0.5)
    assert mirror_image(sampled(wheel, wheel.vertices), sampled(wheel, wheel.vertices + (2, 0, 0)), None) is None


def test_two_components_at_one_place_have_no_plane_between_them(pair):
    assert mirror_image(pair[0], pair[0], None) is None


def test_ends_that_differ_do_not_move_the_plane(pair):
    """The mirror image lacks its tip, as if the border of the part were elsewhere on the other side."""
    mesh = hook()
    images = plane_of().reflect(mesh.vertices)
    cut = mesh.faces[(mesh.vertices[mesh.faces].max(axis=1) < (0.93, 9, 9)).all(axis=1)]
    other = component_of(images, cut)
    assert other is not None
    assert error(mirror_image(pair[0], other, [plane_of(0, 0.9)]), pair[0]) < 0.06


def test_faces_without_area_are_no_component():
    assert component_of(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32)) is None
