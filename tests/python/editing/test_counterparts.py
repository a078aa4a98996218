"""Test how counterparts are found, their frames, and their shares of the weights."""

from unittest import mock

import numpy as np
import pytest
import trimesh
from made_hook import hook, plane_of

from dfd import Mesh, SymmetryPlane
from dfd.editing.weights.by_features import shares_everywhere
from dfd.editing.weights.counterparts import find_counterparts
from dfd.editing.weights.fill import Counterpart
from dfd.editing.weights.held_part import HeldPart, hold
from dfd.geometry import coarse
from dfd.geometry.coarse import nodes_of
from dfd.posing.transforms import Transform

SIDE = 41  # number of vertices along one side of a sheet


def sheet(copies: int = 1) -> Mesh:
    """Return flat square sheets with sides of length 2. The first is centered at the origin, the second at x = 100."""
    line = np.linspace(-1, 1, SIDE)
    x, z = np.meshgrid(line, line, indexing="ij")
    one = np.column_stack([x.ravel(), np.zeros(SIDE * SIDE), z.ravel()])
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + SIDE], 1), np.stack([corner + 1, corner + SIDE + 1, corner + SIDE], 1)]
    )
    vertices = np.concatenate([one + (100.0 * copy, 0, 0) for copy in range(copies)])
    return Mesh(vertices, np.concatenate([faces + copy * len(one) for copy in range(copies)]))


def hill(mesh: Mesh, x: float, z: float, height: float, width: float = 0.25) -> np.ndarray:
    """Return weights (V,) that fall from `height` at the point (x, 0, z) to 0 around it."""
    squared = np.square(mesh.vertices - (x, 0, z)).sum(axis=1)
    return (height * np.exp(-squared / width**2)).astype(np.float32)


def vertex_at(mesh: Mesh, x: float, z: float) -> int:
    return int(np.linalg.norm(mesh.vertices - (x, 0, z), axis=1).argmin())


def around(mesh: Mesh, *places: tuple[float, float]) -> np.ndarray:
    """Return the component (V,) of each vertex: the index of the place (x, z) within 0.25 of the vertex, or −1."""
    found = np.full(len(mesh.vertices), -1)
    for number, (x, z) in enumerate(places):
        found[np.linalg.norm(mesh.vertices - (x, 0, z), axis=1) < 0.25] = number
    return found


def find(
    mesh: Mesh, weights: np.ndarray, vertex: int, component: np.ndarray, *planes: SymmetryPlane
) -> list[Counterpart]:
    """Return the counterparts of a handle on component 0."""
    found = find_counterparts(mesh, component, vertex, mesh.vertices[vertex], weights, planes)
    return [one for _, one in found]


def everywhere(mesh: Mesh, component: np.ndarray) -> np.ndarray:
    """Return the share (K, V) of each component at every vertex."""
    shares = shares_everywhere(HeldPart((), nodes_of(mesh), component), mesh.diagonal)
    return np.stack([each.dense(len(mesh.vertices)) for each in shares])


def test_counterparts_are_the_most_similar_vertices_of_their_components():
    mesh = sheet()
    weights = hill(mesh, -0.5, -0.5, 1) + hill(mesh, 0.5, -0.5, 0.8) + hill(mesh, 0.5, 0.5, 0.9)
    component = around(mesh, (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5))
    component[(component > 0) & (weights < 0.75)] = -1  # they are smaller, so no translation maps one onto the other
    own, second, third = find(mesh, weights, vertex_at(mesh, -0.5, -0.5), component)
    np.testing.assert_allclose(own.position, (-0.5, 0, -0.5), atol=1e-12)
    np.testing.assert_allclose(second.position, (0.5, 0, 0.5), atol=1e-12)
    np.testing.assert_allclose(third.position, (0.5, 0, -0.5), atol=1e-12)


@pytest.mark.parametrize("handle_on_hub", [False, True])
def test_a_component_inside_another_component_joins_it(handle_on_hub):
    """A hub inside a tire joins the component of the tire. A hub beside the tire is a separate component."""
    wheel, ball = sheet(), trimesh.creation.icosphere(2, 0.2)
    # The distance in y is so large that no bridge connects the two.
    tire = wheel.vertices + 0.3 * np.cos(4 * wheel.vertices[:, :1]) * (0, 1, 0)
    both = np.concatenate([wheel.faces, ball.faces + len(wheel.vertices)])

    def counted(hub: np.ndarray) -> int:
        mesh = Mesh(np.concatenate([tire, hub]), both)
        on_hub = np.arange(len(mesh.vertices)) >= len(wheel.vertices)
        component = (on_hub != handle_on_hub).astype(np.int64)
        weights = np.ones(len(mesh.vertices), np.float32)
        vertex = int(np.flatnonzero(component == 0)[0])
        held = hold(mesh, component, vertex, mesh.vertices[vertex], weights)
        return len(held.components)

    assert counted(ball.vertices + (0, 0.1, 0)) == 1
    assert counted(ball.vertices + (0.6, 0.1, 0)) == 1
    assert counted(ball.vertices + (5, 0.1, 0)) == 2
    # The center of the tire lies in the box of a long bar, but the center of the bar does not lie in that of the tire.
    assert counted(ball.vertices * (50, 3, 1) + (9.5, 0.1, 0)) == 2


