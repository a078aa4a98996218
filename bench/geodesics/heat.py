"""The heat method on a full mesh, in a module that a process of its own can import."""

from __future__ import annotations

import time
import timeit
from collections.abc import Callable

import potpourri3d

from dfd.common.linear_algebra import Float64, Int32


def heat_seconds(vertices: Float64, faces: Int32, handle: int) -> tuple[float, float]:
    """The seconds that factoring takes, and the shortest of a solve."""
    started = time.perf_counter()
    solver = potpourri3d.MeshHeatMethodDistanceSolver(vertices, faces)
    factor = time.perf_counter() - started
    return factor, shortest_seconds(lambda: solver.compute_distance(handle), 2)


def shortest_seconds(call: Callable[[], object], repeats: int) -> float:
    """Return the shortest of `repeats` times."""
    return min(timeit.repeat(call, number=1, repeat=repeats))
