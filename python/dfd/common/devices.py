"""The device and the threads on which torch computes, and the detection of its out-of-memory errors.

torch splits each operation among threads, which wait for each other at its end. For operations of a millisecond or
less, this saves little time. If other programs use the same cores, a waiting thread spins and holds a core that
another thread needs: a fit of seconds then takes minutes. This module splits the work into independent ranges
instead. Results then do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dfd.common import threads
from dfd.common.errors import ArgumentError

# Importing torch takes seconds. A torch that is not imported has raised no error.
if TYPE_CHECKING:
    import torch


def choose_device(function: str, device: str | torch.device | None) -> torch.device:
    """Return `device` as torch names it; None takes a CUDA device when there is one.

    Raises ValueError in the name of `function`, if torch cannot use it.
    """
    import torch

    if device is None:
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        target = torch.device(device)
        torch.empty(0, device=target)
    except (RuntimeError, AssertionError, TypeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise ArgumentError("device", f"must be one that torch can use, got {device!r}: {reason}", function) from None
    return target


def out_of_memory(error: BaseException) -> bool:
    """Return whether `error` reports a failed allocation; Python, NumPy and torch raise different errors."""
    if isinstance(error, MemoryError):
        return True
    # torch.cuda's own error is a RuntimeError of this name.
    told = type(error).__name__ == "OutOfMemoryError" or "can't allocate memory" in str(error)
    return isinstance(error, RuntimeError) and told


@contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute on the calling thread alone."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def parallel_inference(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(begin, end)` for ranges of `size` that cover 0 … `count`, on as many threads as the kernels use.

    torch uses one thread within each call and records no gradients. Errors of `work` are raised here.
    """
    import torch

    def alone(begin: int, end: int) -> None:
        torch.set_num_threads(1)  # a setting of the calling thread
        with torch.inference_mode():
            work(begin, end)

    with one_thread():
        threads.parallel_ranges(count, size, alone)
