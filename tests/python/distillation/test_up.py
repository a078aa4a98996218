"""Which way is up: what may be said, what a surface tells, what was learned, and that pictures follow it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tiny_encoder import save_tiny_encoder

import dfd
from dfd.distillation.settings import DistillSettings
from dfd.distillation.standing import EVIDENCE, RESTS, Standing
from dfd.distillation.up import UP_WORDS, Up, axis_frames, check_up, said_up
from dfd.distillation.up_probe import (
    FOLDER,
    FORM_TOKENS,
    FORMS,
    LOOKS,
    TERMS,
    VECTOR_TOKENS,
    VECTORS,
    UpProbe,
    find_probe,
)
from dfd.distillation.upright import ASKEW, CLEAR, SAME, candidates, decide, find_up, prior
from dfd.distillation.views_around import SIDES, Around, Seen
from dfd.encoders.encode import load_encoder
from dfd.views.render import render

TABLE_LEGS = ((-0.9, -0.4), (-0.9, 0.4), (0.9, -0.4), (0.9, 0.4))


def box(low, high):
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return corners, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def table():
    """A table: upright, longer than it is deep, y up."""
    parts = [box((-1, 0.9, -0.5), (1, 1.0, 0.5))]
    parts += [box((x - 0.05, 0, z - 0.05), (x + 0.05, 0.9, z + 0.05)) for x, z in TABLE_LEGS]
    vertices = np.concatenate([corners for corners, _ in parts])
    faces = np.concatenate([faces + 8 * number for number, (_, faces) in enumerate(parts)])
    return dfd.Mesh(vertices, faces)


@pytest.fixture(scope="module")
def encoder(tmp_path_factory):
    return load_encoder(save_tiny_encoder(tmp_path_factory.mktemp("encoder")), device="cpu", precision="float32")


def probe_of(encoder, **changes):
    """A probe that goes by the surface alone: what stands stably and shows the least of its sides is upright."""
    odds = np.zeros(len(TERMS))
    odds[[TERMS.index("stable"), TERMS.index("facing up"), TERMS.index("mirrors flat")]] = 10.0, 5.0, 20.0
    own = encoder.settings()
    plain = UpProbe(
        np.zeros(encoder.dimension, np.float32),
        np.zeros((len(FORMS), encoder.dimension), np.float32),
        np.zeros((len(VECTORS), encoder.dimension), np.float32),
        np.stack([odds] * 3),
        0.0,
        0.0,
        0.0,
        str(own["encoder_weights"]),
        int(own["encoder_block"]),
    )
    return replace(plain, **changes)


@pytest.mark.parametrize("up", UP_WORDS)
def test_words_pass(up):
    assert check_up(up) == up


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
    with pytest.raises(ValueError, match=r"`up` must be a direction that `mesh` has some extent along, got '\+y'"):
        said_up(sheet, "+y")
    assert said_up(sheet, "file").direction.tolist() == [0, 1, 0]  # as before there was anything to say


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda up: np.linalg.norm(up) > 1e-3))
@settings(max_examples=50, deadline=None)
def test_frames_are_rotations_with_that_up(up):
    frame = said_up(table(), check_up(up)).frame
    assert np.allclose(frame @ frame.T, np.eye(3))
    assert np.linalg.det(frame) == pytest.approx(1)
    assert np.allclose(frame[1], np.array(up) / np.linalg.norm(up))


def test_the_files_own_up_is_no_turn_at_all():
    assert np.array_equal(said_up(table(), "+y").frame, np.eye(3))
    assert str(said_up(table(), "+y")) == "+y"
    assert str(Up(said_up(table(), (0.0, 0.6, 0.8)).frame, 1.0, "said")) == "0.000, 0.600, 0.800"


def test_six_frames_of_an_axis_each():
    frames = np.stack(axis_frames(np.eye(3)))
    assert sorted(frames[:, 1].tolist()) == sorted(np.concatenate([np.eye(3), -np.eye(3)]).tolist())
    assert np.allclose(np.linalg.det(frames), 1)
    assert np.array_equal(frames[2], np.eye(3))


def test_evidence_of_a_table():
    mesh = table()
    standing = Standing(mesh.vertices, mesh.faces)
    upright, upside_down = (
        dict(zip(EVIDENCE, standing.evidence(frame), strict=True)) for frame in axis_frames(np.eye(3))[2:4]
    )
    assert upright["stable"] == upside_down["stable"] == 1
    assert upright["base"] == pytest.approx(1.9 * 0.9 / (2 * 1), rel=1e-6)
    assert upside_down["base"] == pytest.approx(1, rel=1e-6)
    assert upright["near the base"] < upside_down["near the base"]
    assert upright["middle"] > 0.85  # most of its surface is its top
    assert upright["middle"] + upside_down["middle"] == pytest.approx(1)
    assert upright["mirrors upright"] < 0.02 < upright["mirrors flat"]


def test_a_table_on_two_of_its_legs_would_fall():
    mesh = table()
    angle = np.radians(20)
    frame = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    assert Standing(mesh.vertices, mesh.faces).evidence(frame)[EVIDENCE.index("stable")] == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_tilted_shape_gets_axes_of_its_own(seed):
    mesh = table()
    assert np.array_equal(Standing(mesh.vertices, mesh.faces).frame(), np.eye(3))
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    frame = Standing(mesh.vertices @ rotation.T, mesh.faces).frame()
    assert np.linalg.det(frame) == pytest.approx(1)
    assert np.abs(frame @ rotation[:, 1]).max() > np.cos(np.radians(3))


@pytest.mark.parametrize("seed", range(3))
def test_candidates_come_in_pairs_and_a_tilted_table_rests_on_its_legs_in_one(seed):
    mesh = table()
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    standing = Standing(mesh.vertices @ rotation.T, mesh.faces)
    frame = standing.frame()
    found = candidates(standing, frame, np.zeros((3, 3)))
    assert 6 + 2 <= len(found) <= 2 * (3 + RESTS + 4)
    assert np.allclose(found[:6:2, 1], [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    assert np.allclose(found @ found.transpose(0, 2, 1), np.eye(3))
    assert np.allclose(np.linalg.det(found), 1)
    assert np.allclose(found[::2, 1], -found[1::2, 1])
    assert np.abs(found[:, 1] @ rotation[:, 1]).max() > np.cos(np.radians(3))


def test_the_axis_that_pictures_vote_for_is_a_candidate_and_leans_into_the_mirror_plane():
    """What pictures tell is rough: with the mirror plane upright it is nearer to the truth."""
    mesh = table()
    rotation = Rotation.random(rng=np.random.default_rng(0)).as_matrix()
    standing = Standing(mesh.vertices @ rotation.T, mesh.faces)
    frame = standing.frame()
    rough = frame[0] + 2 * frame[1] + 1.5 * frame[2]
    rough /= np.linalg.norm(rough)
    ups = candidates(standing, frame, np.outer(rough, rough) - np.eye(3) / 3)[:, 1]
    leaned = rough - (rough @ frame[0]) * frame[0]
    leaned /= np.linalg.norm(leaned)
    # One of its candidates may stand for another that is nearly the same.
    assert np.abs(ups @ rough).max() > SAME
    assert np.abs(ups @ leaned).max() > SAME
    twice = np.abs(ups[::2] @ ups[::2].T) - np.eye(len(ups) // 2)
    assert twice.max() < SAME


def test_a_shape_rests_where_its_middle_is_above_an_edge():
    """A triangle seen from the side rests on each of its sides; one that leans far only on two."""
    frame = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    for tip, ways in (((0.5, 0.8, 0), 3), ((3.0, 0.5, 0), 2)):
        mesh = dfd.Mesh([[0, 0, 0], [1, 0, 0], tip], [[0, 1, 2]])
        ups = Standing(mesh.vertices, mesh.faces).resting(frame)
        heights = [mesh.vertices @ up for up in ups]
        lowest = [np.sort(height - height.min())[1] for height in heights]
        assert sum(second < 1e-9 for second in lowest) == ways
        assert np.allclose(ups[:, 2], 0)


def test_what_is_seen_around_a_candidate_does_not_depend_on_where_it_lies(encoder):
    """All 24 ways to lay a table down show the same pictures, of the axis that was up before."""
    mesh = table()
    frames = np.stack(axis_frames(np.eye(3)))

    def mean_tokens(mesh):
        seen = Around(mesh, encoder).seen(frames, SIDES)
        assert seen.tokens.shape == (24, 2, encoder.dimension)
        assert np.allclose(seen.axes @ seen.axes.transpose(0, 2, 1), np.eye(3))
        return seen.tokens[:, 0].reshape(6, 4, -1).mean(axis=1)

    seen = mean_tokens(mesh)
    scale = np.abs(seen - seen.mean(axis=0)).max()
    for index in (0, 3, 4):
        rotation = frames[index].T
        lying = mean_tokens(dfd.Mesh(mesh.vertices @ rotation.T, mesh.faces))
        for number, frame in enumerate(frames):
            other = int((frames[:, 1] @ (rotation @ frame[1])).argmax())
            assert np.abs(lying[other] - seen[number]).max() < 0.05 * scale


def test_the_second_token_is_right_less_left(encoder, monkeypatch):
    """Tokens that are their own column, of a shape as wide as the picture."""

    def columns(images, *, covered):
        side = images.shape[1] // encoder.patch
        tokens = np.broadcast_to(np.arange(side, dtype=np.float32)[None, :, None], (side, side, encoder.dimension))
        return np.broadcast_to(tokens, (len(images), *tokens.shape))

    monkeypatch.setattr(encoder, "encode", columns)
    around = Around(table(), encoder)
    side = around._resolution // encoder.patch
    mean, across = around.seen(np.eye(3)[None], np.array([[0.0, 0.2, 1.0]])).tokens[0, :, 0]
    assert mean == pytest.approx((side - 1) / 2, abs=0.2)
    assert side / 2 <= across < side  # the legs are at the ends


def pictures(generator, count, width):
    """What random pictures from random cameras show."""
    axes = Rotation.random(count, rng=generator).as_matrix()
    return Seen(generator.standard_normal((count, 2, width)).astype(np.float32), axes)


def random_probe(encoder, generator, **changes):
    """A probe whose votes are anything."""
    width = encoder.dimension
    form, vector = (generator.standard_normal((rows, width)).astype(np.float32) for rows in (5, 3))
    return probe_of(encoder, form=form, vector=vector, **changes)


def test_votes_turn_with_the_pictures_and_mirror_with_them(encoder):
    generator = np.random.default_rng(0)
    seen, probe = pictures(generator, 7, encoder.dimension), random_probe(encoder, generator)
    form, vector = probe.votes(seen)
    assert np.allclose(form, form.T)
    assert np.trace(form) == pytest.approx(0, abs=1e-9)
    rotation = Rotation.random(rng=generator).as_matrix()
    turned = probe.votes(Seen(seen.tokens, seen.axes @ rotation.T))
    assert np.allclose(turned[0], rotation @ form @ rotation.T)
    assert np.allclose(turned[1], rotation @ vector)
    # A mirror image is seen by the mirrored camera, whose right is turned round; its halves have changed places.
    mirror = np.diag([-1.0, 1, 1])
    mirrored = Seen(seen.tokens * np.float32([1, -1])[:, None], np.diag([-1.0, 1, 1]) @ seen.axes @ mirror)
    assert np.allclose(probe.votes(mirrored)[0], mirror @ form @ mirror)
    assert np.allclose(probe.votes(mirrored)[1], mirror @ vector)


def test_votes_are_spherical_harmonics_of_the_tokens(encoder):
    """What a candidate gets is linear in the tokens, times what its direction is in each picture."""
    generator = np.random.default_rng(1)
    probe = random_probe(encoder, generator, mean=generator.standard_normal(encoder.dimension).astype(np.float32))
    seen, ups = pictures(generator, 3, encoder.dimension), np.array([[0.0, 1, 0], [0, 0.6, 0.8]])
    evidence = generator.standard_normal((2, len(EVIDENCE)))
    told = probe.terms(seen, ups, evidence)
    assert told.shape == (2, len(TERMS))
    assert np.array_equal(told[:, len(LOOKS) :], evidence)
    for number, up in enumerate(ups):
        form = vector = 0.0
        for (mean, across), axes in zip(seen.tokens, seen.axes, strict=True):
            x, y, z = axes @ up
            tokens = (mean - probe.mean, across)
            squares = (y * y - (x * x + z * z) / 2, (z * z - x * x) * 3**0.5 / 2, 3**0.5 * y * z)
            for weight, at, token in zip(
                probe.form, (*squares, 3**0.5 * x * y, 3**0.5 * x * z), FORM_TOKENS, strict=True
            ):
                form += float(weight @ tokens[token]) * at / len(seen.tokens)
            for weight, at, token in zip(probe.vector, (y, z, x), VECTOR_TOKENS, strict=True):
                vector += float(weight @ tokens[token]) * at / len(seen.tokens)
        assert told[number, : len(LOOKS)] == pytest.approx((form, vector), rel=1e-4)


def voting_for(seen, up, encoder):
    """A form and a vector of least length by which pictures vote for `up`, and for nothing else."""
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
    form, vector = voting_for(Around(mesh, encoder).seen(frames, SIDES), np.array([0.0, 0, -1]), encoder)
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
    """Four around the file's up; four around each axis; eight, and all decide."""
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


