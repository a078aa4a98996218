"""How the metric is learned: the directions that tell parts apart win, whatever varies within them."""

from __future__ import annotations

import numpy as np

import dfd
from bench.quality.evaluate import Draw
from bench.quality.learn_metric import Lesson, discriminants, report
from bench.quality.shapes import Shape
from dfd.distillation.contrast import unit


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
    return Lesson(Shape(name, sample.mesh, sample.labels, sample.parts), unit(rows.astype(np.float32)))


def test_directions_between_parts_come_first_and_longest() -> None:
    directions = discriminants([lesson("chair", 0), lesson("horse", 1), lesson("boat", 2)])
    assert directions.shape == (12, 12)
    assert np.abs(directions[:2, :2]).max() > 5 * np.abs(directions[2:, :2]).max()
    lengths = np.linalg.norm(directions, axis=0)
    assert lengths[0] > 2 * lengths[-1]


def test_equal_lessons_give_equal_directions() -> None:
    one, again = (discriminants([lesson("chair", 0), lesson("horse", 1)]) for _ in range(2))
    np.testing.assert_array_equal(one, again)


def test_the_report_leaves_the_family_out_and_sees_the_gain() -> None:
    text = report([lesson("chair", 0), lesson("horse", 1), lesson("boat", 2)], Draw(each=2, seeds=(0,)))
    assert "| seats | chair |" in text
    gain = float(text.partition("mean ")[2].partition(":")[0])
    assert gain > 0.1
