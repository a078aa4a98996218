"""How the metric is learned: the directions that tell parts apart win, whatever varies within them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dfd
from bench.quality.evaluate import Draw
from bench.quality.shapes import Shape
from bench.training.learn_kinds import KINDS, learn_kinds
from bench.training.learn_metric import Lesson, discriminants, judged, report
from bench.training.vertex_features import VertexFeatures, cached_vertex_features, vertex_features
from dfd.distillation.metric import Metric, find_metric
from dfd.distillation.targets import PointTargets, unit
from dfd.distillation.thickness import BANDS, thickness_bands
from dfd.encoders.encode import load_encoder
from dfd.encoders.learned_file import encoder_identity
from dfd.views.render import Views


def looking(features: np.ndarray) -> VertexFeatures:
    """Features (V, D) of a shape that is as thick everywhere."""
    return VertexFeatures(features, np.zeros((len(features), BANDS), np.float32))


def lesson(name: str, seed: int) -> Lesson:
    """A chair whose parts differ by little in two numbers, with ten others that vary much everywhere."""
    sample = dfd.samples.chair(4000)
    generator = np.random.default_rng(seed)
    centers = generator.normal(size=(len(sample.parts), 2))
    rows = np.concatenate(
        [
            0.5 * centers[sample.labels] + 0.05 * generator.normal(size=(len(sample.labels), 2)),
            generator.normal(size=(len(sample.labels), 10)),
        ],
        axis=1,
    )
    return Lesson(Shape(name, sample.mesh, sample.labels, sample.parts), looking(unit(rows.astype(np.float32))))


def test_directions_between_parts_come_first_and_longest() -> None:
    directions, of_bands = discriminants([lesson("chair", 0), lesson("horse", 1), lesson("boat", 2)])
    assert of_bands.shape[0] == BANDS
    directions = directions[:, :12]  # the others are of bands, which are all zero
    assert directions.shape == (12, 12)
    assert np.abs(directions[:2, :2]).max() > 5 * np.abs(directions[2:, :2]).max()
    lengths = np.linalg.norm(directions, axis=0)
    assert lengths[0] > 2 * lengths[-1]


def test_equal_lessons_give_equal_directions() -> None:
    one, again = (discriminants([lesson("chair", 0), lesson("horse", 1)]) for _ in range(2))
    for before, after in zip(one, again, strict=True):
        np.testing.assert_array_equal(before, after)


def test_parts_that_only_differ_in_thickness_are_told_apart() -> None:
    lessons = []
    for seed, name in enumerate(("chair", "horse", "boat")):
        each = lesson(name, seed)
        noise = np.random.default_rng(seed).normal(size=each.features.shape).astype(np.float32)
        thick = np.eye(BANDS, dtype=np.float32)[4 * each.shape.labels]
        lessons.append(replace(each, seen=VertexFeatures(unit(noise), thick)))
    of_features, of_bands = discriminants(lessons)
    told = [0, 4, 8]
    assert np.abs(of_bands[told, 0]).max() > 3 * np.abs(of_features[:, 0]).max()
    assert np.abs(np.delete(of_bands, told, axis=0)[:, 0]).max() < 1e-4


def test_the_report_leaves_the_family_out_and_sees_the_gain() -> None:
    text = report([lesson("chair", 0), lesson("horse", 1), lesson("boat", 2)], Draw(each=2, seeds=(0,)))
    assert "| seats | chair |" in text
    gain = float(text.partition("mean ")[2].partition(":")[0])
    assert gain > 0.1


def figure(name: str, seed: int) -> Lesson:
    """A robot whose kinds of parts look alike on every figure, but for noise and a mean of its own."""
    sample = dfd.samples.robot(4000)
    generator = np.random.default_rng(seed)
    of_kind = np.random.default_rng(99).normal(size=(len(sample.parts), 24))
    rows = of_kind[sample.labels] + generator.normal(size=24) + generator.normal(size=(len(sample.labels), 24))
    return Lesson(Shape(name, sample.mesh, sample.labels, sample.parts), looking(unit(rows.astype(np.float32))))


@pytest.mark.slow
def test_kinds_are_known_again_on_a_shape_that_was_not_seen() -> None:
    kinds = learn_kinds([figure("man", 0), figure("knight", 1), figure("golem", 2)])
    assert kinds is not None
    stranger = figure("pilot", 3)
    likely = np.square(kinds.likely(stranger.features, stranger.mean))
    truth = np.array([KINDS.index(part) for part in stranger.shape.parts])[stranger.shape.labels]
    assert (likely.argmax(axis=1) == truth).mean() > 0.9
    np.testing.assert_allclose(likely.sum(axis=1), 1, atol=1e-4)


@pytest.mark.slow
def test_equal_lessons_give_equal_kinds() -> None:
    one, again = (learn_kinds([figure("man", 0), figure("knight", 1)]) for _ in range(2))
    assert one is not None
    assert again is not None
    for name, numbers in vars(one).items():
        np.testing.assert_array_equal(numbers, getattr(again, name))


def test_no_kinds_are_learned_from_parts_that_are_none() -> None:
    assert learn_kinds([lesson("chair", 0), lesson("bench", 1)]) is None  # of its parts only the leg is a kind


def test_the_mean_of_a_surface_does_not_depend_on_how_densely_it_is_meshed() -> None:
    sample = dfd.samples.chair(4000)
    along = sample.mesh.vertices[:, :2].astype(np.float32)
    whole = Lesson(Shape("chair", sample.mesh), looking(along))
    split = dfd.samples.chair(16_000)
    fine = Lesson(Shape("chair", split.mesh), looking(split.mesh.vertices[:, :2].astype(np.float32)))
    np.testing.assert_allclose(whole.mean, fine.mean, atol=0.01)


def test_features_are_unit_and_taken_once(
    tmp_path: Path, tiny_encoder: Path, chair_mesh: dfd.Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoder, mesh = load_encoder(tiny_encoder, device="cpu", precision="float32"), chair_mesh
    seen = vertex_features(mesh, encoder, views=4, resolution=64)
    assert seen.features.shape == (len(mesh.vertices), encoder.dimension)
    assert seen.thickness.shape == (len(mesh.vertices), BANDS)
    np.testing.assert_allclose(np.linalg.norm(seen.features, axis=1), 1, atol=1e-5)
    monkeypatch.setattr("bench.training.vertex_features.vertex_features", lambda *_: seen)
    kept = cached_vertex_features(tmp_path / "features", mesh, encoder)
    np.testing.assert_allclose(kept.features, seen.features, atol=2e-3)
    np.testing.assert_array_equal(kept.thickness, seen.thickness)
    monkeypatch.setattr("bench.training.vertex_features.vertex_features", lambda *_: pytest.fail("looked again"))
    again = cached_vertex_features(tmp_path / "features", mesh, encoder)
    np.testing.assert_array_equal(again.features, kept.features)
    np.testing.assert_array_equal(again.thickness, kept.thickness)


def test_what_is_learned_from_is_what_distillation_maps(
    tmp_path: Path, tiny_encoder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoder = load_encoder(tiny_encoder, device="cpu", precision="float32")
    identity = encoder_identity(encoder)
    maps = np.eye(encoder.dimension, 3, dtype=np.float32), np.ones((BANDS, 3), np.float32)
    Metric(*maps, *identity).save(tmp_path / "tiny.safetensors")
    monkeypatch.setattr("dfd.distillation.metric.FOLDER", tmp_path)
    measured = []

    def recorded(views: Views, targets: PointTargets) -> np.ndarray:
        bands = thickness_bands(views, targets)
        measured.append((targets.features, bands))
        return bands

    monkeypatch.setattr("dfd.distillation.algorithm.thickness_bands", recorded)
    monkeypatch.setattr("bench.training.vertex_features.thickness_bands", recorded)
    mesh = dfd.samples.chair(4000).mesh
    vertex_features(mesh, encoder, views=4, resolution=64)
    dfd.distill(mesh, encoder, views=4, resolution=64, steps=2, up="file", cache=False, progress=False)
    learned_from, distilled = measured
    for one, other in zip(learned_from, distilled, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_the_packages_metric_tells_the_parts_of_a_sample_better() -> None:
    encoder = load_encoder(device="cpu")
    metric = find_metric(encoder)
    assert metric is not None
    assert metric.kinds is not None
    sample = dfd.samples.quadruped(4000)
    each = Lesson(Shape("quadruped", sample.mesh, sample.labels, sample.parts), vertex_features(sample.mesh, encoder))
    mapped = metric.mapped(each.features, each.seen.thickness, np.random.default_rng(0), mean=each.mean)
    plain, learned = (judged(each, rows, Draw(each=4, seeds=(0,))) for rows in (each.features, mapped))
    assert learned["precision"] > plain["precision"] + 0.01