def test_one_look_decides_only_what_it_leaves_no_doubt_about(encoder):
    """What files have by convention makes nothing sure at once, but it counts where the look is sure of the axis."""
    odds = np.zeros((3, len(TERMS)))
    odds[1, TERMS.index("mirrors flat")] = 1000.0
    z_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    lying = dfd.Mesh(table().vertices @ z_up.T, table().faces)
    found = find_up(lying, encoder, probe=probe_of(encoder, odds=odds, file_up=9.0, file_down=9.0))
    assert str(found) in ("+z", "-z")


def test_the_axis_is_decided_before_its_end():
    """Two likely ends of one axis outweigh a direction that is likelier than each."""
    frames = np.stack(axis_frames(np.eye(3)))
    found = decide(frames, np.log([0.45, 0.45, 0.01, 0.01, 0.07, 0.01]))
    assert (str(found), found.source) == ("+x", "found")
    assert found.confidence == pytest.approx(0.9)
    assert str(decide(frames, np.log([0.44, 0.46, 0.01, 0.01, 0.07, 0.01]))) == "-x"
    assert decide(frames, np.log([0.01, 0.01, 0.9, 0.06, 0.01, 0.01])).source == "file"


def test_without_a_clear_axis_the_two_likeliest_share_the_pictures():
    frames = np.stack(axis_frames(np.eye(3)))
    found = decide(frames, np.log([0.05, 0.05, 0.3, 0.2, 0.1, 0.3]))
    assert found.source == "averaged"
    assert found.confidence == pytest.approx(0.5)
    assert found.confidence < CLEAR
    assert [frame[1].tolist() for frame in found.frames] == [[0, 1, 0], [0, 0, -1]]
    assert np.array_equal(found.frame, found.frames[0])
    assert found.sentence == "+y likeliest, 50% sure: +y and -z share the pictures"


