"""Choose the device and the threads on which torch computes, and detect out-of-memory errors.

torch splits each operation among its threads, which wait for each other at the end of the operation. Waiting threads
spin and occupy cores that other programs need. For operations of a millisecond or less, this can make the work many
times slower. `parallel_inference` therefore splits the work into independent ranges, and torch computes each range on
one thread. Results then do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dfd.common import threads
from dfd.common.errors import ArgumentError

if TYPE_CHECKING:  # importing torch takes seconds, so each function that needs it imports it
    import torch


def choose_device(function: str, device: str | torch.device | None) -> torch.device:
    """Return `device` as a torch device; None selects a CUDA device if there is one, else the CPU.

    Raises ValueError, which names `function`, if torch cannot use the device.
    """
    import torch

    if device is None:
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        target = torch.device(device)
        torch.empty(0, device=target)
    except (RuntimeError, AssertionError, TypeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise ArgumentError("device", f"must be a usable torch device, got {device!r}: {reason}", function) from None
    return target


def out_of_memory(error: BaseException) -> bool:
    """Return whether `error` reports a failed memory allocation of Python, NumPy or torch."""
    if isinstance(error, MemoryError):
        return True
    # The class of torch's CUDA error is compared by name, so that torch need not be imported.
    named = type(error).__name__ == "OutOfMemoryError" or "can't allocate memory" in str(error)
    return isinstance(error, RuntimeError) and named


@contextmanager
def one_thread() -> Iterator[None]:
    """Make torch compute on the calling thread alone while the `with` block runs."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def parallel_inference(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(begin, end)` for ranges of `size` items that cover [0, `count`), on `get_num_threads()` threads.

    In each call, torch uses one thread and records no gradients. An error that `work` raises is raised again here.
    """
    import torch

    def alone(begin: int, end: int) -> None:
        torch.set_num_threads(1)  # applies to the calling thread only
        with torch.inference_mode():
            work(begin, end)

    with one_thread():
        threads.parallel_ranges(count, size, alone)
