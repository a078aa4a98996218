"""Test pictures around a shape, their votes for the up direction, and the file of a probe."""

import numpy as np
import pytest
from made_table import probe_of, table
from scipy.spatial.transform import Rotation

import dfd
from dfd.upright.candidates import axis_frames
from dfd.upright.probe import FOLDER, TERMS, UpProbe
from dfd.upright.probe_views import SIDES, ProbeCameras, ViewTokens


def test_what_is_seen_around_a_candidate_does_not_depend_on_where_it_lies(encoder):
    """Compare the tokens of pictures around each direction of a table with those of the rotated table."""
    mesh = table()
    frames = np.stack(axis_frames(np.eye(3)))

    def mean_tokens(mesh):
        seen = ProbeCameras(mesh, encoder).seen(frames, SIDES)
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


def pictures(generator, count, width):
    """Return random tokens of random cameras."""
    axes = Rotation.random(count, rng=generator).as_matrix()
    return ViewTokens(generator.standard_normal((count, 2, width)).astype(np.float32), axes)


def random_probe(encoder, generator, **changes):
    """Return a probe with random votes."""
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
    turned = probe.votes(ViewTokens(seen.tokens, seen.axes @ rotation.T))
    assert np.allclose(turned[0], rotation @ form @ rotation.T)
    assert np.allclose(turned[1], rotation @ vector)
    # In a mirrored picture, the right axis of the camera is negated, and both halves of the picture are exchanged.
    mirror = np.diag([-1.0, 1, 1])
    mirrored = ViewTokens(seen.tokens * np.float32([1, -1])[:, None], np.diag([-1.0, 1, 1]) @ seen.axes @ mirror)
    assert np.allclose(probe.votes(mirrored)[0], mirror @ form @ mirror)
    assert np.allclose(probe.votes(mirrored)[1], mirror @ vector)


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
    with pytest.raises(ValueError, match=r"is not a complete \.safetensors file"):
        UpProbe.load(cut)
    from safetensors.numpy import save_file

    save_file({"looks": np.zeros(3, np.float32)}, other)
    with pytest.raises(ValueError, match="does not hold dfd up probe 2"):
        UpProbe.load(other)
    probe_of(encoder, odds=np.full((3, len(TERMS)), np.nan)).save(whole)
    with pytest.raises(ValueError, match="`odds` must be finite"):
        UpProbe.load(whole)


def test_the_packages_own_probes_are_whole():
    found = [UpProbe.load(path) for path in sorted(FOLDER.glob("*.safetensors"))]
    assert found
    assert all(probe.file_up > max(probe.file_down, probe.file_z) >= 0 for probe in found)