def test_frames_share_the_pictures_evenly():
    mesh, frames = table(), np.stack(axis_frames(np.eye(3)))[[2, 4]]
    alone = [render(mesh, views=16, resolution=32, mirrored=True, frame=frame) for frame in frames]
    shared = render(mesh, views=16, resolution=32, mirrored=True, frame=frames)
    assert len(shared.images) == 16
    assert np.array_equal(shared.frame, frames[0])
    for number, one in enumerate(alone):
        own = [camera.position.round(6).tolist() for camera in one.cameras]
        some = [camera.position.round(6).tolist() for camera in shared.cameras[8 * number : 8 * number + 8]]
        assert all(position in own for position in some)
        assert np.allclose([camera.up @ frames[number, 1] > 0 for camera in shared.cameras[8 * number :][:8]], True)
    one = render(mesh, views=1, resolution=32, mirrored=True, frame=frames)
    assert len(one.images) == 1


@pytest.mark.parametrize("up", range(6))
def test_a_table_is_found_whichever_way_it_lies(encoder, up):
    rotation = axis_frames(np.eye(3))[up].T  # takes +y to that axis
    mesh = table()
    lying = dfd.Mesh(mesh.vertices @ rotation.T, mesh.faces)
    before = lying.vertices.copy()
    found = find_up(lying, encoder, probe=probe_of(encoder))
    assert found.source in ("file", "found")
    assert CLEAR < found.confidence <= 1
    assert abs(found.direction @ rotation[:, 1]) == pytest.approx(1)
    assert np.array_equal(lying.vertices, before)


