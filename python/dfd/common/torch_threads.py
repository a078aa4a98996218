"""torch without the threads that it shares small operations among.

Each operation of torch is split among threads that wait for each other at its end. Where operations take a millisecond
or less that saves little, and where other programs use the same cores it is ruin: a thread that spins while it waits
holds the core that the other one needs, and a fit of seconds takes minutes. Here the work is split instead, into ranges
that wait for nobody; results then do not depend on the number of threads either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import torch

from dfd.common.threads import get_num_threads

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
    starts = iter(range(0, count, size))

    def take() -> None:
        torch.set_num_threads(1)
        with torch.inference_mode():
            for begin in starts:
                work(begin, min(begin + size, count))

    others = min(get_num_threads(), -(-count // size)) - 1
    with one_thread(), ThreadPoolExecutor(max(others, 1), "dfd") as pool:
        taking = [pool.submit(take) for _ in range(others)]
        try:
            take()
        finally:
            for _ in starts:  # nothing is begun any more once one of them has failed or was interrupted
                pass
        for other in taking:
            other.result()
