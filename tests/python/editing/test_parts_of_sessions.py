"""Test parts as places of handles, as masks, and as the reach of a handle."""

import numpy as np
import pytest
import trimesh
from made_field import field_of

import dfd
from dfd.editing.edit import Edit, Handle
from dfd.editing.edit_file import from_document, to_document
from dfd.editing.points import place_on
from dfd.editing.presets import PARTLESS_REACH
from dfd.editing.regions import VertexSet
from dfd.editing.weights import session_weights


def test_a_part_is_a_region_that_holds_the_place(mesh, field):
    session = dfd.Deformer(mesh, field)
    part = session.part(100)
    assert isinstance(part, VertexSet)
    assert 100 in part.indices
    assert np.array_equal(part.indices, dfd.parts(mesh, field).part(100).vertices)
    assert len(session.part(100, follow="none").indices) <= len(part.indices)
    with pytest.raises(ValueError, match="Deformer.part: `level` must be"):
        session.part(100, level=0.5)


def test_a_handle_moves_the_part_of_its_level(mesh, field):
    session = dfd.Deformer(mesh, field)
    held, at = session.add(100), 100
    for level in (-1, 0, 1):
        session.change(held, level=level, mask="part")
        region = session.part(at, level=level)
        assert session.handle(held).controls.mask == region
        session.change(held, mask="everywhere")
        moved = session.following[:, 0] > 0.5
        own = np.isin(np.arange(len(moved)), region.indices)
        assert (moved & own).sum() > 0.9 * (moved | own).sum()
    session.change(held, level=np.int64(-1))
    written = to_document(session.edit, session.mesh)
    assert from_document(written, session.mesh).handles[0].controls.level == -1
    with pytest.raises(ValueError, match="Deformer.change: `level` must be a whole number, got 'large'"):
        session.change(held, level="large")


def component_of(mesh: dfd.Mesh, vertex: int) -> np.ndarray:
    """Return which vertices (V,) are in the connected component of a vertex."""
    inside = mesh.representative == mesh.representative[vertex]
    while True:
        beside = np.isin(mesh.faces, np.flatnonzero(inside)).any(axis=1)
        grown = np.isin(mesh.representative, mesh.representative[mesh.faces[beside]])
        if not (grown & ~inside).any():
            return inside
        inside |= grown


def test_what_is_said_of_parts_is_held_and_limits(mesh, field):
    session = dfd.Deformer(mesh, field)
    part, piece = session.part(100), session.part(100, follow="none")
    whole = VertexSet.of(session.mesh, component_of(session.mesh, 100))
    for text, region in (("part@100", part), ("piece@100", piece), ("component@100", whole)):
        held = session.add(text)
        assert session.handles[-1].place.region == region
        session.remove(held)
        session.fix(text)
        assert session.fixed[-1].place.region == region
        session.release(text)
        assert not session.fixed
    session.add(100, mask="part", reach=2)
    assert session.handles[-1].controls.mask == part
    inside = np.isin(np.arange(len(session.mesh.vertices)), part.indices)
    assert (session.weights[~inside, 0] == 0).all()
    session.change(session.handles[-1].id, mask="piece@100")
    assert session.handles[-1].controls.mask == piece


def test_a_reach_by_the_part_holds_it_with_a_seam_and_nothing_beyond(mesh, field, tmp_path):
    session = dfd.Deformer(mesh, field)
    at = int(mesh.vertices[:, 1].argmin())  # its part connects no other region to the rest
    session.add(at, reach="part", counterparts="shared_pivot")
    weights = session.weights[:, 0]
    inside = np.isin(np.arange(len(weights)), session.part(at).indices)
    assert weights[at] == 1
    assert weights[inside].mean() > 0.8
    away = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[inside][None], axis=2).min(axis=1)
    assert (weights[away > 0.05 * mesh.diagonal] == 0).all()
    session.save(tmp_path / "edit.json")
    again = dfd.Deformer.load(tmp_path / "edit.json", mesh, field)
    assert again.handles[0].controls.reach == "part"
    assert np.array_equal(again.weights, session.weights)


def test_on_a_shape_without_parts_the_features_give_the_weights():
    made = trimesh.creation.icosphere(3)
    ball = dfd.Mesh(made.vertices, made.faces)
    session = dfd.Deformer(ball, field_of(ball))
    session.add(0, translation=(0.1, 0.2, 0))
    weights = dfd.bind(session.features, [0], reach=PARTLESS_REACH, falloff="smooth")
    np.testing.assert_allclose(session.weights, weights, atol=1e-6)
    np.testing.assert_allclose(session.following, weights, atol=1e-6)
    assert session.report().handles[0].note == "with weights by features, because it lies on no part"
    assert session.report().handles[0].arrived


def test_of_many_parts_those_used_last_are_kept(mesh, field, monkeypatch):
    monkeypatch.setattr(session_weights, "SPARE", 2)
    session = dfd.Deformer(mesh, field)
    first, second = (Handle(1, place_on(mesh, vertex)) for vertex in (0, 300))
    held = [session.bound.held(Edit(), handle) for handle in (first, second, first)]
    session.add(900)
    _ = session.following
    assert session.bound.held(Edit(), first) is held[0] is held[2]
    assert session.bound.held(Edit(), second) is not held[1]
