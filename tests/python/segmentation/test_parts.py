"""Test the parts at a vertex or a point, on samples with labeled parts and noisy features that depend on the label."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from made_field import field_of, looks

import dfd
from dfd.segmentation.parts import Parts
from dfd.segmentation.patches import Patches


def parts_of(sample):
    rows = looks(sample, 0.2)
    return Parts(sample.mesh, lambda vertices: rows[vertices])


def foot_of(chair):
    """Return the lowest vertex of a leg."""
    leg = chair.vertices_of("leg", 0)
    return int(leg[chair.mesh.vertices[leg, 1].argmin()])


def overlap(one, other):
    """Return the intersection over union of two masks (V,)."""
    return (one & other).sum() / (one | other).sum()


@pytest.fixture(scope="module")
def chair():
    return dfd.samples.chair(4_000)


@pytest.fixture(scope="module")
def chair_parts(chair):
    return parts_of(chair)


@pytest.fixture(scope="module")
def chair_cut(chair_parts):
    return chair_parts.cut()


def test_the_part_at_a_vertex_includes_its_counterparts_unless_alike_is_false(chair, chair_parts):
    legs = chair.labels == chair.parts.index("leg")
    one_leg, tip = chair.vertices_of("leg", 0), foot_of(chair)
    found = chair_parts.part(tip)
    assert overlap(found.mask, legs) > 0.85
    assert found.components == 4
    assert found.mask[tip]
    assert found.vertex == tip
    alone = chair_parts.part(tip, follow="none")
    assert overlap(alone.mask, np.isin(np.arange(len(legs)), one_leg)) > 0.85
    assert alone.components == 1
    assert alone.share == pytest.approx(found.share / 4, rel=0.1)


def test_a_point_stands_for_the_vertex_nearest_to_it(chair, chair_parts):
    at = chair_parts.part(chair.mesh.vertices[100] + 1e-6)
    assert np.array_equal(at.mask, chair_parts.part(100).mask)
    assert at.vertex == 100
    assert np.array_equal(at.vertices, np.flatnonzero(at.mask))


def test_parts_of_higher_levels_contain_those_of_lower_levels(chair, chair_parts):
    levels = range(-3, 4)
    for vertex in range(0, len(chair.mesh.vertices), 211):
        found = [chair_parts.part(vertex, level, follow="none") for level in levels]
        assert chair_parts.part(vertex, 50, follow="none").share == found[-1].share, "there is no larger part"
        for smaller, larger in pairwise(found):
            assert smaller.share == larger.share or larger.share >= 1.25 * smaller.share
        smaller, part, larger = (each.mask for each in found[2:5])
        assert overlap(smaller & part, smaller) > 0.4  # borders move to creases, also those of tiny parts
        assert overlap(part & larger, part) > 0.8


def test_every_vertex_belongs_to_one_part_of_a_cut_and_the_largest_part_is_first(chair, chair_cut):
    assert (np.sum([part.mask for part in chair_cut], axis=0) == 1).all()
    assert [part.share for part in chair_cut] == sorted((part.share for part in chair_cut), reverse=True)
    assert sum(part.share for part in chair_cut) == pytest.approx(1)
    for part in chair_cut:
        assert part.mask[part.vertex]
    labels = np.argmax([part.mask for part in chair_cut], axis=0)
    agreed = sum(np.bincount(chair.labels[labels == number]).max() for number in range(len(chair_cut)))
    assert agreed / len(labels) > 0.85


def test_a_fine_mesh_has_the_same_parts():
    chair = dfd.samples.chair(60_000)
    assert len(chair.mesh.vertices) > 20_000  # so vertices are clustered into nodes
    vertex = foot_of(chair)
    assert overlap(parts_of(chair).part(vertex).mask, chair.labels == chair.labels[vertex]) > 0.85


@pytest.mark.parametrize(("difference", "components"), [(0.2, 4), (8.0, 2)])
def test_hind_legs_follow_front_legs_unless_they_look_different(chair, difference, components):
    rows = looks(chair, 0.2)
    back = np.concatenate([chair.vertices_of("leg", 2), chair.vertices_of("leg", 3)])
    rows[back] += np.float32(difference) * np.random.default_rng(5).normal(size=16).astype(np.float32) / 4
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    found = Parts(chair.mesh, lambda some: rows[some]).part(foot_of(chair))
    assert found.components == components
    assert overlap(found.mask, chair.labels == chair.parts.index("leg")) > 0.85 * components / 4


def relief(peaks, ridges=0):
    """Return a plate with peaks and ridges, and the label of each vertex.

    Each of `peaks` is a tuple: label, center, radius, width of the slope, height. Ridges have the label `ridges`.
    """
    side = np.linspace(0, 1, 97)
    x, y = (each.ravel() for each in np.meshgrid(side, side, indexing="ij"))
    height, label = np.zeros_like(x), np.zeros(len(x), int)
    for number, at, radius, slope, top in peaks:
        inwards = radius - np.hypot(x - at[0], y - at[1])
        height = np.maximum(height, top * np.clip(inwards / slope, 0, 1))
        label[inwards > 0] = number
    if ridges:
        ridge = (np.abs(np.abs(x - 0.5) - 0.25) < 0.06) & (y > 0.36) & (y < 0.6) & (label == 0)
        height[ridge], label[ridge] = np.maximum(height[ridge], 0.1), ridges
    index = np.arange(len(x)).reshape(97, 97)
    corner, across, along, beyond = index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]
    faces = np.stack([corner, beyond, across, corner, along, beyond], axis=-1).reshape(-1, 3)
    return dfd.Mesh(np.stack([x, height, y], axis=1), faces), label


def parts_by(mesh, label, look, noise, random):
    rows = look[label] + noise * random.normal(size=(len(label), look.shape[1]))
    rows = (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)
    return Parts(mesh, lambda some: rows[some])


def test_a_handle_on_an_arm_does_not_hold_the_whole_body_without_the_head():
    """The plate is the body, the high peak is the head, and the low peaks are the arms.

    The border between head and body is clear. The features of the arms differ little from those of the body.
    """
    mesh, label = relief([*((1, (x, 0.35), 0.17, 0.085, 0.15) for x in (0.25, 0.75)), (2, (0.5, 0.8), 0.1, 0.03, 0.5)])
    random = np.random.default_rng(0)
    look = random.normal(size=(3, 16))
    look[1:] = look[0] + [[0.3], [4.0]] * look[1:]
    parts = parts_by(mesh, label, look, 0.2, random)
    low = int(np.hypot(*(mesh.vertices - (0.25, 0, 0.35))[:, ::2].T).argmin())
    assert overlap(parts.part(low).mask, label == 1) > 0.85
    assert parts.part(low, level=1).share > 0.7


def test_a_region_does_not_extend_to_another_component_beside_it():
    """Place one chair above another one, without contact. No region of the lower chair extends to the upper one."""
    chair = dfd.samples.chair(4_000)
    above = dfd.Mesh(chair.mesh.vertices + [0, 1.001 * np.ptp(chair.mesh.vertices[:, 1]), 0], chair.mesh.faces)
    vertices = np.concatenate([chair.mesh.vertices, above.vertices])
    count = len(chair.mesh.vertices)
    both = dfd.Mesh(vertices, np.concatenate([chair.mesh.faces, chair.mesh.faces + count]))
    rows = np.eye(2, dtype=np.float32)[(np.arange(2 * count) >= count).astype(int)]
    held = Parts(both, lambda some: rows[some]).part(0, 9, follow="none").mask
    assert not held[count:].any()
    assert held[:count].any()


def test_a_shape_without_creases_and_changes_of_features_has_no_part():
    made = trimesh.creation.icosphere(3)
    ball = dfd.Mesh(made.vertices, made.faces)
    rows = np.random.default_rng(0).normal(size=(len(ball.vertices), 8)) * 0.1 + 1
    parts = Parts(ball, lambda some: rows[some].astype(np.float32))
    assert parts.components(0) is None
    assert parts.components(0, level=-1)[0] == 0, "the user asks for a part"
    flat = Parts(dfd.Mesh(np.zeros((3, 3)), [[0, 1, 2]]), lambda some: rows[some])
    flat.prepare()
    assert flat.components(0) is None


def test_loose_shapes_of_few_faces_have_parts():
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = dfd.Mesh(np.concatenate([triangle, triangle + 5]), np.arange(6).reshape(2, 3))
    found = Parts(mesh, lambda some: np.eye(6, dtype=np.float32)[some])
    assert found.part(0).mask[0]
    assert sum(part.mask for part in found.cut()).tolist() == [1] * 6


def test_a_field_gives_the_features(chair):
    field = field_of(chair.mesh)
    rows = field.features(chair.mesh)
    by_field = dfd.parts(chair.mesh, field).part(0)
    assert np.array_equal(by_field.mask, Parts(chair.mesh, lambda some: rows[some]).part(0).mask)


@pytest.mark.parametrize(
    ("at", "level", "message"),
    [
        (-3000, 0, "Parts.part: `at`"),
        ([0.0, np.nan, 0.0], 0, "Parts.part: `at` must be finite"),
        (0, 0.5, "Parts.part: `level` must be a whole number"),
    ],
)
def test_invalid_places_and_levels_raise_an_error(chair_parts, at, level, message):
    with pytest.raises(ValueError, match=message):
        chair_parts.part(at, level)


def test_a_mesh_without_area_has_no_parts():
    flat = dfd.Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    with pytest.raises(ValueError, match="parts: `mesh` must have a face with an area, got none"):
        Parts(flat, lambda some: np.ones((len(some), 4), np.float32)).part(0)


def test_many_loose_triangles_make_at_most_4000_patches(chair):
    mesh, random, count = chair.mesh, np.random.default_rng(0), 6_000
    corners = random.uniform(*mesh.bounds, (count, 1, 3)) + random.normal(size=(count, 3, 3)) * 0.005 * mesh.diagonal
    faces = np.concatenate([mesh.faces, len(mesh.vertices) + np.arange(3 * count).reshape(-1, 3)])
    assert len(Patches(dfd.Mesh(np.concatenate([mesh.vertices, corners.reshape(-1, 3)]), faces)).area) <= 4_000


def test_a_handle_anywhere_on_an_ear_holds_the_ears_and_not_the_head():
    """At the base of an ear, more of the surface beyond the handle belongs to the head than to the ear."""
    animal, random = dfd.samples.quadruped(4_000), np.random.default_rng(2)
    look = random.normal(size=(len(animal.parts), 16))
    look[animal.parts.index("ear")] = look[animal.parts.index("head")] + random.normal(size=16) / 2
    parts = parts_by(animal.mesh, animal.labels, look, 0.1, np.random.default_rng(2))
    ears = animal.vertices_of("ear")
    assert max(parts.part(int(vertex)).share for vertex in ears) < 0.03


def test_parts_are_pickled(chair):
    field = dfd.VertexField(chair.mesh, looks(chair, 0.2))
    own = dfd.parts(chair.mesh, field)
    again = pickle.loads(pickle.dumps(own))
    np.testing.assert_array_equal(again.part(0).mask, own.part(0).mask)


def test_instances_are_the_components_of_parts(chair, chair_parts, chair_cut):
    whole, single = chair_cut, chair_parts.cut(instances=True)
    legs = [part for part in whole if overlap(part.mask, chair.labels == chair.parts.index("leg")) > 0.5]
    assert len(legs) == 1
    within = [part for part in single if (part.mask & legs[0].mask).any()]
    assert len(within) == 4
    assert sum(part.mask for part in single).tolist() == [1] * len(chair.mesh.vertices)
    assert all(part.mask[part.vertex] and part.components == 1 for part in single)
    assert sum(part.share for part in single) == pytest.approx(sum(part.share for part in whole))
    shares = [part.share for part in single]
    assert shares == sorted(shares, reverse=True)


def test_a_cut_aims_at_a_number_of_parts(chair_parts, chair_cut):
    found = chair_parts.cut(2)
    assert len(found) == 2
    assert (np.sum([part.mask for part in found], axis=0) == 1).all()
    assert len(chair_parts.cut(len(chair_cut))) == len(chair_cut) > 2
    assert len(chair_cut) < len(chair_parts.cut(5)) <= 5
    for part in chair_cut:  # whole parts are joined
        assert max((part.mask & each.mask).sum() for each in found) > 0.9 * part.mask.sum()


def test_labels_of_faces_follow_the_corners(chair, chair_parts, chair_cut):
    found = chair_cut
    labels = chair_parts.face_labels(found)
    assert labels.shape == (len(chair.mesh.faces),)
    of_vertex = np.argmax([part.mask for part in found], axis=0)[chair.mesh.faces]
    same = (of_vertex == of_vertex[:, :1]).all(axis=1)
    np.testing.assert_array_equal(labels[same], of_vertex[same, 0])
    for label, corners in zip(labels[~same], of_vertex[~same], strict=True):
        counts = [int((corners == each).sum()) for each in corners]
        assert (corners == label).sum() == max(counts)
