"""Learn the probability that two regions are of one kind: the weights of `dfd.segmentation.alike`.

Lessons are generated shapes (`bench.training.made_shapes`), which know the kind of each part, and rigs, in which joints
with equal names but for side and number have parts of one kind. A lesson draws a part and a place on it, and takes the
candidate there that is nearest to the part. The other regions of the shape are examples: those that are nearly a part
of the same kind, and those that are none. The weights minimize the cross-entropy.

`python -m bench.training.learn_alike RIGS` writes the file that dfd loads. Before, it learns without each family in
turn, and prints how well the weights rank the examples of this family.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch

import dfd
import dfd.segmentation
from bench.quality.anatomy import LARGEST_JUDGED, SMALLEST_JUDGED, read_rigged, sides_as_one
from bench.quality.measures import average_precision
from bench.quality.parts import family_of, kind_of_part
from bench.tables import write_text
from bench.training.learn_parts import trees_of
from bench.training.made_shapes import MadeShape, made_shape
from dfd.common.linear_algebra import Bool, Float64
from dfd.geometry.topology import face_areas
from dfd.segmentation.alike import CUES, compared
from dfd.segmentation.choose import candidates
from dfd.segmentation.regions import all_regions, measured
from dfd.segmentation.trees import Trees

SHAPES = 77  # number of generated shapes: seven of each family
DRAWS = 24  # number of places on each shape
SAME, OTHER = 0.6, 0.35  # least IoU of a region that is a part of the kind, and largest IoU of one that is none
COMPARED = 4.0  # pairs of regions whose areas have a larger ratio are no examples
PENALTY = 1e-5  # factor of the squared norm of the weights


@dataclass(frozen=True, eq=False)
class Lesson:
    """A mesh with parts whose kinds are known."""

    mesh: dfd.Mesh
    masks: Sequence[Bool]  # (F,) the faces of each part
    kinds: Sequence[str]  # kind of each part
    groups: Sequence[str]  # parts of one group but of two kinds, such as thumb and finger, are no examples
    family: str


@dataclass(frozen=True, eq=False)
class Examples:
    """The pairs of regions of one shape."""

    cues: Float64  # (N, C)
    alike: Bool  # (N,) whether the regions of a pair are of one kind
    family: str


def lesson_of(shape: MadeShape) -> Lesson:
    """Return a generated shape as a lesson."""
    masks = [mask[shape.mesh.faces].sum(axis=1) >= 2 for part in shape.parts for mask in part]
    kinds = [f"{word} {kind}" for pair in shape.kinds for word, kind in zip(("alone", "whole"), pair, strict=True)]
    return Lesson(shape.mesh, masks, kinds, kinds, shape.family)


def lesson_of_rig(path: Path) -> Lesson:
    """Return a rig as a lesson. The subtrees of joints of one name, but for side and number, are of one kind."""
    rig = read_rigged(path)
    masks, kinds, groups = [], [], []
    for joint, name in enumerate(rig.joints):
        mask = rig.subtree(joint)
        if SMALLEST_JUDGED <= rig.areas @ mask <= LARGEST_JUDGED:
            masks.append(mask[rig.mesh.faces].sum(axis=1) >= 2)
            kinds.append(sides_as_one(name) or name)
            groups.append(kind_of_part(name) or kinds[-1])
    return Lesson(rig.mesh, masks, kinds, groups, family_of(path.stem))


def examples(lesson: Lesson, trees: Trees, seed: int) -> Examples:
    """Return pairs of regions of one shape."""
    generator, regions, mesh = np.random.default_rng(seed), all_regions(trees), lesson.mesh
    measures = measured(trees, regions)
    areas = face_areas(mesh.vertices, mesh.faces)
    areas = areas / areas.sum()
    of_face = np.median(np.sort(trees.patches.of_vertex[mesh.faces], axis=1), axis=1).astype(np.int64)
    own = np.bincount(of_face, areas, len(trees.patches.area))
    kinds, groups = np.array(lesson.kinds), np.array(lesson.groups)
    parts = np.array([np.bincount(of_face[mask], areas[mask], len(own)) for mask in lesson.masks])
    cues, alike = [np.zeros((0, len(CUES)))], [np.zeros(0, bool)]
    overlaps = _ious(regions, parts, own) if len(parts) else np.zeros((0, len(regions)))
    for _ in range(DRAWS if len(parts) else 0):
        part = int(generator.integers(len(parts)))
        if not parts[part].sum() > 0:
            continue
        place = int(generator.choice(len(own), p=parts[part] / parts[part].sum()))
        found = candidates(trees, place).regions
        fits = _ious(found, parts[part][None], own)[0]
        if fits.max() < SAME:
            continue
        rows, each, _ = compared(trees, found[fits.argmax()], measures)
        here = np.arange(len(parts)) == part
        best = overlaps[(kinds == kinds[part]) & ~here][:, rows].max(axis=0, initial=0.0)
        unsure = overlaps[(groups == groups[part]) & (kinds != kinds[part])][:, rows].max(axis=0, initial=0.0) > OTHER
        known = (best > SAME) | ((best < OTHER) & ~unsure)
        known &= each[:, CUES.index("area")] < np.log(COMPARED)
        cues.append(each[known])
        alike.append(best[known] > SAME)
    return Examples(np.concatenate(cues), np.concatenate(alike), lesson.family)


def _ious(regions: Bool, parts: Float64, own: Float64) -> Float64:
    """Return the IoU (M, R) of M parts, given as areas in the patches, and R regions. `own` (P,) are the areas."""
    common = parts @ regions.T.astype(np.float64)
    return np.asarray(common / (parts.sum(axis=1)[:, None] + regions @ own - common), np.float64)


def learn(lessons: Sequence[Examples]) -> tuple[float, Float64]:
    """Return the constant and the weights (C,) of the logistic function. All shapes count equally."""
    cues, alike = np.concatenate([each.cues for each in lessons]), np.concatenate([each.alike for each in lessons])
    shares = torch.tensor(np.concatenate([np.full(len(each.alike), 1 / max(len(each.alike), 1)) for each in lessons]))
    mean, spread = cues.mean(axis=0), cues.std(axis=0)
    inputs, targets = torch.tensor((cues - mean) / spread), torch.tensor(alike.astype(np.float64))
    weights = torch.zeros(len(CUES) + 1, dtype=torch.double, requires_grad=True)
    optimizer = torch.optim.LBFGS([weights], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> Any:
        optimizer.zero_grad()
        scores = inputs @ weights[1:] + weights[0]
        each = torch.nn.functional.binary_cross_entropy_with_logits(scores, targets, reduction="none")
        found = (shares * each).sum() / shares.sum() + PENALTY * weights[1:].square().sum()
        found.backward()
        return found

    optimizer.step(loss)
    constant, *scaled = weights.detach().numpy()
    return float(constant - mean @ (scaled / spread)), np.asarray(scaled / spread, np.float64)


def report(lessons: Sequence[Examples]) -> str:
    """Return the average precision of each family for weights that are learned from the other families."""
    lines = []
    for family in dict.fromkeys(each.family for each in lessons):
        constant, weights = learn([each for each in lessons if each.family != family])
        left = [each for each in lessons if each.family == family]
        scores = np.concatenate([each.cues for each in left]) @ weights + constant
        alike = np.concatenate([each.alike for each in left])
        lines.append(
            f"{family}: {average_precision(scores, alike):.2f} of {alike.sum()} pairs" if alike.any() else family
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn from the generated shapes, and write the weights."""
    parser = argparse.ArgumentParser("python -m bench.training.learn_alike", description=__doc__)
    parser.add_argument("rigs", type=Path, help="folder of skinned GLB files")
    parser.add_argument("--output", type=Path, help="file to write; by default, the file that dfd loads")
    given = parser.parse_args(arguments)
    os.environ["HF_HUB_OFFLINE"] = "1"
    lessons = []
    made = (lesson_of(made_shape(number)) for number in range(SHAPES))
    for number, lesson in enumerate(chain(made, map(lesson_of_rig, sorted(given.rigs.glob("*.glb"))))):
        print(f"lesson {number + 1}", file=sys.stderr)
        trees = trees_of(lesson.mesh, dfd.distill(lesson.mesh, progress=False))
        lessons.append(examples(lesson, trees, number))
    print(report(lessons))
    path = given.output or Path(dfd.segmentation.__file__).with_name("alike_weights.json")
    write_weights(path, *learn(lessons))
    print(path)


def write_weights(path: Path, constant: float, weights: Float64) -> None:
    """Write the weights of the logistic function as JSON."""
    named = {name: round(float(weight), 3) for name, weight in zip(CUES, weights, strict=True)}
    write_text(path, json.dumps({"constant": round(constant, 3), "weights": named}, indent=2) + "\n")


if __name__ == "__main__":
    main()