def test_the_prior_decides_where_nothing_else_does(encoder):
    silent = probe_of(encoder, odds=np.zeros((3, len(TERMS))), file_up=4.0, file_down=2.0, file_z=1.0)
    found = find_up(table(), encoder, probe=silent)
    assert np.array_equal(found.frame, np.eye(3))
    assert found.source == "file"
    odds = np.exp([0, 0, 4, 2, 1, 1])
    assert found.confidence == pytest.approx(odds[2:4].sum() / odds.sum())
    assert found.sentence == f"+y as the file has it, {found.confidence:.0%} sure"
    assert [prior(silent, frame) for frame in axis_frames(np.eye(3))] == [0, 0, 4, 2, 1, 1]


def tilted_table(seed=0):
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    return dfd.Mesh(table().vertices @ rotation.T, table().faces), rotation


@pytest.mark.parametrize("seed", range(2))
def test_a_tilted_table_is_found(encoder, seed):
    tilted, rotation = tilted_table(seed)
    found = find_up(tilted, encoder, probe=probe_of(encoder))
    assert max(abs(frame[1] @ rotation[:, 1]) for frame in found.frames) > np.cos(np.radians(3))


def test_a_tilted_shape_is_looked_at_along_all_axes_and_then_as_it_would_stand(encoder, monkeypatch):
    looked, encode = [], encoder.encode
    monkeypatch.setattr(
        encoder, "encode", lambda images, **more: (looked.append(len(images)), encode(images, **more))[1]
    )
    silent = probe_of(encoder, odds=np.zeros((3, len(TERMS))))
    assert find_up(tilted_table()[0], encoder, probe=silent).source == "averaged"
    assert looked == [24, 8]


