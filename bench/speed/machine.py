"""What the machine allows: bytes read and written, and float32 products, on as many threads as the kernels get."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

__all__ = ["copying", "moving", "product", "reading"]


def reading(array: NDArray[Any]) -> Callable[[], object]:
    """A call that reads a contiguous array, of a multiple of 8 bytes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that the array is read-only, which is all that is asked of it
        return torch.from_numpy(array.reshape(-1).view(np.int64)).sum


def moving(sources: list[NDArray[Any]], target: NDArray[Any]) -> Callable[[], object]:
    """A call that reads some arrays and writes another."""
    reads, into = [reading(source) for source in sources], torch.from_numpy(target)

    def call() -> None:
        for read in reads:
            read()
        into.fill_(1.0)

    return call


def copying(byte_count: int) -> Callable[[], object]:
    """A call that reads half of so many bytes and writes the other half."""
    source = torch.ones(max(byte_count // 8, 1))
    target = torch.empty_like(source)
    return lambda: target.copy_(source)


def product(rows: int, inner: int, columns: int) -> tuple[Callable[[], object], float]:
    """A call that multiplies float32 matrices into memory that is there already, and how many operations that takes."""
    left, right, into = torch.ones(rows, inner), torch.ones(inner, columns), torch.empty(rows, columns)
    return lambda: torch.mm(left, right, out=into), 2.0 * rows * inner * columns
