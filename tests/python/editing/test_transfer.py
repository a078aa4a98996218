"""Test the transfer of edits from one shape to another shape of its class."""

import numpy as np
import pytest
from made_field import field_of, made_field

import dfd
from dfd.editing.edit import Edit
from dfd.editing.regions import Ball, Box, HalfSpace, VertexSet
from dfd.editing.transfer import EditTransfer, transfer
from dfd.field.field import FieldOnMesh
from dfd.geometry.topology import sample_surface
from dfd.posing.transforms import Transform


class Known:
    """A field of a scaled and shifted shape. Its features are those of the original shape at the original points."""

    dimension = 16
    residuals = None
    surface = None
    settings: dict = {}  # noqa: RUF012

    def __init__(self, scale=1.0, shift=(0.0, 0.0, 0.0), mesh=None, signature=None):
        self.factor, self.shift = scale, np.asarray(shift)
        self.signature = signature or field_of(mesh, seed=3)
        bounds = scale * mesh.bounds + self.shift
        self.center = bounds.mean(axis=0)
        self.scale = 2 / np.ptp(bounds, axis=0).max()

    def __call__(self, points):
        return self.signature((np.asarray(points) - self.shift) / self.factor)

    def features(self, mesh):
        return self(mesh.vertices)

    def on(self, mesh):
        return FieldOnMesh(self, mesh)


@pytest.fixture(scope="module")
def moved(mesh):
    """Return the chair three times as large, shifted, and with shuffled vertices, and the new index of each vertex."""
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    return dfd.Mesh(3.0 * mesh.vertices[order] + (5, 0, 0), order.argsort()[mesh.faces]), order.argsort()


@pytest.fixture(scope="module")
def fields(mesh):
    one = Known(mesh=mesh)
    return one, Known(3.0, (5, 0, 0), mesh, one.signature)


def test_handles_go_to_what_looks_like_what_they_held(mesh, moved, fields):
    other, number = moved
    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    session.add(5, translation=(0, 0.2, 0), rotation=(0, 30, 0), pivot=(0.1, 0, 0), radius=0.3, name="foot")
    session.add(mesh.vertices[900], scale=2, locality=3, pivot="point")
    session.fix(600, strength=0.5)
    session.symmetry = "x"
    session.set_default(translation=(0.1, 0, 0))
    session.set_poses([dfd.KeyPose(1, {1: Transform((0, 0.1, 0), pivot=(0.1, 0, 0))}, "up")])
    found = transfer(session.edit, mesh, fields[0], other, fields[1])
    first, second = found.edit.handles
    assert first.place.vertex == number[5]
    assert second.place.vertex == number[900]
    assert found.edit.fixed[0].place.vertex == number[600]
    assert found.edit.fixed[0].strength == 0.5
    np.testing.assert_allclose(first.transform.translation, (0, 0.6, 0))
    (pose,) = found.edit.poses
    np.testing.assert_allclose(pose.transforms[1].translation, (0, 0.3, 0))
    np.testing.assert_allclose(pose.transforms[1].pivot, first.transform.pivot)
    assert first.transform.rotation == (0, 30, 0)
    np.testing.assert_allclose(first.transform.pivot, (5.3, 0, 0), atol=1e-6)
    assert first.controls.radius == pytest.approx(0.9)
    assert second.transform.pivot_at == "point"
    np.testing.assert_allclose(second.transform.pivot, second.place.position, atol=1e-6)
    assert second.controls.locality == 3
    np.testing.assert_allclose(found.edit.symmetry.offset, 5, atol=1e-6)
    np.testing.assert_allclose(found.edit.default.translation, (0.3, 0, 0))
    assert found.similarity == pytest.approx({1: 1.0, 2: 1.0}, abs=1e-3)
    assert found.fixed_similarity == pytest.approx((1.0,), abs=1e-3)


def test_the_carried_edit_deforms_the_other_shape_as_the_first_one(mesh, moved, fields):
    other, number = moved
    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    session.add(5, translation=(0, 0.2, 0), rotation=(0, 30, 0), reach=0.7)
    found = transfer(session.edit, mesh, fields[0], other, fields[1])
    there = dfd.Deformer(other, fields[1], features=fields[1].features(other))
    there.apply(found.edit)
    np.testing.assert_allclose(there.vertices[number], 3 * session.vertices + (5, 0, 0), atol=1e-4)


