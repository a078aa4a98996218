"""`python -m bench.training.learn_metric`: learn a metric, a map of features that separates parts, and test it.

The training shapes are the samples of dfd, and the rigs and skinned characters in the folder that DFD_MESHES names;
their up is +y. `--lessons` adds a folder with rigs and people. The features of each shape are cached in a file.
Training on the same features writes identical files. docs/learned.md lists the training shapes of the packaged metric.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
import torch
from torch import nn

import dfd
from bench.quality import shapes
from bench.quality.measures import draw_handles, handle_precision, mean_over_labels
from bench.tables import to_markdown
from bench.training.sources import RESULTS, run
from bench.training.vertex_features import THICKNESS, Lesson, cached_lesson
from dfd.common.devices import one_thread
from dfd.common.linear_algebra import Float32, Float64, Int64
from dfd.distillation.metric import FOLDER, Kinds, Metric
from dfd.encoders.encode import Encoder
from dfd.encoders.learned_file import encoder_identity

REPORT, CACHE = RESULTS / "metric.md", RESULTS / "metric_features"
DIRECTIONS = 51  # number of discriminant directions; with the 13 kinds of parts, a mapped feature has 64 dimensions
RIDGE = 1.0  # number that is added to all variances within parts, divided by their mean
POWER = 0.125  # A direction is multiplied by its ratio (variance between parts / within parts) raised to this power.
FACES = 20_000  # number of faces of each sample
EACH, SEEDS = 8, 3  # number of handles that are drawn from every part, and number of draws, to measure precision

# Settings of the network that classifies features by kind of part.
KINDS = ("ear", "horn", "trunk", "wing", "fin", "tail", "foot", "leg", "neck", "head", "torso", "hand", "arm")
SAME = {"body": "torso", "hoof": "foot"}  # names of parts that count as another kind
HIDDEN = 256
POINTS = 80  # largest number of vertices that are used of each part
STEPS, BATCH, LEARNING_RATE, DECAY = 400, 1024, 3e-3, 0.05
DROPPED, DROPPED_UNITS = 0.2, 0.5  # dropout: fractions of the inputs and of the hidden units
LABEL_SMOOTHING = 0.05  # smoothing of the loss, which makes the network less certain about unknown shapes
FAMILY_POWER = 0.5  # The weight of a family is its number of shapes raised to this power.
SCALE = 20.0  # factor on features, about √384, so that the magnitudes of the inputs are about 1


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn the metric, test it, and write the metric and a report."""
    run(arguments, __spec__.name, __doc__, FOLDER, REPORT, lessons_of, learn, report)


def lessons_of(folder: Path, more: Path | None, encoder: Encoder) -> Iterator[Lesson]:
    """Yield the training data (the lesson) of every shape."""
    found = [*shapes.rigs(folder / "rigs"), *shapes.rigs(folder / "upright"), *shapes.characters(folder)]
    for under in ("rigs", "people") if more else ():
        found += shapes.rigs(more / under)
    for shape in found + shapes.made(FACES):
        print(shape.name, flush=True)
        yield cached_lesson(CACHE, shape, encoder)


def learn(lessons: Sequence[Lesson], encoder: Encoder) -> Metric:
    """Return the metric that is learned from all lessons."""
    return Metric(*discriminants(lessons), *encoder_identity(encoder), learn_kinds(lessons))


def discriminants(lessons: Sequence[Lesson]) -> tuple[Float32, Float32]:
    """Return the directions with the largest ratio of the variance between parts to the variance within parts.

    The result is two matrices: for features (D, d) and for thickness bands (BANDS, d). Families have equal weight. Each
    direction is scaled to unit variance within parts, then multiplied by a power of its ratio of variances.

    Source: Fisher, "The use of multiple measurements in taxonomic problems", 1936; ridge: Friedman, "Regularized
    discriminant analysis", 1989.
    """
    size = Counter(each.family for each in lessons)
    within = np.sum([each.scatters[0] / size[each.family] for each in lessons], axis=0)
    between = np.sum([each.scatters[1] / size[each.family] for each in lessons], axis=0)
    within += RIDGE * np.trace(within) / len(within) * np.eye(len(within))
    ratio, directions = scipy.linalg.eigh(between, within)
    ratio, directions = ratio[: -DIRECTIONS - 1 : -1], directions[:, : -DIRECTIONS - 1 : -1]
    directions *= np.sign(directions[np.abs(directions).argmax(axis=0), np.arange(directions.shape[1])])
    directions *= np.maximum(ratio, 0) ** POWER
    of_features, of_bands = np.split(directions, [lessons[0].features.shape[1]])
    return np.ascontiguousarray(of_features, np.float32), np.ascontiguousarray(THICKNESS * of_bands, np.float32)


