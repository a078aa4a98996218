"""One case by all methods, measured."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.paper.handles import Case
from bench.quality.baselines import PeerError
from dfd.geometry.metrics import SurfaceMetrics, surface_metrics

__all__ = ["COLUMNS", "Row", "compare"]

COLUMNS = ("handle off %", "area %", "angle °", "edge %", "volume %", "flipped faces")


@dataclass(frozen=True)
class Row:
    """What one method made of one case."""

    shape: str
    method: str
    vertices: NDArray[np.float64] | None = None  # (V, 3) where they went, mesh units; None where `note` says why not
    missing: float | None = None  # the largest distance that a handle is from its target, of the diagonal of the box
    metrics: SurfaceMetrics | None = None
    note: str = ""

    @property
    def values(self) -> list[float | None]:
        """What the columns of the table hold."""
        if self.missing is None or self.metrics is None:
            return [None] * len(COLUMNS)
        volume = None if self.metrics.volume is None else 100 * self.metrics.volume
        relative = [100 * self.missing, 100 * self.metrics.area, self.metrics.angle, 100 * self.metrics.edge_length]
        return [*relative, volume, self.metrics.flipped_faces]


def compare(name: str, case: Case, methods: Mapping[str, Callable[[], NDArray[np.float64]]]) -> list[Row]:
    """A row a method, which returns the moved vertices (V, 3); one that fails has a note and stops no other."""
    return [_row(name, method, case, deform) for method, deform in methods.items()]


def _row(name: str, method: str, case: Case, deform: Callable[[], NDArray[np.float64]]) -> Row:
    try:
        moved = deform()
        metrics = surface_metrics(case.mesh, moved)
    except (PeerError, ValueError, OSError, MemoryError) as error:
        return Row(name, method, note=" ".join(str(error).split()) or type(error).__name__)
    missing = np.linalg.norm(moved[case.handles] - case.targets, axis=1).max() / case.mesh.diagonal
    return Row(name, method, moved, float(missing), metrics)