def test_regions_are_carried_from_box_to_box(mesh, moved, fields):
    other, number = moved
    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    held = np.flatnonzero(mesh.vertices[:, 1] > 0.9)
    session.add(held, mask=Box((-1, 0, -1), (1, 2, 1)))
    session.fix(Ball((0.2, 0.1, 0.2), 0.2))
    session.fix(HalfSpace((0, 0, -1), 0.2), strength=0.5)
    found = transfer(session.edit, mesh, fields[0], other, fields[1])
    assert isinstance(found.edit.handles[0].place.region, VertexSet)
    np.testing.assert_array_equal(found.edit.handles[0].place.region.indices, np.sort(number[held]))
    np.testing.assert_allclose(found.edit.handles[0].controls.mask.low, (2, 0, -3), atol=1e-6)
    ball = found.edit.fixed[0].place.region
    np.testing.assert_allclose(ball.center, (5.6, 0.3, 0.6), atol=1e-6)
    assert ball.radius == pytest.approx(0.6)
    assert found.edit.fixed[1].place.region.offset == pytest.approx(0.6)
    assert found.similarity[1] == pytest.approx(1.0, abs=1e-3)
    assert found.fixed_similarity == pytest.approx((1.0, 1.0), abs=1e-3)


def test_fields_of_two_encoders_are_refused(mesh, moved, fields):
    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    with pytest.raises(
        ValueError, match=r"transfer: `field_to` must have features of width 16 .*, got 8: .*another `metric`"
    ):
        transfer(session.edit, mesh, fields[0], moved[0], made_field(8, seed=0))


def test_a_region_that_is_not_there_is_refused(mesh, moved, fields):
    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    session.add("y>0.9")
    flat = dfd.Mesh(moved[0].vertices * (1, 0.1, 1), moved[0].faces)
    with pytest.raises(ValueError, match=r"transfer: `region` must hold a vertex, but the side"):
        transfer(session.edit, mesh, fields[0], flat, fields[1])


def test_the_style_of_a_shape_does_not_count(mesh, moved, fields):
    """One vector is added to all features of the other shape, as if it had another material."""
    other, number = moved

    class Styled(Known):
        def __call__(self, points):
            rows = super().__call__(points) + 2.0 * np.eye(16, dtype=np.float32)[0]
            return rows / np.linalg.norm(rows, axis=1, keepdims=True)

    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    session.add(5)
    found = transfer(session.edit, mesh, fields[0], other, Styled(3.0, (5, 0, 0), mesh, fields[0].signature))
    apart = other.vertices[found.edit.handles[0].place.vertex] - other.vertices[number[5]]
    assert np.linalg.norm(apart) < 0.15 * other.diagonal
    assert found.similarity[1] > 0.6


@pytest.mark.parametrize("key", ["encoder_weights", "metric_hash"])
def test_one_width_of_two_encoders_or_metrics_is_refused(mesh, moved, fields, key):
    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    one, two = (made_field(16, seed=0).with_settings({key: name}) for name in ("first", "second"))
    with pytest.raises(ValueError, match=rf"`field_to` must have the same {key} as `field_from`, first, got second"):
        transfer(session.edit, mesh, one, moved[0], two)


def test_a_field_that_is_the_same_everywhere_is_similar_to_nothing(mesh, moved, fields):
    class Flat(Known):
        def __call__(self, points):
            return np.full((len(points), 16), 0.25, np.float32)

    session = dfd.Deformer(mesh, fields[0], features=fields[0].features(mesh))
    session.add(5)
    flat = Flat(mesh=mesh)
    assert transfer(session.edit, mesh, fields[0], moved[0], flat).similarity[1] == 0


