"""Learn how likely a person means each part at a place: the weights of `dfd.segmentation.choose`.

Lessons are generated shapes (`bench.training.made_shapes`), so every part is known, and small parts count as much as
large ones: a lesson draws a part, and then a place on this part by area. The weights minimize the cross-entropy of the
probabilities of the candidates and a softmax of their IoU. `python -m bench.training.learn_parts` writes the weights.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

import dfd
import dfd.segmentation
from bench.tables import write_text
from bench.training.made_shapes import made_shape
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.geometry.topology import face_areas
from dfd.segmentation.choose import CUES, candidates
from dfd.segmentation.patches import Patches
from dfd.segmentation.trees import Trees

SHAPES = 77  # number of generated shapes: seven of each family
DRAWS = 24  # number of places on each lesson's shape
SHARPNESS = 40.0  # factor of the IoU in the softmax that the probabilities should match
LEAST_IOU = 0.5  # a place is a lesson only if a candidate has at least this IoU with the part
PENALTY = 1e-4  # factor of the squared norm of the weights


@dataclass(frozen=True, eq=False)
class Place:
    """The candidates at one place, and the part that is meant there."""

    cues: Float64  # (K, C)
    votes: Int64  # (K,) number of trees that have each candidate
    ious: Float64  # (K,) IoU of each candidate with the part that is meant, flat or closed, whichever is larger


def trees_of(mesh: dfd.Mesh, field: dfd.Field) -> Trees:
    """Return the trees of regions of a mesh."""
    patches = Patches(mesh, dfd.symmetry_planes(mesh, field))
    return Trees(patches, patches.means(field.on(mesh).rows))


def places(mesh: dfd.Mesh, trees: Trees, parts: Sequence[tuple[Bool, Bool]], seed: int = 0) -> Iterator[Place]:
    """Yield random places on random parts. A part is two masks of vertices (V,): flat and closed."""
    generator = np.random.default_rng(seed)
    areas = face_areas(mesh.vertices, mesh.faces)
    areas = areas / areas.sum()
    of_face = np.median(np.sort(trees.patches.of_vertex[mesh.faces], axis=1), axis=1).astype(np.int64)
    own = np.bincount(of_face, areas, len(trees.patches.area))
    for _ in range(DRAWS):
        part = [each[mesh.faces].sum(axis=1) >= 2 for each in parts[generator.integers(len(parts))]]
        if not areas[part[0]].sum() > 0:
            continue
        face = generator.choice(np.flatnonzero(part[0]), p=areas[part[0]] / areas[part[0]].sum())
        found = candidates(trees, int(of_face[face]))
        ious = []
        for meant in part:
            common = found.regions @ np.bincount(of_face[meant], areas[meant], len(own))
            ious.append(common / (found.regions @ own + areas[meant].sum() - common))
        yield Place(found.cues, found.votes, np.max(ious, axis=0))


def learn(lessons: Sequence[Place]) -> Float64:
    """Return the weights (C,) of the cues."""
    kept = [place for place in lessons if place.ious.max() >= LEAST_IOU and len(place.ious) > 1]
    most = max(len(place.ious) for place in kept)
    cues, ious = np.zeros((len(kept), most, len(CUES))), np.full((len(kept), most), -np.inf)
    votes = np.ones((len(kept), most))
    for row, place in enumerate(kept):
        some = row, slice(len(place.ious))
        cues[some], votes[some], ious[some] = place.cues, place.votes, place.ious
    known = np.isfinite(ious)
    mean, spread = cues[known].mean(axis=0), cues[known].std(axis=0)
    inputs, counted, mask = torch.tensor((cues - mean) / spread), torch.tensor(np.log(votes)), torch.tensor(known)
    targets = torch.softmax(torch.tensor(SHARPNESS * ious), dim=1)
    weights = torch.zeros(len(CUES), dtype=torch.double, requires_grad=True)
    optimizer = torch.optim.LBFGS([weights], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> Any:
        optimizer.zero_grad()
        scores = (inputs @ weights + counted).masked_fill(~mask, -torch.inf)
        logs = torch.log_softmax(scores, dim=1).masked_fill(~mask, 0.0)
        found = -(targets * logs).sum(dim=1).mean() + PENALTY * weights.square().sum()
        found.backward()
        return found

    optimizer.step(loss)
    return weights.detach().numpy() / spread


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn from the generated shapes, and write the weights."""
    parser = argparse.ArgumentParser("python -m bench.training.learn_parts", description=__doc__)
    parser.add_argument("--output", type=Path, help="file to write; by default, the file that dfd loads")
    given = parser.parse_args(arguments)
    os.environ["HF_HUB_OFFLINE"] = "1"
    lessons: list[Place] = []
    for number in range(SHAPES):
        print(f"shape {number + 1} of {SHAPES}", file=sys.stderr)
        shape = made_shape(number)
        trees = trees_of(shape.mesh, dfd.distill(shape.mesh, progress=False))
        lessons += places(shape.mesh, trees, shape.parts, number)
    weights = {name: round(float(weight), 3) for name, weight in zip(CUES, learn(lessons), strict=True)}
    path = given.output or Path(dfd.segmentation.__file__).with_name("part_weights.json")
    write_text(path, json.dumps({"weights": weights}, ensure_ascii=False, indent=2) + "\n")
    print(path)


if __name__ == "__main__":
    main()
