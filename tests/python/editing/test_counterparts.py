"""Counterparts: what looks like the handle moves about its own counterpart of the pivot."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest

from dfd import Mesh, SymmetryPlane
from dfd.editing.influence import counterparts
from dfd.editing.influence.counterparts import CounterpartFinder
from dfd.geometry import coarse
from dfd.posing.transforms import affine
from dfd.segmentation.parts import Grip

SIDE = 41  # vertices along a side of the sheet


def sheet(copies: int = 1) -> Mesh:
    """Flat sheets of side 2 around the origin, the second one 100 beside it."""
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
    squared = np.square(mesh.vertices - (x, 0, z)).sum(axis=1)
    return (height * np.exp(-squared / width**2)).astype(np.float32)


def vertex_at(mesh: Mesh, x: float, z: float) -> int:
    return int(np.linalg.norm(mesh.vertices - (x, 0, z), axis=1).argmin())


def find(mesh: Mesh, weights: np.ndarray, vertex: int, **planes: object) -> tuple[counterparts.Counterpart, ...]:
    return CounterpartFinder(mesh).find(weights, vertex, mesh.vertices[vertex], **planes)[0]  # type: ignore[arg-type]


def share(mesh: Mesh, one: counterparts.Counterpart) -> np.ndarray:
    return one.share.dense(len(mesh.vertices))


def test_a_single_hill_is_one_counterpart_that_has_everything():
    mesh = sheet()
    (only,) = find(mesh, hill(mesh, -0.5, 0, 1), vertex_at(mesh, -0.5, 0))
    assert only.share is None
    assert only.weight == 1
    np.testing.assert_array_equal(only.frame, np.eye(3))


def test_every_piece_of_a_part_is_one_counterpart_whatever_peaks_it_has():
    mesh = sheet()
    weights = hill(mesh, -0.5, -0.5, 1) + hill(mesh, -0.5, 0.5, 0.9) + hill(mesh, 0.5, 0, 0.02)
    pieces = np.where(mesh.vertices[:, 0] < -0.2, 1, np.where(mesh.vertices[:, 0] > 0.2, 0, -1))
    held = Grip(np.ones(len(pieces), np.float32), np.ones(len(pieces), np.float32), pieces)
    own, other = find(mesh, weights, vertex_at(mesh, -0.5, -0.5), grip=held)
    np.testing.assert_array_equal(share(mesh, own)[pieces == 1], 1)
    np.testing.assert_array_equal(share(mesh, other)[pieces == 0], 1)
    np.testing.assert_allclose(other.position, (0.5, 0, 0), atol=1e-12)
    np.testing.assert_allclose(share(mesh, own) + share(mesh, other), 1, atol=1e-6)
    beside, _ = find(mesh, weights, vertex_at(mesh, -0.1, 0.3), grip=held)
    np.testing.assert_array_equal(
        share(mesh, beside)[pieces == 1], 1, err_msg="held on the seam, it is of the nearest piece"
    )


def test_every_hill_is_an_counterpart_with_its_own_counterpart():
    mesh = sheet()
    weights = hill(mesh, -0.5, -0.5, 1) + hill(mesh, 0.5, -0.5, 0.9) + hill(mesh, 0.5, 0.5, 0.6)
    own, second, third = find(mesh, weights, vertex_at(mesh, -0.5, -0.5))
    np.testing.assert_allclose(own.position, (-0.5, 0, -0.5), atol=1e-12)
    np.testing.assert_allclose(second.position, (0.5, 0, -0.5), atol=1e-12)
    np.testing.assert_allclose(third.position, (0.5, 0, 0.5), atol=1e-12)
    assert (own.weight, second.weight, third.weight) == pytest.approx((1, 0.9, 0.6), abs=1e-3)


def test_all_peaks_of_a_piece_of_a_region_that_is_held_are_one_counterpart():
    mesh = sheet()
    weights = hill(mesh, -0.5, -0.5, 1) + hill(mesh, 0.5, -0.5, 1) + hill(mesh, 0.5, 0.5, 0.6)
    row = np.array([vertex_at(mesh, x, -0.5) for x in np.linspace(-0.5, 0.5, 21)])
    own, other = find(mesh, weights, row[0], held=row)
    np.testing.assert_allclose(other.position, (0.5, 0, 0.5), atol=1e-12)
    np.testing.assert_array_equal(share(mesh, own)[row[[0, -1]]], 1)
    own, second, third = find(mesh, weights, row[0], held=row[[0, 1, -2, -1]])
    np.testing.assert_allclose(own.position, mesh.vertices[row[:2]].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(second.position, mesh.vertices[row[-2:]].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(third.position, other.position, atol=1e-12)


def test_what_stands_inside_a_peak_of_another_component_is_part_of_it():
    """A hub within a wheel turns with it; beside it, or on the same surface, it is another one."""
    wheel, hub = sheet(), sheet()
    both = np.concatenate([wheel.faces, hub.faces + len(wheel.vertices)])

    def mesh(x: float) -> Mesh:
        # Far enough above that no bridge joins them.
        return Mesh(np.concatenate([wheel.vertices, 0.2 * hub.vertices + (x, 0.1, 0)]), both)

    def weights(shape: Mesh) -> np.ndarray:
        on_hub = 0.8 - np.abs(shape.vertices - shape.vertices[-1]).sum(axis=1) / 10
        large = 1 - np.linalg.norm(shape.vertices * (1, 0, 1), axis=1) / 3
        return np.where(np.arange(len(shape.vertices)) < len(wheel.vertices), large, on_hub).astype(np.float32)

    tilted = mesh(0.0)
    tilted_vertices = tilted.vertices.copy()
    tilted_vertices[: len(wheel.vertices), 1] = 0.3 * np.cos(4 * tilted_vertices[: len(wheel.vertices), 0])
    inside = Mesh(tilted_vertices, both)
    assert len(find(inside, weights(inside), vertex_at(inside, 0, 0))) == 1
    beside = mesh(5.0)
    assert len(find(beside, weights(beside), vertex_at(beside, 0, 0))) == 2


def test_shares_add_up_to_one_and_each_has_its_counterpart_to_itself():
    mesh = sheet()
    found = find(mesh, hill(mesh, -0.5, 0, 1) + hill(mesh, 0.5, 0, 0.9), vertex_at(mesh, -0.5, 0))
    shares = np.stack([share(mesh, each) for each in found])
    np.testing.assert_allclose(shares.sum(axis=0), 1, atol=1e-6)
    assert shares.min() >= 0
    for number, each in enumerate(found):
        assert shares[number, each.vertex] == 1


def test_shares_pass_smoothly_from_one_counterpart_to_the_next():
    mesh = sheet()
    own, _ = find(mesh, hill(mesh, -0.5, 0, 1) + hill(mesh, 0.5, 0, 0.9), vertex_at(mesh, -0.5, 0))
    along = share(mesh, own).reshape(SIDE, SIDE)
    assert np.abs(np.diff(along, axis=0)).max() < 0.2
    assert np.abs(np.diff(along, axis=1)).max() < 0.2


def test_ripples_on_a_hill_are_no_counterparts():
    mesh = sheet()
    ripples = 0.01 * np.sin(60 * mesh.vertices[:, 0]).astype(np.float32)
    assert len(find(mesh, hill(mesh, 0, 0, 1) + ripples, vertex_at(mesh, 0, 0))) == 1


def test_what_is_hardly_alike_goes_with_the_nearest_counterpart():
    mesh = sheet()
    assert len(find(mesh, hill(mesh, -0.5, 0, 1) + hill(mesh, 0.5, 0, 0.06), vertex_at(mesh, -0.5, 0))) == 1


def test_what_is_little_alike_and_far_away_does_not_swing_on_a_long_lever():
    """A twelfth of a turn at the handle, and a hill a tenth as alike at the other end of the sheet."""
    mesh = sheet()
    weights = hill(mesh, -0.8, 0, 1) + hill(mesh, 0.8, 0, 0.1)
    own, other = find(mesh, weights, vertex_at(mesh, -0.8, 0))
    assert other.position == pytest.approx((0.8, 0, 0))
    top = np.array([0.8, 0, 0])
    linear, shift = np.split(
        other.transform(affine(rotation=(0, 30, 0), pivot=own.position), own.position), [3], axis=1
    )
    np.testing.assert_allclose(linear @ top + shift[:, 0], top, atol=1e-12)


def test_across_a_plane_of_symmetry_the_frame_is_mirrored():
    mesh = sheet()
    plane = SymmetryPlane((1.0, 0.0, 0.0), 0.0)
    # The second hill's top is a little off the mirror image, as a field's own roughness would have it.
    weights = np.maximum(hill(mesh, -0.5, 0.2, 1), hill(mesh, 0.55, 0.2, 0.95))
    own, other = find(mesh, weights, vertex_at(mesh, -0.5, 0.2), planes=[plane])
    np.testing.assert_array_equal(other.frame, np.diag([-1.0, 1.0, 1.0]))
    np.testing.assert_allclose(other.position, plane.reflect([own.position])[0], atol=1e-12)
    moved = other.transform(affine(translation=(0.1, 0.2, 0.3)), own.position)
    np.testing.assert_allclose(moved, affine(translation=(-0.1, 0.2, 0.3)), atol=1e-12)


def test_components_far_apart_are_counterparts_too():
    mesh = sheet(copies=2)
    weights = hill(mesh, 0, 0, 1) + hill(mesh, 100, 0, 1)
    own, other = find(mesh, weights, vertex_at(mesh, 0, 0))
    assert np.isfinite(share(mesh, own)).all()
    on_the_first = mesh.vertices[:, 0] < 50
    np.testing.assert_array_equal(share(mesh, own)[on_the_first], 1)
    np.testing.assert_array_equal(share(mesh, other)[~on_the_first], 1)


def test_a_fine_mesh_is_gathered_into_nodes_and_has_the_same_counterparts():
    mesh = sheet()
    weights = hill(mesh, -0.5, -0.5, 1) + hill(mesh, 0.5, -0.5, 0.9) + hill(mesh, 0.5, 0.5, 0.6)
    vertex = vertex_at(mesh, -0.5, -0.5)
    exact = find(mesh, weights, vertex)
    with mock.patch.object(coarse, "MOST_NODES", 1000), mock.patch.object(coarse, "CELLS", 12):
        finder = CounterpartFinder(mesh)
        gathered, _ = finder.find(weights, vertex, mesh.vertices[vertex])
        assert finder._nodes.graph.shape[0] < 200
    assert [each.vertex for each in gathered] == [each.vertex for each in exact]
    np.testing.assert_allclose(sum(share(mesh, each) for each in gathered), 1, atol=1e-5)
    for one, other in zip(gathered, exact, strict=True):
        assert np.abs(share(mesh, one) - share(mesh, other)).mean() < 0.04


def test_a_handle_that_holds_nothing_has_only_itself():
    mesh = sheet()
    (only,) = find(mesh, np.zeros(len(mesh.vertices), np.float32), 7)
    assert (only.vertex, only.weight, only.share) == (7, 0.0, None)


def test_a_soup_of_triangles_is_searched_in_one_pass():
    """Thousands of components, a peak each: time that grows with their square would be minutes."""
    generator = np.random.default_rng(0)
    middles = generator.random((12_000, 1, 3)) * 100
    vertices = (middles + generator.random((12_000, 3, 3)) * 1e-3).reshape(-1, 3)
    mesh = Mesh(vertices, np.arange(36_000).reshape(-1, 3))
    weights = np.repeat(generator.uniform(0.1, 0.9, 12_000), 3).astype(np.float32)
    weights[:3] = 1
    found = find(mesh, weights, 0)
    assert 1 < len(found) <= counterparts.MOST_COUNTERPARTS
    assert np.array_equal(found[0].position, mesh.vertices[0])
    held = find(mesh, weights, 0, held=np.arange(9_000))
    assert len(held) == counterparts.MOST_COUNTERPARTS
