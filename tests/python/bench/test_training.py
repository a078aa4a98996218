"""What is learned for the package: the directions and kinds of the metric, the probe for up, and their reports."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import dfd
from bench.quality.shapes import Shape
from bench.training import learn_metric, learn_up
from bench.training.learn_kinds import KINDS, learn_kinds
from bench.training.learn_metric import discriminants, report
from bench.training.learn_up import decided, least_priors, upright_shapes
from bench.training.up_lessons import FRAMES, RIDGE, TRUE, Choice, Odds, Ridge, Rows, fit_odds
from bench.training.vertex_features import Lesson, VertexFeatures, vertex_features
from dfd.distillation.metric import Metric
from dfd.distillation.targets import unit
from dfd.distillation.thickness import BANDS, thickness_bands
from dfd.encoders.encode import load_encoder
from dfd.encoders.learned_file import encoder_identity
from dfd.upright.probe import TERMS

FAMILIES = ("chair", "horse", "boat")


def lesson(sample: dfd.samples.Sample, name: str, rows: np.ndarray) -> Lesson:
    """A shape of features (V, D) that is as thick everywhere."""
    seen = VertexFeatures(unit(rows.astype(np.float32)), np.zeros((len(rows), BANDS), np.float32))
    return Lesson(Shape(name, sample.mesh, sample.labels, sample.parts), seen)


@pytest.fixture(scope="module")
def lessons(chair_sample) -> list[Lesson]:
    """Chairs whose parts differ by little in two numbers, with ten others that vary much everywhere."""
    made, labels = [], chair_sample.labels
    for seed, name in enumerate(FAMILIES):
        generator = np.random.default_rng(seed)
        centers = generator.normal(size=(len(chair_sample.parts), 2))
        told = 0.5 * centers[labels] + 0.05 * generator.normal(size=(len(labels), 2))
        made.append(lesson(chair_sample, name, np.hstack([told, generator.normal(size=(len(labels), 10))])))
    return made


def test_directions_between_parts_come_first_and_longest(lessons):
    directions, of_bands = discriminants(lessons)
    assert of_bands.shape[0] == BANDS
    directions = directions[:, :12]  # the others are of bands, which are all zero
    assert np.abs(directions[:2, :2]).max() > 5 * np.abs(directions[2:, :2]).max()
    lengths = np.linalg.norm(directions, axis=0)
    assert lengths[0] > 2 * lengths[-1]
    for before, after in zip((directions, of_bands), discriminants(lessons), strict=True):
        np.testing.assert_array_equal(before, after[:, : before.shape[1]])


def test_the_report_leaves_the_family_out_and_sees_the_gain(lessons):
    text = report(lessons)
    assert "| seats | chair |" in text
    assert float(text.partition("mean ")[2].partition(":")[0]) > 0.1
    assert learn_kinds(lessons) is None  # of their parts only the leg is a kind


@pytest.mark.slow
def test_kinds_are_known_again_on_a_shape_that_was_not_seen():
    sample = dfd.samples.robot(4000)
    of_kind = np.random.default_rng(99).normal(size=(len(sample.parts), 24))

    def figure(name: str, seed: int) -> Lesson:
        noise = np.random.default_rng(seed).normal(size=(len(sample.labels) + 1, 24))
        return lesson(sample, name, of_kind[sample.labels] + noise[0] + noise[1:])

    kinds = learn_kinds([figure("man", 0), figure("knight", 1), figure("golem", 2)])
    stranger = figure("pilot", 3)
    likely = np.square(kinds.likely(stranger.seen.features, stranger.mean))
    truth = np.array([KINDS.index(part) for part in sample.parts])[sample.labels]
    assert (likely.argmax(axis=1) == truth).mean() > 0.9
    np.testing.assert_allclose(likely.sum(axis=1), 1, atol=1e-4)


def test_what_is_learned_from_is_what_distillation_maps(tmp_path, tiny_encoder, chair_mesh, monkeypatch):
    encoder = load_encoder(tiny_encoder, device="cpu", precision="float32")
    maps = np.eye(encoder.dimension, 3, dtype=np.float32), np.ones((BANDS, 3), np.float32)
    Metric(*maps, *encoder_identity(encoder)).save(tmp_path / "tiny.safetensors")
    monkeypatch.setattr("dfd.distillation.metric.FOLDER", tmp_path)
    measured = []

    def recorded(views, targets):
        bands = thickness_bands(views, targets)
        measured.append((targets.features, bands))
        return bands

    monkeypatch.setattr("dfd.distillation.algorithm.thickness_bands", recorded)
    monkeypatch.setattr("bench.training.vertex_features.thickness_bands", recorded)
    vertex_features(chair_mesh, encoder, views=4, resolution=64)
    dfd.distill(chair_mesh, encoder, views=4, resolution=64, steps=2, up="file", cache=False, progress=False)
    for one, other in zip(*measured, strict=True):
        np.testing.assert_array_equal(one, other)


# --- up


def test_odds_find_the_term_that_tells():
    """Among candidates of any number, of which several may be right."""
    generator, choices = np.random.default_rng(0), []
    for number in range(40):
        rows = generator.normal(size=(4 + number % 5, len(TERMS)))
        right = np.arange(len(rows)) < 1 + number % 2
        rows[right, 3] += 4
        choices.append(Choice(rows, right, FRAMES))
    odds = fit_odds([*choices, Choice(np.ones((3, len(TERMS))), np.zeros(3, bool), FRAMES[:3])])
    assert odds.argmax() == 3
    assert np.mean([each.right[(each.terms @ odds).argmax()] for each in choices]) > 0.9
    assert np.allclose(odds, fit_odds(choices), atol=1e-3)  # where none is right there is nothing to learn
    assert np.allclose(odds, fit_odds(choices, odds), atol=1e-3)


@pytest.mark.parametrize("along", [(1.0, 0, 0, 0, 0, 0), (2.0, 2, 0, 2.5, 0, 0)])
def test_the_least_priors_keep_ones_own_shapes_upright(along):
    """Here another axis is likelier without a prior; other shapes may have the right axis as one of two."""
    odds = Odds(np.zeros((6, 6)), np.array(along))
    up, down = least_priors({"one": odds.along}, {"one"})
    assert decided(odds, TRUE, (0.0, 0.0)) != (TRUE // 2, TRUE)
    assert decided(odds, TRUE, (up, down)) == (TRUE // 2, TRUE)
    many = {f"lessons/{number}": np.array([0, 0, 5.0, 0, 0, 0]) for number in range(200)}
    assert least_priors({**many, "one": odds.along})[0] == 0


@pytest.mark.parametrize("left_out", [[], [2], [0, 5]])
def test_votes_without_some_are_what_the_others_teach(left_out):
    generator, blocks, width = np.random.default_rng(0), 3, 5
    rows = [Rows(generator.normal(size=(6, 15)), generator.normal(size=6), np.full(6, 0.5)) for _ in range(6)]
    counts, terms = (np.concatenate([getattr(each, name) for each in rows]) for name in ("counts", "terms"))
    squares = np.square(terms.reshape(-1, blocks, width)).sum(axis=2)
    scales = np.repeat(np.sqrt(np.average(squares, axis=0, weights=counts)), width)
    kept = [each for number, each in enumerate(rows) if number not in left_out]
    terms = np.concatenate([each.terms for each in kept]) / scales
    counts, targets = (np.concatenate([getattr(each, name) for each in kept]) for name in ("counts", "targets"))
    moment = terms.T @ (counts[:, None] * terms) + RIDGE * blocks * np.eye(15)
    direct = np.linalg.solve(moment, terms.T @ (counts * targets)) / scales
    found = Ridge(rows, blocks).without([rows[number] for number in left_out]).ravel()
    assert np.allclose(found, direct, rtol=1e-4, atol=1e-6)


def test_further_shapes_are_few_of_a_kind_and_have_an_up(tmp_path, monkeypatch):
    monkeypatch.setattr("bench.training.sources.MOST_ALIKE", 1)
    things = tmp_path / "lessons" / "upright"
    things.mkdir(parents=True)
    dfd.samples.robot(4000).mesh.save(things / "some_pack_jar1.glb")
    for name in ("some_pack_jar2", "some_pack_jar3", "some_pack_tree", "other_pack_jar", "a_bone"):
        shutil.copy(things / "some_pack_jar1.glb", things / f"{name}.glb")
    (tmp_path / "meshes").mkdir()
    shutil.copy(things / "some_pack_jar1.glb", tmp_path / "meshes" / "of_another_license.glb")
    names = [name for name, _ in upright_shapes(tmp_path / "meshes", tmp_path / "lessons")]
    further = ("other_pack_jar", "some_pack_tree")
    assert names == [*(f"lessons/upright/{each}" for each in further), "chair", "quadruped", "robot"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:encode. a resolution")
@pytest.mark.parametrize("module", [learn_metric, learn_up])
def test_the_command_learns_judges_and_writes(tmp_path, tiny_encoder, monkeypatch, module):
    monkeypatch.setenv("DFD_MESHES", str(tmp_path))
    for name in ("REPORT", "CACHE", "KEPT_VIEWS"):
        if hasattr(module, name):
            monkeypatch.setattr(module, name, tmp_path / name)
    module.main(["--encoder", str(tiny_encoder), "--output", str(tmp_path / "learned.safetensors")])
    assert (tmp_path / "learned.safetensors").stat().st_size > 0
    assert "all" in (tmp_path / "REPORT").read_text() or "Gain" in (tmp_path / "REPORT").read_text()
