"""One case by all methods, measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.paper.handles import Case
from bench.paper.methods import arap, biharmonic, ours
from bench.quality.baselines import PeerError
from dfd.geometry.metrics import SurfaceMetrics, surface_metrics

__all__ = ["METHODS", "OURS_FIXED", "Row", "compare"]

OURS_FIXED = "ours, fixed points"
METHODS = ("ours", "ARAP", "biharmonic")  # in the paper's order, without what is ours alone


@dataclass(frozen=True)
class Row:
    """What one method made of one case."""

    shape: str
    method: str
    vertices: NDArray[np.float64] | None = None  # (V, 3) where they went, mesh units; None where `note` says why not
    missing: float | None = None  # the largest distance that a handle is from its target, of the diagonal of the box
    metrics: SurfaceMetrics | None = None
    note: str = ""


def compare(name: str, case: Case, field: Callable[[], dfd.Field], ball: float) -> list[Row]:
    """Our rows, and those of the other methods; one that fails has a note and stops no other.

    Ours stands there as in the paper, by the handles alone, and once more with the fixed points where there are any.
    """
    rows = [_row(name, "ours", case, lambda: ours(case, field(), fixed=False))]
    if len(case.fixed):
        rows.append(_row(name, OURS_FIXED, case, lambda: ours(case, field(), fixed=True)))
    rows.append(_row(name, "ARAP", case, partial(arap, case, ball)))
    rows.append(_row(name, "biharmonic", case, partial(biharmonic, case, ball)))
    return rows


def _row(name: str, method: str, case: Case, deform: Callable[[], NDArray[np.float64]]) -> Row:
    try:
        moved = deform()
        metrics = surface_metrics(case.mesh, moved)
    except (PeerError, ValueError, OSError, MemoryError) as error:
        return Row(name, method, note=" ".join(str(error).split()) or type(error).__name__)
    missing = np.linalg.norm(moved[case.handles] - case.targets, axis=1).max() / case.mesh.diagonal
    return Row(name, method, moved, float(missing), metrics)