def test_shares_everywhere_sum_to_1_change_smoothly_and_are_1_on_their_own_components():
    mesh = sheet()
    component = around(mesh, (-0.5, 0), (0.5, 0))
    shares = everywhere(mesh, component)
    np.testing.assert_allclose(shares.sum(axis=0), 1, atol=1e-6)
    assert shares.min() >= 0
    for number in (0, 1):
        np.testing.assert_array_equal(shares[number, component == number], 1)
    along = shares[0].reshape(SIDE, SIDE)
    assert np.abs(np.diff(along, axis=0)).max() < 0.2
    assert np.abs(np.diff(along, axis=1)).max() < 0.2


def test_across_a_plane_of_symmetry_the_frame_is_mirrored():
    mesh = sheet()
    plane = SymmetryPlane((1.0, 0.0, 0.0), 0.0)
    # With a noisy field, the maximum on the other side is not exactly at the mirror image.
    weights = np.maximum(hill(mesh, -0.5, 0.2, 1), hill(mesh, 0.55, 0.2, 0.95))
    # One component lacks a piece, so the components are no mirror images. The frame then depends on the given plane.
    component = around(mesh, (-0.5, 0.2), (0.5, 0.2))
    component[(component == 1) & (mesh.vertices[:, 2] > 0.21)] = -1
    own, other = find(mesh, weights, vertex_at(mesh, -0.5, 0.2), component, plane)
    np.testing.assert_array_equal(other.frame, np.diag([-1.0, 1.0, 1.0]))
    np.testing.assert_allclose(other.position, plane.reflect([own.position])[0], atol=1e-12)
    moved = other.transform(Transform(translation=(0.1, 0.2, 0.3)).matrix(), own.position)
    np.testing.assert_allclose(moved, Transform(translation=(-0.1, 0.2, 0.3)).matrix(), atol=1e-12)


@pytest.mark.parametrize(("less", "mirrored"), [(0.04, True), (0.06, False)])
def test_the_mirror_image_of_a_handle_is_its_counterpart_unless_another_place_is_clearly_more_similar(less, mirrored):
    mesh, plane = sheet(), SymmetryPlane((1.0, 0.0, 0.0), 0.0)
    weights = np.maximum(hill(mesh, -0.5, 0.2, 1), hill(mesh, 0.5, 0.2, 0.9 - less, 0.1))
    best = vertex_at(mesh, 0.6, 0.05)
    weights[best] = 0.9
    component = around(mesh, (-0.5, 0.2), (0.5, 0.2))
    component[(component == 1) & (mesh.vertices[:, 2] > 0.21)] = -1
    _, other = find(mesh, weights, vertex_at(mesh, -0.5, 0.2), component, plane)
    assert other.vertex == (vertex_at(mesh, 0.5, 0.2) if mirrored else best)
    np.testing.assert_array_equal(other.frame, np.diag([-1.0, 1.0, 1.0]))


def test_components_far_apart_are_counterparts_too():
    mesh = sheet(copies=2)
    weights = hill(mesh, 0, 0, 1) + hill(mesh, 100, 0, 1)
    component = (mesh.vertices[:, 0] > 50).astype(np.int64)
    own, other = find(mesh, weights, vertex_at(mesh, 0, 0), component)
    np.testing.assert_allclose(np.subtract(other.position, own.position), (100, 0, 0), atol=2e-3)
    shares, on_the_first = everywhere(mesh, component), mesh.vertices[:, 0] < 50
    np.testing.assert_array_equal(shares[0, on_the_first], 1)
    np.testing.assert_array_equal(shares[1, ~on_the_first], 1)