def test_what_files_have_by_convention_counts_half_for_a_tilted_shape(encoder):
    tilted, _ = tilted_table()
    silent = probe_of(encoder, odds=np.zeros((3, len(TERMS))), file_up=9.0, file_down=8.0, file_z=1.0)
    standing = Standing(tilted.vertices, tilted.faces)
    count = len(candidates(standing, standing.frame(), np.zeros((3, 3))))
    found = find_up(tilted, encoder, probe=silent)
    odds = np.exp(ASKEW * np.array([9.0, 8, 1, 1, *[0] * (count - 4)]))
    assert str(found) == "+y"
    assert found.confidence == pytest.approx(odds[:2].sum() / odds.sum(), rel=0.05)  # one candidate more or less


def test_another_encoders_probe_is_refused_and_without_one_the_files_up_stays(encoder):
    with pytest.raises(ValueError, match="`probe` was learned from another encoder"):
        find_up(table(), encoder, probe=probe_of(encoder, encoder_block=encoder.block + 1))
    assert find_probe(encoder) is None
    found = find_up(table(), encoder)
    assert (found.source, found.confidence) == ("file", 0)
    assert np.array_equal(found.frame, np.eye(3))
    assert found.sentence == "+y by the file's convention: there was nothing to tell it by"


@pytest.mark.parametrize("vertices", [[[0, 0, 0]] * 3, [[0, 0, 0], [1, 0, 0], [2, 0, 0]]])
def test_meshes_without_area_keep_the_files_up(encoder, vertices):
    assert find_up(dfd.Mesh(vertices, [[0, 1, 2]]), encoder, probe=probe_of(encoder)).source == "file"


