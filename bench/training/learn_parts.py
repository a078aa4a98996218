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
from dfd.common.linear_algebra import Bool, Float64
from dfd.geometry.topology import face_areas
from dfd.segmentation.choose import CUES, candidates
from dfd.segmentation.patches import Patches
from dfd.segmentation.tree import Tree

SHAPES = 100  # number of generated shapes
DRAWS = 24  # number of places on each lesson's shape
SHARPNESS = 20.0  # factor of the IoU in the softmax that the probabilities should match
LEAST_IOU = 0.5  # a place is a lesson only if a candidate has at least this IoU with the part
LARGE, LARGE_WEIGHT = 0.05, 2.0  # the shapes have many small parts, so places on parts above this share count twice
PENALTY = 1e-4  # factor of the squared norm of the weights


@dataclass(frozen=True, eq=False)
class Place:
    """The candidates at one place, and the part that is meant there."""

    cues: Float64  # (K, C)
    ious: Float64  # (K,) IoU of each candidate with the part that is meant, flat or closed, whichever is larger
    overlaps: Float64  # (K, K) IoU of each pair of candidates
    share: float  # area of the part, as a share of the surface


def tree_of(mesh: dfd.Mesh, field: dfd.Field) -> Tree:
    """Return the tree of parts of a mesh."""
    patches = Patches(mesh, dfd.symmetry_planes(field, mesh))
    return Tree(patches, patches.means(field.on(mesh).rows))


def places(mesh: dfd.Mesh, tree: Tree, parts: Sequence[tuple[Bool, Bool]], seed: int = 0) -> Iterator[Place]:
    """Yield random places on random parts. A part is two masks of vertices (V,): flat and closed."""
    generator = np.random.default_rng(seed)
    areas = face_areas(mesh.vertices, mesh.faces)
    areas = areas / areas.sum()
    of_face = np.median(np.sort(tree.patches.of_vertex[mesh.faces], axis=1), axis=1).astype(np.int64)
    own = np.bincount(of_face, areas, len(tree.patches.area))
    for _ in range(DRAWS):
        part = [each[mesh.faces].sum(axis=1) >= 2 for each in parts[generator.integers(len(parts))]]
        if not areas[part[0]].sum() > 0:
            continue
        face = generator.choice(np.flatnonzero(part[0]), p=areas[part[0]] / areas[part[0]].sum())
        found = candidates(tree, int(of_face[face]))
        ious = []
        for meant in part:
            common = found.regions @ np.bincount(of_face[meant], areas[meant], len(own))
            ious.append(common / (found.regions @ own + areas[meant].sum() - common))
        yield Place(found.cues, np.max(ious, axis=0), found.overlaps(tree.patches.area), float(areas[part[0]].sum()))


def learn(lessons: Sequence[Place]) -> Float64:
    """Return the weights (C,) of the cues."""
    kept = [place for place in lessons if place.ious.max() >= LEAST_IOU and len(place.ious) > 1]
    most = max(len(place.ious) for place in kept)
    cues, ious = np.zeros((len(kept), most, len(CUES))), np.full((len(kept), most), -np.inf)
    for row, place in enumerate(kept):
        cues[row, : len(place.ious)], ious[row, : len(place.ious)] = place.cues, place.ious
    known = np.isfinite(ious)
    mean, spread = cues[known].mean(axis=0), cues[known].std(axis=0)
    inputs, mask = torch.tensor((cues - mean) / spread), torch.tensor(known)
    targets = torch.softmax(torch.tensor(SHARPNESS * ious), dim=1)
    count = torch.tensor([1.0 if place.share < LARGE else LARGE_WEIGHT for place in kept], dtype=torch.double)
    weights = torch.zeros(len(CUES), dtype=torch.double, requires_grad=True)
    optimizer = torch.optim.LBFGS([weights], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> Any:
        optimizer.zero_grad()
        logs = torch.log_softmax((inputs @ weights).masked_fill(~mask, -torch.inf), dim=1).masked_fill(~mask, 0.0)
        found = -(count * (targets * logs).sum(dim=1)).sum() / count.sum() + PENALTY * weights.square().sum()
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
        tree = tree_of(shape.mesh, dfd.distill(shape.mesh, progress=False))
        lessons += places(shape.mesh, tree, shape.parts, number)
    weights = {name: round(float(weight), 3) for name, weight in zip(CUES, learn(lessons), strict=True)}
    path = given.output or Path(dfd.segmentation.__file__).with_name("part_weights.json")
    write_text(path, json.dumps({"weights": weights}, ensure_ascii=False, indent=2) + "\n")
    print(path)


if __name__ == "__main__":
    main()