def test_a_piece_without_a_component_follows_the_nearest_ones_more():
    """The pieces lie at x = 0, 100 and 200, and no surface connects them. The last one has no component."""
    mesh = sheet(copies=3)
    component = np.repeat([0, 1, -1], SIDE * SIDE)
    shares = everywhere(mesh, component)[:, component < 0]
    near, far = 1 + 99 / mesh.diagonal, 1 + 199 / mesh.diagonal
    left = near**2 / far**2 - 0.03
    np.testing.assert_allclose(shares[0], left / (left + 0.97), atol=0.01)


def test_counterparts_on_clustered_nodes_are_the_same_as_on_vertices():
    mesh = sheet()
    weights = hill(mesh, -0.5, -0.5, 1) + hill(mesh, 0.5, -0.5, 0.9) + hill(mesh, 0.5, 0.5, 0.6)
    vertex = vertex_at(mesh, -0.5, -0.5)
    component = around(mesh, (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5))

    def found() -> tuple[list[Counterpart], np.ndarray]:
        nodes = nodes_of(mesh)
        of_node = component[nodes.members[nodes.starts]]
        return find(mesh, weights, vertex, of_node), everywhere(mesh, of_node)

    exact, shares = found()
    with mock.patch.object(coarse, "MOST_NODES", 1000), mock.patch.object(coarse, "CELLS", 20):
        assert len(nodes_of(mesh).center) < 500
        clustered, clustered_shares = found()
    assert [each.vertex for each in clustered] == [each.vertex for each in exact]
    np.testing.assert_allclose(clustered_shares.sum(axis=0), 1, atol=1e-5)
    assert np.abs(clustered_shares - shares).mean() < 0.04


def test_a_mirror_image_of_a_mirror_image_has_the_product_of_both_reflections():
    """The third hook is no mirror image of the first one, but of the second one, in a plane that no origin lies on."""
    first, second = plane_of(), SymmetryPlane((0.0, 0.0, 1.0), 3.0)
    one = hook()
    images = [one.vertices, first.reflect(one.vertices)]
    images.append(second.reflect(images[1]))
    faces = np.concatenate([one.faces + number * len(one.vertices) for number in range(3)])
    mesh = Mesh(np.concatenate(images), faces)
    component = np.repeat(np.arange(3), len(one.vertices))
    weights = np.linspace(1, 0.5, len(mesh.vertices)).astype(np.float32)
    _, middle, last = find(mesh, weights, 700, component, first, second)
    np.testing.assert_array_equal(middle.image, first.reflection[:3])
    np.testing.assert_allclose(last.image, (second.reflection @ first.reflection)[:3], atol=1e-12)
    np.testing.assert_allclose(last.position, images[2][700], atol=1e-9)
    assert last.vertex == 2 * len(one.vertices) + 700


def test_a_counterpart_is_a_vertex_of_its_own_component():
    """A ball at the mirror image of the handle, 1 % beside the image of its hook, is a component of its own."""
    plane, one, ball = plane_of(), hook(), trimesh.creation.icosphere(radius=0.02)
    images = [one.vertices, plane.reflect(one.vertices) + 0.005]
    ball.apply_translation(plane.reflect(one.vertices[[700]])[0] - ball.vertices[0])
    faces = [one.faces, one.faces + len(one.vertices), ball.faces + 2 * len(one.vertices)]
    mesh = Mesh(np.concatenate([*images, ball.vertices]), np.concatenate(faces))
    component = np.repeat(np.arange(3), [len(one.vertices), len(one.vertices), len(ball.vertices)])
    _, other, _ = find(mesh, np.linspace(1, 0.5, len(mesh.vertices)).astype(np.float32), 700, component, plane)
    np.testing.assert_array_equal(other.image, plane.reflection[:3])
    assert component[other.vertex] == 1


def test_a_round_counterpart_turns_about_its_own_center():
    """The rear wheel is larger than the front wheel, so it is no mirror image. Its most similar vertex is anywhere."""
    wheels = [trimesh.creation.cylinder(radius, 0.2, sections=48) for radius in (0.5, 0.8)]
    wheels[1].apply_translation((3, 0.3, 0.1))
    both = trimesh.util.concatenate(wheels)
    mesh = Mesh(both.vertices, both.faces)
    component = nodes_of(mesh).component.astype(int)
    at = int(mesh.vertices[component == 0][:, 1].argmax())
    weights = np.random.default_rng(0).uniform(0.5, 1, len(mesh.vertices)).astype(np.float32)
    _, rear = find(mesh, weights, at, component)
    turned = Transform(rotation=(0, 0, 70), pivot=(0, 0, 0)).matrix()
    moved = rear.transform(turned, mesh.vertices[at])
    np.testing.assert_allclose(moved[:, :3] @ (3, 0.3, 0.1) + moved[:, 3], (3, 0.3, 0.1), atol=0.01)
