"""Time calls. Some calls measure the limits of the machine: reading and copying memory, and multiplying matrices."""

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
    """Seconds of a call: the best time, the median, and the interquartile range (spread)."""

    best: float
    median: float
    spread: float


def together(
    calls: dict[str, Callable[[], object]], *, seconds: float = 1.0, least: int = 5, most: int = 400
) -> dict[str, Timing]:
    """Time calls in turn, so that other programs slow down all calls equally: each call `least` to `most` times."""
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    # The processor time of a single thread depends less on other programs than the elapsed time does.
    now = time.thread_time if dfd.get_num_threads() == 1 else time.perf_counter
    end = time.perf_counter() + seconds * len(calls)
    for number in range(most):
        if number >= least and time.perf_counter() > end:
            break
        for name, call in calls.items():
            start = now()
            call()
            taken[name].append(now() - start)
    quartiles = {name: np.quantile(times, [0.25, 0.5, 0.75]) for name, times in taken.items()}
    return {name: Timing(min(taken[name]), mid, high - low) for name, (low, mid, high) in quartiles.items()}


def reading(array: NDArray[Any]) -> Callable[[], object]:
    """Return a call that reads a contiguous array, whose number of bytes must be a multiple of 8."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # torch warns of read-only arrays
        return torch.from_numpy(array.reshape(-1).view(np.int64)).sum


def copying(byte_count: int) -> Callable[[], object]:
    """Return a call that copies memory: it reads `byte_count` / 2 bytes, and writes the same number."""
    source = torch.ones(max(byte_count // 8, 1))
    target = torch.empty_like(source)
    return lambda: target.copy_(source)


def product(rows: int, inner: int, columns: int) -> Callable[[], object]:
    """Return a call that multiplies float32 matrices and writes the product into existing memory."""
    left, right, into = torch.ones(rows, inner), torch.ones(inner, columns), torch.empty(rows, columns)
    return lambda: torch.mm(left, right, out=into)
