"""Test the up direction: accepted values, the search for it, and its effect on pictures."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_table import probe_of, table
from scipy.spatial.transform import Rotation

import dfd
from dfd.distillation.settings import DistillSettings
from dfd.upright.candidates import axis_frames, check_up, explicit_up, frame_facing
from dfd.upright.find_up import CLEAR, decide, find_up, prior
from dfd.upright.probe import FORM_TOKENS, FORMS, LOOKS, TERMS, VECTOR_TOKENS, VECTORS, find_probe
from dfd.upright.probe_views import SIDES, ProbeCameras
from dfd.views.render import render


@pytest.mark.parametrize(
    ("up", "direction"),
    [("y", "+y"), ((0, 0, 2), (0, 0, 1)), ([0.0, -3.0, 0.0], (0, -1, 0)), ("0, 3, 4", (0, 0.6, 0.8))],
)
def test_directions_pass_at_unit_length(up, direction):
    assert check_up(up) == pytest.approx(direction) if isinstance(direction, tuple) else check_up(up) == direction


@pytest.mark.parametrize("up", ["up", "", "+w", "1,2", (0, 0, 0), (1, 2), (np.nan, 0, 1), None, 3, ["a", "b", "c"]])
def test_what_is_no_direction_is_refused(up):
    with pytest.raises(ValueError, match=re.escape("distill: `up` must be one of auto, file, +x, -x")) as raised:
        DistillSettings(up=up)
    assert repr(up) in str(raised.value)


def test_a_mesh_without_extent_along_up_is_refused():
    sheet = dfd.Mesh([[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 2]])
    with pytest.raises(ValueError, match=r"`up` must be a direction along which `mesh` has an extent, got '\+y'"):
        explicit_up(sheet, "+y")
    assert explicit_up(sheet, "file").direction.tolist() == [0, 1, 0]  # "file" does not require an extent along +y


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda up: np.linalg.norm(up) > 1e-3))
def test_frames_are_rotations_with_that_up(up):
    frame = explicit_up(table(), check_up(up)).frame
    assert np.allclose(frame @ frame.T, np.eye(3))
    assert np.linalg.det(frame) == pytest.approx(1)
    assert np.allclose(frame[1], np.array(up) / np.linalg.norm(up))


def voting_for(seen, up, encoder):
    """Return the smallest `form` and `vector` of a probe that votes only for `up`, given the pictures `seen`."""
    at = np.einsum("nai,ki->nka", seen.axes, np.eye(3))
    forms = np.einsum("nka,jab,nkb,njd->kjd", at, FORMS, at, seen.tokens[:, FORM_TOKENS], optimize=True)
    vectors = np.einsum("nka,ja,njd->kjd", at, VECTORS, seen.tokens[:, VECTOR_TOKENS], optimize=True)
    said = (np.square(up) - 1 / 3, up)
    return tuple(
        np.linalg.lstsq(each.reshape(3, -1) / len(seen.tokens), wanted)[0].reshape(each.shape[1:]).astype(np.float32)
        for each, wanted in zip((forms, vectors), said, strict=True)
    )


def test_pictures_decide_when_the_surface_says_nothing(encoder):
    mesh, frames = table(), np.stack(axis_frames(np.eye(3)))
    form, vector = voting_for(ProbeCameras(mesh, encoder).seen(frames, SIDES), np.array([0.0, 0, -1]), encoder)
    odds = np.zeros((3, len(TERMS)))
    odds[1, : len(LOOKS)] = 100.0
    found = find_up(mesh, encoder, probe=probe_of(encoder, form=form, vector=vector, odds=odds))
    assert str(found) == "-z"
    assert found.source == "found"
    assert found.sentence == f"-z, {found.confidence:.0%} sure"


@pytest.mark.parametrize(
    ("at_once", "then", "pictures"), [("sure", "sure", 4), ("doubtful", "sure", 24), ("doubtful", "doubtful", 48)]
)
def test_few_pictures_are_enough_where_they_leave_no_doubt(encoder, monkeypatch, at_once, then, pictures):
    """Count the pictures: 4 around +y, then 20 around the other five directions, then 24 from the corners."""
    looked, encode = [], encoder.encode
    monkeypatch.setattr(
        encoder, "encode", lambda images, **more: (looked.append(len(images)), encode(images, **more))[1]
    )
    odds = np.zeros((3, len(TERMS)))
    for row, said in zip(odds, (at_once, then), strict=False):
        row[TERMS.index("mirrors flat")] = 1000.0 if said == "sure" else 1.0
    found = find_up(table(), encoder, probe=probe_of(encoder, odds=odds))
    assert sum(looked) == pictures
    assert (found.source == "averaged") == (then == "doubtful")


def test_without_a_clear_axis_the_two_likeliest_are_combined():
    frames = np.stack(axis_frames(np.eye(3)))
    found = decide(frames, np.log([0.05, 0.05, 0.3, 0.2, 0.1, 0.3]))
    assert found.source == "averaged"
    assert found.confidence == pytest.approx(0.5)
    assert found.confidence < CLEAR
    assert [frame[1].tolist() for frame in found.frames] == [[0, 1, 0], [0, 0, -1]]
    assert np.array_equal(found.frame, found.frames[0])
    assert found.sentence == "+y, 50% sure: features of +y and -z are combined"
    assert found.shares.tolist() == pytest.approx([5 / 9, 4 / 9])


def test_the_probabilities_of_nearly_parallel_axes_are_added():
    """Pictures around two axes 15° apart hardly differ, so neither axis alone would be probable enough."""

    def leaning(axis, towards):
        return np.cos(np.radians(15)) * np.eye(3)[axis] + np.sin(np.radians(15)) * np.eye(3)[towards]

    ups = [np.eye(3)[1], leaning(1, 0), np.eye(3)[2], leaning(2, 0)]
    frames = np.stack([frame_facing(sign * up, np.array([1.0, 0, 0])) for up in ups for sign in (1.0, -1.0)])
    clear = decide(frames, np.log([0.48, 0.01, 0.46, 0.01, 0.01, 0.01, 0.01, 0.01]))
    assert (clear.source, clear.confidence) == ("file", pytest.approx(0.96))
    shared = decide(frames, np.log([0.34, 0.01, 0.24, 0.01, 0.19, 0.01, 0.01, 0.19]))
    assert (shared.source, shared.confidence) == ("averaged", pytest.approx(0.6))
    np.testing.assert_allclose(shared.frames[:, 1], [[0, 1, 0], [0, 0, 1]])
    np.testing.assert_allclose(shared.shares, [0.6, 0.4])


@pytest.mark.parametrize("up", range(6))
def test_a_table_is_found_whichever_way_it_lies(encoder, up):
    rotation = axis_frames(np.eye(3))[up].T  # rotates +y to that direction
    mesh = table()
    lying = dfd.Mesh(mesh.vertices @ rotation.T, mesh.faces)
    before = lying.vertices.copy()
    found = find_up(lying, encoder, probe=probe_of(encoder))
    assert found.source in ("file", "found")
    assert CLEAR < found.confidence <= 1
    assert abs(found.direction @ rotation[:, 1]) == pytest.approx(1)
    assert np.array_equal(lying.vertices, before)


def test_the_prior_decides_where_nothing_else_does(encoder):
    silent = probe_of(encoder, odds=np.zeros((3, len(TERMS))), file_up=5.0, file_down=2.0, file_z=1.0)
    found = find_up(table(), encoder, probe=silent)
    assert np.array_equal(found.frame, np.eye(3))
    assert found.source == "file"
    odds = np.exp([0, 0, 5, 2, 1, 1])
    assert found.confidence == pytest.approx(odds[2:4].sum() / odds.sum())
    assert found.sentence == f"+y as in the file, {found.confidence:.0%} sure"
    assert [prior(silent, frame) for frame in axis_frames(np.eye(3))] == [0, 0, 5, 2, 1, 1]


def test_a_gltf_file_says_that_y_is_up(encoder, tmp_path):
    silent = probe_of(encoder, odds=np.zeros((3, len(TERMS))), file_up=0.0, file_down=0.0, file_z=1.0)
    for ending, up in ((".glb", 1), (".ply", 2)):
        table().save(tmp_path / f"table{ending}")
        assert abs(find_up(dfd.load(tmp_path / f"table{ending}"), encoder, probe=silent).direction[up]) == 1


def tilted_table(seed=0):
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    return dfd.Mesh(table().vertices @ rotation.T, table().faces), rotation


@pytest.mark.parametrize("seed", range(2))
def test_a_tilted_table_is_found(encoder, seed):
    tilted, rotation = tilted_table(seed)
    found = find_up(tilted, encoder, probe=probe_of(encoder))
    assert max(abs(frame[1] @ rotation[:, 1]) for frame in found.frames) > np.cos(np.radians(3))


def test_on_a_tilted_shape_the_prior_counts_half(encoder):
    """The probe is silent. Then the odds of the y axis are those of the prior, and all other candidates are equal."""
    odds = []
    for prior_up in (0.0, 6.0):
        silent = {"odds": np.zeros((3, len(TERMS))), "file_up": prior_up, "file_down": 0.0, "file_z": 0.0}
        sure = find_up(tilted_table()[0], encoder, probe=probe_of(encoder, **silent)).confidence
        odds.append(sure / (1 - sure))
    assert odds[1] / odds[0] == pytest.approx((np.exp(3.0) + 1) / 2)


def test_another_encoders_probe_is_refused_and_without_one_the_files_up_stays(encoder):
    with pytest.raises(ValueError, match="`probe` was learned from another encoder"):
        find_up(table(), encoder, probe=probe_of(encoder, encoder_block=encoder.block + 1))
    assert find_probe(encoder) is None
    found = find_up(table(), encoder)
    assert (found.source, found.confidence) == ("file", 0)
    assert np.array_equal(found.frame, np.eye(3))
    assert found.sentence == "+y by the file's convention: the up direction could not be measured"


def test_pictures_in_a_frame_are_those_of_the_turned_mesh():
    """Compare pictures of a mesh on its side, rendered in its upright frame, with those of the upright mesh."""
    mesh = table()
    z_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    lying = dfd.Mesh(mesh.vertices @ z_up.T, mesh.faces)
    frame = explicit_up(lying, "+z").frame
    assert np.allclose(frame, z_up.T)
    standing = render(mesh, views=8, resolution=64, mirrored=True)
    seen = render(lying, views=8, resolution=64, mirrored=True, frame=frame)
    assert (seen.covered == standing.covered).mean() > 0.999
    assert (render(lying, views=8, resolution=64, mirrored=True).covered == standing.covered).mean() < 0.95
    both = (seen.covered & standing.covered)[..., None]
    assert np.abs(np.where(both, seen.images.astype(int) - standing.images, 0)).mean() < 0.5
    assert np.array_equal(seen.frame, frame)
    back = seen.points @ z_up  # points are in the mesh's coordinates
    assert np.allclose(
        [back.min(axis=0), back.max(axis=0)], [standing.points.min(axis=0), standing.points.max(axis=0)], atol=0.05
    )


def test_a_field_says_which_way_was_up(encoder):
    few = {"views": 4, "resolution": 56, "steps": 2, "batch": 8, "progress": False, "cache": False}
    field = dfd.distill(table(), encoder, up="-z", **few)
    assert field.settings["up"] == "-z"
    assert field.settings["up_direction"] == [0, 0, -1]
    assert field.settings["up_source"] == "said"
    auto = dfd.distill(table(), encoder, **few)
    plain = dfd.distill(table(), encoder, up="file", **few)
    assert (auto.settings["up"], auto.settings["up_source"]) == ("auto", "file")
    assert np.array_equal(auto(table().vertices), plain(table().vertices))
