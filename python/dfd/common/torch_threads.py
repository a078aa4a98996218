"""torch without the threads that it shares small operations among.

Each operation of torch is split among threads that wait for each other at its end. Where operations take a millisecond
or less that saves little, and where other programs use the same cores it is ruin: a thread that spins while it waits
holds the core that the other one needs, and a fit of seconds takes minutes. Here the work is split instead, into ranges
that wait for nobody; results then do not depend on the number of threads either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch

from dfd.common import parallel

__all__ = ["one_thread", "share"]


@contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute on the calling thread alone."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def share(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(begin, end)` for ranges of `size` that cover 0 … `count`, on as many threads as the kernels use.

    On each of them torch computes alone and keeps nothing for gradients. What `work` raises is raised here.
    """

    def alone(begin: int, end: int) -> None:
        torch.set_num_threads(1)  # it counts for each thread apart
        with torch.inference_mode():
            work(begin, end)

    with one_thread():
        parallel.share(count, size, alone)
