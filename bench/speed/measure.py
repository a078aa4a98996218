"""Seconds of a call: warmed up, repeated, with the best and the middle of them; and what the machine allows.

That is bytes read and written, and float32 products, on as many threads as the kernels get.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

import dfd


@dataclass(frozen=True)
class Timing:
    """Seconds: the best, the median, and the distance between the quartiles."""

    best: float
    median: float
    spread: float


def together(
    calls: dict[str, Callable[[], object]], *, seconds: float = 1.0, least: int = 5, most: int = 400
) -> dict[str, Timing]:
    """Time several calls in turn, so that a machine that slows down for a while slows down all of them."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    # The thread's own processor time is disturbed least by other programs.
    now = time.thread_time if dfd.get_num_threads() == 1 else time.perf_counter
    end = time.perf_counter() + seconds * len(calls)
    rounds = 0
    while rounds < least or (rounds < most and time.perf_counter() < end):
        rounds += 1
        for name, call in calls.items():
            start = now()
            call()
            taken[name].append(now() - start)
    quartiles = {name: np.quantile(times, [0.25, 0.5, 0.75]) for name, times in taken.items()}
    return {name: Timing(min(taken[name]), mid, high - low) for name, (low, mid, high) in quartiles.items()}


# --- ceilings


def reading(array: NDArray[Any]) -> Callable[[], object]:
    """A call that reads a contiguous array, of a multiple of 8 bytes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that the array is read-only, which is all that is asked of it
        return torch.from_numpy(array.reshape(-1).view(np.int64)).sum


def copying(byte_count: int) -> Callable[[], object]:
    """A call that reads half of so many bytes and writes the other half."""
    source = torch.ones(max(byte_count // 8, 1))
    target = torch.empty_like(source)
    return lambda: target.copy_(source)


def product(rows: int, inner: int, columns: int) -> Callable[[], object]:
    """A call that multiplies float32 matrices into memory that is there already."""
    left, right, into = torch.ones(rows, inner), torch.ones(inner, columns), torch.empty(rows, columns)
    return lambda: torch.mm(left, right, out=into)
