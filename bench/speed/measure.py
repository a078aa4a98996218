"""Seconds of a call: warmed up, repeated, with the best and the middle of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import dfd

__all__ = ["Timing", "clock", "measure", "together"]


@dataclass(frozen=True)
class Timing:
    """Seconds: the best, the median, and the distance between the quartiles."""

    best: float
    median: float
    spread: float
    repeats: int


def clock() -> Callable[[], float]:
    """The thread's own processor time if the kernels run on one thread, which other programs disturb least."""
    return time.thread_time if dfd.get_num_threads() == 1 else time.perf_counter


def measure(call: Callable[[], object], *, seconds: float = 1.0, least: int = 5, most: int = 400) -> Timing:
    """Time `call` again and again for about `seconds`, after one call that does not count."""
    return together({"": call}, seconds=seconds, least=least, most=most)[""]


def together(
    calls: dict[str, Callable[[], object]], *, seconds: float = 1.0, least: int = 5, most: int = 400
) -> dict[str, Timing]:
    """Time several calls in turn, so that a machine that slows down for a while slows down all of them."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    now = clock()
    end = time.perf_counter() + seconds * len(calls)
    rounds = 0
    while rounds < least or (rounds < most and time.perf_counter() < end):
        rounds += 1
        for name, call in calls.items():
            start = now()
            call()
            taken[name].append(now() - start)
    return {name: _timing(times) for name, times in taken.items()}


def _timing(times: list[float]) -> Timing:
    low, middle, high = (float(value) for value in np.quantile(times, [0.25, 0.5, 0.75]))
    return Timing(min(times), middle, high - low, len(times))