def learn_kinds(taught: Sequence[Lesson]) -> Kinds:
    """Return a network that classifies features by kind of part, learned from all shapes with at least two of `KINDS`.

    A family of N shapes has the weight √N. Shapes of a family have equal weight, and so have the parts of a shape.
    """
    generator = np.random.default_rng(0)
    rows, kinds, chances = [], [], []
    size = Counter(each.family for each in taught)
    for each in taught:
        named = [(SAME.get(name, name), points) for name, points in each.kinds if len(points)]
        known = [(name, points) for name, points in named if name in KINDS]
        for name, points in known if len(known) > 1 else ():
            some = generator.choice(len(points), min(POINTS, len(points)), replace=False)
            rows.append((points[some] - each.mean) * np.float32(SCALE))
            kinds.append(np.full(len(some), KINDS.index(name)))
            chances.append(np.full(len(some), 1 / (size[each.family] ** FAMILY_POWER * len(known) * len(some))))
    return _fitted(np.concatenate(rows), np.concatenate(kinds), np.concatenate(chances), generator)


def _fitted(rows: Float32, kinds: Int64, chances: Float64, generator: np.random.Generator) -> Kinds:
    """Train the network on `rows` (N, D) and their `kinds` (N,). Rows are drawn in proportion to `chances` (N,)."""
    x, y, until = torch.from_numpy(rows), torch.from_numpy(kinds), np.cumsum(chances / chances.sum())
    with one_thread(), torch.random.fork_rng(devices=[]):  # one thread gives reproducible sums
        torch.manual_seed(int(generator.integers(2**31)))
        hidden, output = nn.Linear(rows.shape[1], HIDDEN), nn.Linear(HIDDEN, len(KINDS))
        network = nn.Sequential(nn.Dropout(DROPPED), hidden, nn.ReLU(), nn.Dropout(DROPPED_UNITS), output)
        optimizer = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=DECAY)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
        for _ in range(STEPS):
            drawn = torch.from_numpy(np.searchsorted(until, generator.random(BATCH)).clip(max=len(until) - 1))
            loss = nn.functional.cross_entropy(network(x[drawn]), y[drawn], label_smoothing=LABEL_SMOOTHING)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
    weights, *others = (each.detach().numpy().T.copy() for each in network.parameters())
    return Kinds(weights * np.float32(SCALE), *others)


def precision(lesson: Lesson, features: Float32) -> float:
    """Return the mean average precision with which weights by `features` (V, D) find parts, over `SEEDS` draws."""
    labels, found = lesson.shape.labels, []
    for seed in range(SEEDS):
        handles = draw_handles(labels, EACH, seed)
        own = handle_precision(dfd.bind(features, handles), labels, handles)
        found.append(mean_over_labels(labels[handles], own))
    return float(np.mean(found))


def report(lessons: Sequence[Lesson]) -> str:
    """Return a report: precision on shapes by features alone, and by a metric learned without the shape's family."""
    rows: list[list[Any]] = []
    gains: dict[str, float] = {}
    for family in dict.fromkeys(each.family for each in lessons):
        others = [each for each in lessons if each.family != family]
        metric = Metric(*discriminants(others), "", 0, learn_kinds(others))
        own = [each for each in lessons if each.family == family]
        for lesson in own:
            generator = np.random.default_rng(0)
            mapped = metric.mapped(lesson.features, lesson.thickness, generator, mean=lesson.mean)
            rows.append([family, lesson.shape.name, precision(lesson, lesson.features), precision(lesson, mapped)])
        gains[family] = float(np.mean([learned - alone for *_, alone, learned in rows[-len(own) :]]))
    by_family = ", ".join(f"{family} {gain:+.3f}" for family, gain in gains.items())
    blocks = [
        "# A learned metric",
        "The metric for each shape is learned without its family. Features are those at vertices, without a field.",
        to_markdown(["family", "shape", "features alone", "learned"], rows, ".3f"),
        f"Gain by family, mean {np.mean(list(gains.values())):+.4f}: {by_family}.",
    ]
    return "\n\n".join(blocks) + "\n"


if __name__ == "__main__":
    main()