def test_places_and_similarities_are_those_of_their_definition(mesh):
    """Compare 24 places on a shape of another field with the definition, computed without `bind`."""
    one, other = Known(mesh=mesh), Known(mesh=mesh, signature=field_of(mesh, seed=4))
    rows, drawn = [], np.random.default_rng(1)
    for field in (one, other):
        points, _ = sample_surface(mesh.vertices, mesh.faces, 40_000, drawn)
        rows.append(field(mesh.vertices) - field(points).mean(axis=0))
    rows = [each / np.linalg.norm(each, axis=1, keepdims=True) for each in rows]
    places = np.arange(0, len(mesh.vertices), len(mesh.vertices) // 24)
    found, similarities = EditTransfer(mesh, one, mesh, other).nearest(mesh.vertices[places])
    good = 0
    for vertex, chosen, similarity in zip(places, found, similarities, strict=True):
        apart = np.linalg.norm(rows[1] - rows[0][vertex], axis=1)
        alike = np.flatnonzero(apart <= apart.min() + 0.1)
        good += chosen == alike[np.linalg.norm(mesh.vertices[alike] - mesh.vertices[vertex], axis=1).argmin()]
        assert similarity == pytest.approx(rows[0][vertex] @ rows[1][chosen], abs=0.03)
    assert good >= 0.8 * len(places)  # the mean features are those of other samples


def test_a_session_transfers_its_edit(mesh, moved):
    other, at = moved
    session = dfd.Deformer(mesh, Known(mesh=mesh), other_shape=True)
    handle = session.add(17, translation=(0, 0.1, 0), reach=1.0)
    session.fix(800)
    assert session.similarity == {}
    twin = session.transfer(other, Known(3.0, (5, 0, 0), mesh))
    assert twin.mesh is other
    assert twin.handle(handle).place.vertex == at[17]
    assert twin.handle(handle).transform.translation == pytest.approx((0, 0.3, 0))
    assert twin.similarity[handle] == pytest.approx(1, abs=1e-3)
    expected = transfer(session.edit, mesh, session.field, other, twin.field)
    assert twin.edit == expected.edit
    assert not twin.undo()


def test_corresponding_vertices_of_a_moved_shape(mesh, moved):
    other, at = moved
    found = dfd.correspond(mesh, Known(mesh=mesh), other, Known(3.0, (5, 0, 0), mesh))
    assert found.vertices.shape == found.confidence.shape == (len(mesh.vertices),)
    apart = np.linalg.norm(other.vertices[found.vertices] - other.vertices[at], axis=1)
    assert (apart < 1e-6).mean() > 0.95
    assert np.median(found.confidence) > 0.95
    assert found.similarity.min() >= 0
    noise = Known(3.0, (5, 0, 0), mesh, signature=field_of(mesh, seed=99))
    unlike = dfd.correspond(mesh, Known(mesh=mesh), other, noise)
    assert np.median(unlike.confidence) < 0.5


def test_fields_that_cannot_be_compared_do_not_correspond(mesh):
    field = dfd.VertexField(mesh, np.eye(3)[np.arange(len(mesh.vertices)) % 3])
    with pytest.raises(ValueError, match=r"^correspond: `field_to` must have features of width 3"):
        dfd.correspond(mesh, field, mesh, Known(mesh=mesh))


class Renamed:
    """Parts whose level L is the level L − 1 of other parts. The vertices `without` have no part."""

    def __init__(self, parts, without=()):
        self.parts, self.without = parts, without

    def levels(self, at):
        return tuple(1 + level for level in self.parts.levels(at))

    def components(self, at, level=0):
        return None if at in self.without else self.parts.components(at, level - 1)


def test_a_handle_gets_the_level_and_the_place_of_the_most_similar_part(mesh, monkeypatch):
    field = field_of(mesh, seed=3)
    session = dfd.Deformer(mesh, field)
    parts = session.bound.parts
    for level in (-1, 0):
        session.apply(Edit())
        handle = session.add(5, level=level)
        found = transfer(session.edit, mesh, field, mesh, field, parts=(parts, Renamed(parts))).edit.handle(handle)
        assert (found.place.vertex, found.controls.level) == (5, level + 1)
    monkeypatch.setattr("dfd.editing.transfer.PLACE_MARGIN", 2.0)
    other = transfer(session.edit, mesh, field, mesh, field, parts=(parts, Renamed(parts, {5}))).edit.handle(handle)
    assert other.place.vertex != 5
    session.change(handle, reach=0.5)
    kept = transfer(session.edit, mesh, field, mesh, field, parts=(parts, Renamed(parts, {5}))).edit.handle(handle)
    assert (kept.place.vertex, kept.controls.level) == (5, 0), "a handle with a numeric reach holds no part"
