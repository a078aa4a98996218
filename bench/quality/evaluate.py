"""One verdict on the weights that a method gives on a shape."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.quality.measures import difference, dirichlet_energy, draw_handles, part_precision, spread
from bench.quality.shapes import Shape
from dfd.common.linear_algebra import Int64

Method = Callable[[Int64], NDArray[np.floating]]  # handles (H,) to weights (V, H)


@dataclass(frozen=True)
class Draw:
    """Which handles are tried."""

    each: int = 8  # of every part
    seeds: Sequence[int] = (0, 1, 2)


def judge(shape: Shape, method: Method, draw: Draw, *, mirrored: Method | None = None) -> dict[str, float]:
    """All measures that `shape` allows, by name, mean over the draws of handles.

    "precision", "ratio" and "moving" need labels, "symmetry error" the weights that `mirrored` gives to the mirror
    images of vertices and handles.
    """
    verdicts = [_once(shape, method, handles(shape, draw.each, seed), mirrored) for seed in draw.seeds]
    return mean(verdicts)


def handles(shape: Shape, each: int, seed: int) -> Int64:
    """Handles of every part; of a shape without labels twice as many from all of it."""
    if shape.labels is None:
        return draw_handles(np.zeros(len(shape.mesh.vertices), np.int64), 2 * each, seed)
    return draw_handles(shape.labels, each, seed)


def mean(verdicts: Sequence[dict[str, float]]) -> dict[str, float]:
    """Measure by measure."""
    return {measure: float(np.mean([verdict[measure] for verdict in verdicts])) for measure in verdicts[0]}


def _once(shape: Shape, method: Method, chosen: Int64, mirrored: Method | None) -> dict[str, float]:
    weights = method(chosen)
    verdict = {}
    if shape.labels is not None:
        verdict["precision"] = float(np.mean(list(part_precision(weights, shape.labels, chosen).values())))
        verdict["ratio"], verdict["moving"] = spread(weights, shape.labels, chosen)
    verdict["Dirichlet energy"] = dirichlet_energy(weights, shape.mesh.vertices, shape.mesh.faces)
    if mirrored is not None:
        verdict["symmetry error"] = difference(mirrored(chosen), weights)
    return verdict
