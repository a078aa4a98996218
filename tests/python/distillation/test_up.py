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
from dfd.distillation.up_probe import FOLDER, LOOKS, TERMS, UpProbe, find_probe
from dfd.distillation.upright import CLEAR, candidates, decide, find_up, prior
from dfd.distillation.views_around import CORNERS, LAYERS, SIDES, Around
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
        np.zeros((len(LOOKS), len(LAYERS), encoder.dimension), np.float32),
        odds,
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
    assert np.array_equal(candidates(Standing(mesh.vertices, mesh.faces)), axis_frames(np.eye(3)))
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    standing = Standing(mesh.vertices @ rotation.T, mesh.faces)
    found = candidates(standing)
    assert 6 <= len(found) <= 2 + 2 * RESTS
    assert np.array_equal(found[0], np.eye(3))
    assert np.allclose(np.linalg.det(found), 1)
    assert np.allclose(found[::2, 1], -found[1::2, 1])
    assert np.allclose(found[2:, 1] @ standing.frame()[0], 0)  # the mirror plane stands upright
    assert np.abs(found[:, 1] @ rotation[:, 1]).max() > np.cos(np.radians(3))


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


def look_around(mesh, encoder, frames):
    """What is seen from the sides and from the corners, together."""
    around = Around(mesh, encoder)
    return (around.seen(frames, SIDES) + around.seen(frames, CORNERS)) / 2


def test_what_is_seen_around_a_candidate_does_not_depend_on_where_it_lies(encoder):
    """All 24 ways to lay a table down show the same pictures, of the axis that was up before."""
    mesh = table()
    frames = np.stack(axis_frames(np.eye(3)))
    seen = look_around(mesh, encoder, frames)
    assert seen.shape == (6, len(LAYERS), encoder.dimension)
    scale = np.abs(seen - seen.mean(axis=0)).max()
    for index in (0, 3, 4):
        rotation = frames[index].T
        lying = look_around(dfd.Mesh(mesh.vertices @ rotation.T, mesh.faces), encoder, frames)
        for number, frame in enumerate(frames):
            other = int((frames[:, 1] @ (rotation @ frame[1])).argmax())
            assert np.abs(lying[other] - seen[number]).max() < 0.05 * scale


def test_layers_are_thirds_of_the_shape_in_its_pictures(encoder, monkeypatch):
    """Tokens that are their own row: the upper third has the least."""

    def rows(images, *, covered):
        side = images.shape[1] // encoder.patch
        tokens = np.broadcast_to(np.arange(side, dtype=np.float32)[:, None, None], (side, side, encoder.dimension))
        return np.broadcast_to(tokens, (len(images), *tokens.shape))

    monkeypatch.setattr(encoder, "encode", rows)
    mean, upper, middle, lower = look_around(table(), encoder, np.eye(3)[None])[0, :, 0]
    assert upper < middle < lower
    assert upper < mean < lower


@pytest.mark.parametrize("look", LOOKS)
def test_looks_decide_when_the_surface_says_nothing(encoder, look):
    mesh, frames = table(), np.stack(axis_frames(np.eye(3)))
    seen = look_around(mesh, encoder, frames)
    towards = (seen[4] - np.delete(seen, 4, axis=0).mean(axis=0)).astype(np.float32)
    odds = np.zeros(len(TERMS))
    odds[TERMS.index(look)] = 100 / np.square(towards).sum()
    looks = np.stack([towards if look == each else np.zeros_like(towards) for each in LOOKS])
    found = find_up(mesh, encoder, probe=probe_of(encoder, looks=looks, odds=odds))
    assert str(found) == "+z"
    assert found.source == "found"
    assert found.sentence == f"+z, {found.confidence:.0%} sure"


@pytest.mark.parametrize(("sure", "pictures"), [(True, 24), (False, 48)])
def test_four_sides_are_enough_where_the_axis_is_sure(encoder, monkeypatch, sure, pictures):
    """Four pictures of each of six directions; four more where they leave a doubt, and all eight decide."""
    mesh, frames, looked = table(), np.stack(axis_frames(np.eye(3))), []
    from_eight = look_around(mesh, encoder, frames)
    encode = encoder.encode
    monkeypatch.setattr(
        encoder, "encode", lambda images, **more: (looked.append(len(images)), encode(images, **more))[1]
    )
    looks = np.random.default_rng(0).standard_normal((len(LOOKS), *from_eight.shape[1:])).astype(np.float32)
    told = np.einsum("kld,ld->k", from_eight, looks[0])
    odds = np.zeros(len(TERMS))
    odds[TERMS.index(LOOKS[0])] = (100.0 if sure else 0.1) / np.ptp(told)
    found = find_up(mesh, encoder, probe=probe_of(encoder, looks=looks, odds=odds))
    assert sum(looked) == pictures
    if not sure:
        assert found.confidence == pytest.approx(decide(frames, told * odds[TERMS.index(LOOKS[0])]).confidence)


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
    silent = probe_of(encoder, odds=np.zeros(len(TERMS)), file_up=4.0, file_down=2.0, file_z=1.0)
    found = find_up(table(), encoder, probe=silent)
    assert np.array_equal(found.frame, np.eye(3))
    assert found.source == "file"
    odds = np.exp([0, 0, 4, 2, 1, 1])
    assert found.confidence == pytest.approx(odds[2:4].sum() / odds.sum())
    assert found.sentence == f"+y as the file has it, {found.confidence:.0%} sure"
    assert [prior(silent, frame) for frame in axis_frames(np.eye(3))] == [0, 0, 4, 2, 1, 1]


def test_a_tilted_shape_has_no_prior(encoder):
    rotation = Rotation.random(rng=np.random.default_rng(0)).as_matrix()
    tilted = dfd.Mesh(table().vertices @ rotation.T, table().faces)
    silent = probe_of(encoder, odds=np.zeros(len(TERMS)), file_up=9.0, file_down=8.0, file_z=1.0)
    found = find_up(tilted, encoder, probe=silent)
    assert found.source == "averaged"
    assert found.confidence <= 1 / 3


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
    probe_of(encoder, odds=np.full(len(TERMS), np.nan)).save(whole)
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
