"""Choose the device and the threads on which torch computes, and detect its out-of-memory errors.

torch splits each operation among threads, which wait for each other when the operation ends. For operations of a
millisecond or less, this saves little time. Waiting threads spin, so they occupy cores that other programs use: a fit
of seconds then takes minutes. This module splits work into independent ranges instead. Results then do not depend on
the number of threads.
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
    """Return `device` as a torch device; None takes a CUDA device if there is one, else the CPU.

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
    """Return whether `error` reports a failed allocation; Python, NumPy and torch raise different errors."""
    if isinstance(error, MemoryError):
        return True
    # The class of torch's CUDA error is compared by name, because this module does not import torch.
    named = type(error).__name__ == "OutOfMemoryError" or "can't allocate memory" in str(error)
    return isinstance(error, RuntimeError) and named


@contextmanager
def one_thread() -> Iterator[None]:
    """Make torch compute on the calling thread alone while the block runs."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def parallel_inference(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(begin, end)` for ranges of `size` that cover [0, `count`), on the kernels' number of threads.

    torch uses one thread within each call and records no gradients. Errors of `work` are raised here.
    """
    import torch

    def alone(begin: int, end: int) -> None:
        torch.set_num_threads(1)  # applies to the calling thread only
        with torch.inference_mode():
            work(begin, end)

    with one_thread():
        threads.parallel_ranges(count, size, alone)
