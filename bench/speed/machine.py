"""What the machine allows: bytes read, bytes copied and float32 products, on as many threads as the kernels get."""

from __future__ import annotations

from collections.abc import Callable

import torch

__all__ = ["copying", "product", "reading"]


def reading(byte_count: int) -> Callable[[], object]:
    """A call that reads so many bytes."""
    memory = torch.ones(max(byte_count // 8, 1), dtype=torch.int64)
    return memory.sum


def copying(byte_count: int) -> Callable[[], object]:
    """A call that reads half of so many bytes and writes the other half."""
    source = torch.ones(max(byte_count // 8, 1))
    target = torch.empty_like(source)
    return lambda: target.copy_(source)


def product(rows: int, inner: int, columns: int) -> tuple[Callable[[], object], float]:
    """A call that multiplies float32 matrices into memory that is there already, and how many operations that takes."""
    left, right, into = torch.ones(rows, inner), torch.ones(inner, columns), torch.empty(rows, columns)
    return lambda: torch.mm(left, right, out=into), 2.0 * rows * inner * columns