def test_a_flat_sheet_is_looked_at_like_anything_else(encoder):
    sheet = dfd.Mesh([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], [[0, 1, 2], [1, 3, 2]])
    found = find_up(sheet, encoder, probe=probe_of(encoder))
    assert np.isfinite(found.confidence)
    assert np.allclose(found.frame @ found.frame.T, np.eye(3))


def test_probes_come_back_from_their_files(encoder, tmp_path):
    probe = probe_of(encoder, file_up=1.5)
    probe.save(tmp_path / "probe.safetensors")
    again = UpProbe.load(tmp_path / "probe.safetensors")
    assert again.fits(encoder)
    assert again.file_up == 1.5
    assert np.array_equal(again.odds, probe.odds)
    again.save(tmp_path / "again.safetensors")
    assert (tmp_path / "again.safetensors").read_bytes() == (tmp_path / "probe.safetensors").read_bytes()


def test_damaged_and_foreign_probes_are_refused(encoder, tmp_path):
    whole, cut, other = (tmp_path / f"{name}.safetensors" for name in ("whole", "cut", "other"))
    probe_of(encoder).save(whole)
    cut.write_bytes(whole.read_bytes()[:-10])
    with pytest.raises(ValueError, match=r"is no whole \.safetensors file"):
        UpProbe.load(cut)
    from safetensors.numpy import save_file

    save_file({"looks": np.zeros(3, np.float32)}, other)
    with pytest.raises(ValueError, match="holds no probe"):
        UpProbe.load(other)
    probe_of(encoder, odds=np.full((3, len(TERMS)), np.nan)).save(whole)
    with pytest.raises(ValueError, match="`odds` in .* must be finite"):
        UpProbe.load(whole)


def test_the_packages_own_probes_are_whole():
    found = [UpProbe.load(path) for path in sorted(FOLDER.glob("*.safetensors"))]
    assert found
    assert all(probe.file_up > max(probe.file_down, probe.file_z) >= 0 for probe in found)


def test_pictures_in_a_frame_are_those_of_the_turned_mesh():
    """A mesh that lies on its side, in the frame in which it stands, looks like the same mesh standing."""
    mesh = table()
    z_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    lying = dfd.Mesh(mesh.vertices @ z_up.T, mesh.faces)
    frame = said_up(lying, "+z").frame
    assert np.allclose(frame, z_up.T)
    standing = render(mesh, views=8, resolution=64, mirrored=True)
    seen = render(lying, views=8, resolution=64, mirrored=True, frame=frame)
    assert (seen.covered == standing.covered).mean() > 0.999
    assert (render(lying, views=8, resolution=64, mirrored=True).covered == standing.covered).mean() < 0.95
    both = (seen.covered & standing.covered)[..., None]
    assert np.abs(np.where(both, seen.images.astype(int) - standing.images, 0)).mean() < 0.5
    assert np.array_equal(seen.frame, frame)
    back = seen.points @ z_up  # the points are in the mesh's own coordinates
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
