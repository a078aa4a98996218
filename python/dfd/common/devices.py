"""Where torch computes, on how many threads, and what it says when there is no room left.

Each operation of torch is split among threads that wait for each other at its end. Where operations take a millisecond
or less that saves little, and where other programs use the same cores it is ruin: a thread that spins while it waits
holds the core that the other one needs, and a fit of seconds takes minutes. Here the work is split instead, into ranges
that wait for nobody; results then do not depend on the number of threads either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dfd.common import threads
from dfd.common.errors import ArgumentError

# torch takes seconds to import; where it was not, it has raised nothing.
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
    """Whether `error` says that memory was refused: Python, NumPy and torch each have their own way."""
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

    On each of them torch computes alone and keeps nothing for gradients. What `work` raises is raised here.
    """
    import torch

    def alone(begin: int, end: int) -> None:
        torch.set_num_threads(1)  # it counts for each thread apart
        with torch.inference_mode():
            work(begin, end)

    with one_thread():
        threads.parallel_ranges(count, size, alone)
