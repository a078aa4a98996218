"""`python -m bench.quality.learn_metric`: learn which differences tell parts apart, judged on families left out.

From the rigs in the folder that DFD_MESHES names (its "rigs" and "upright" folders, and skinned characters), +y up, and
the samples of dfd. Fields are kept between runs; a folder that is given with --fields is taken as it is. Equal fields
give equal files.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

import dfd
from bench.quality import shapes
from bench.quality.evaluate import Draw, judge
from bench.quality.families import family_of
from bench.quality.shapes import Shape
from dfd.common.files import atomic_write
from dfd.distillation.metric import FOLDER, Metric
from dfd.encoders.encode import Encoder, load_encoder

REPORT = Path(__file__).resolve().parents[1] / "results" / "quality" / "metric.md"
KEPT_FIELDS = REPORT.parent / "metric_fields"
DIRECTIONS = 64
RIDGE = 1.0  # of the mean variance within parts
POWER = 0.125  # of the ratio of variances that a direction's length is
FEWEST = 5  # vertices of a part that says something
FACES = 20_000  # of the samples
DRAW = Draw()

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lesson:
    """A labelled shape with the features of its vertices."""

    shape: Shape
    features: NDArray[np.float32]  # (V, D)

    @property
    def family(self) -> str:
        """See `family_of`."""
        return family_of(self.shape.name)

    @cached_property
    def scatters(self) -> tuple[Matrix, Matrix]:
        """How features vary within and between parts, (D, D) each: parts count alike, and their sum has trace 1."""
        assert self.shape.labels is not None
        rows = [self.features[self.shape.labels == part].astype(np.float64) for part in range(len(self.shape.parts))]
        rows = [part for part in rows if len(part) >= FEWEST]
        within = np.mean([np.cov(part.T, bias=True) for part in rows], axis=0)
        between = np.cov(np.stack([part.mean(axis=0) for part in rows]).T, bias=True)
        trace = np.trace(within + between)
        return within / trace, between / trace


def main(arguments: Sequence[str] | None = None) -> None:
    """Distill, learn, judge and write."""
    parser = argparse.ArgumentParser("python -m bench.quality.learn_metric", description=__doc__)
    parser.add_argument("--encoder", default="dinov2-small")
    parser.add_argument("--output", type=Path, help="the metric's file; by default where the package looks for it")
    parser.add_argument("--fields", type=Path, default=KEPT_FIELDS, help="where fields are kept (%(default)s)")
    options = parser.parse_args(arguments)
    if not os.environ.get("DFD_MESHES"):
        parser.error("DFD_MESHES must name the folder of meshes to learn from")
    encoder = load_encoder(options.encoder)
    lessons = []
    for shape in labelled_shapes(Path(os.environ["DFD_MESHES"]), print):
        print(shape.name, flush=True)
        lessons.append(Lesson(shape, kept_field(options.fields, shape, encoder).features(shape.mesh)))
    output = options.output or FOLDER / f"{options.encoder}.safetensors"
    output.parent.mkdir(parents=True, exist_ok=True)
    learn(lessons, encoder).save(output)
    REPORT.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(REPORT) as temporary:
        temporary.write_text(report(lessons), "utf-8")
    print(f"{output}\n{REPORT}")


def labelled_shapes(folder: Path, say: Callable[[str], None]) -> list[Shape]:
    """Every shape to learn from; characters by the merged names of their parts."""
    found = [*shapes.rigs(folder, say), *shapes.rigs(folder, say, under="upright")]
    found += [shape for shape in shapes.characters(folder, say) if "rig names" not in shape.name]
    return found + shapes.made(FACES)


def kept_field(folder: Path, shape: Shape, encoder: Encoder) -> dfd.Field:
    """The field of a shape by the plain distance, from `folder` if it is there: distilling it takes long."""
    path = folder / f"{shape.mesh.content_hash}.field.safetensors"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        dfd.distill(shape.mesh, encoder, up="file", metric="none", progress=False).save(path)
    return dfd.Field.load(path)


def learn(lessons: Sequence[Lesson], encoder: Encoder) -> Metric:
    """The metric of all lessons."""
    settings = encoder.settings()
    return Metric(discriminants(lessons), str(settings["encoder_weights"]), int(settings["encoder_block"]))


def discriminants(lessons: Sequence[Lesson]) -> NDArray[np.float32]:
    """(D, d) the directions in which features change most between parts for what they change within them.

    Every family counts alike. A direction is of unit variance within parts, times a power of the ratio of variances.

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
    return np.ascontiguousarray(directions * np.maximum(ratio, 0) ** POWER, np.float32)


def judged(lesson: Lesson, features: NDArray[np.float32], draw: Draw) -> dict[str, float]:
    """The verdict on a lesson's shape with other features."""
    return judge(lesson.shape, lambda chosen: dfd.bind(features, chosen), draw)


def report(lessons: Sequence[Lesson], draw: Draw = DRAW) -> str:
    """Precision and how many vertices move, each shape through the metric that the other families gave."""
    lines = [
        "# A learned metric",
        "",
        "Each shape judged without its family; precision, and the share of vertices that a handle moves by more than "
        "0.01, by the plain distance and by the learned one. Fields by the plain distance, mapped at the vertices.",
        "",
        "| family | shape | precision, none | learned | moving, none | learned |",
        "|---|---|---:|---:|---:|---:|",
    ]
    gains: dict[str, list[float]] = {}
    for family in dict.fromkeys(each.family for each in lessons):
        others = [each for each in lessons if each.family != family]
        if not others:
            continue
        metric = Metric(discriminants(others), "", 0)
        for lesson in (each for each in lessons if each.family == family):
            mapped = metric.mapped(lesson.features, np.random.default_rng(0))
            plain, learned = judged(lesson, lesson.features, draw), judged(lesson, mapped, draw)
            numbers = [verdict[name] for name in ("precision", "moving") for verdict in (plain, learned)]
            lines.append(f"| {family} | {lesson.shape.name} | " + " | ".join(f"{each:.3f}" for each in numbers) + " |")
            gains.setdefault(family, []).append(learned["precision"] - plain["precision"])
    by_family = {family: float(np.mean(some)) for family, some in gains.items()}
    told = ", ".join(f"{family} {gain:+.3f}" for family, gain in by_family.items())
    return "\n".join([*lines, "", f"Gain by family, mean {np.mean(list(by_family.values())):+.4f}: {told}.", ""])


if __name__ == "__main__":
    main()
