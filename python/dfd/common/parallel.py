"""Work that is split into ranges, which wait for nobody, and work that is done beside other work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

from dfd.common.threads import get_num_threads

__all__ = ["beside", "share"]

T = TypeVar("T")


def share(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(begin, end)` for ranges of `size` that cover 0 … `count`, on as many threads as the kernels use.

    What `work` raises is raised here.
    """
    starts = iter(range(0, count, size))

    def take() -> None:
        for begin in starts:
            work(begin, min(begin + size, count))

    others = min(get_num_threads(), -(-count // size)) - 1
    with ThreadPoolExecutor(max(others, 1), "dfd") as pool:
        taking = [pool.submit(take) for _ in range(others)]
        try:
            take()
        finally:
            for _ in starts:  # nothing is begun any more once one of them has failed or was interrupted
                pass
        for other in taking:
            other.result()


@contextmanager
def beside(work: Callable[[], T]) -> Iterator[Callable[[], T]]:
    """Let `work` be done on a thread of its own while the block runs; what is yielded gives its result, or raises.

    The block ends when both are done. Where the kernels use one thread, `work` is done when its result is asked for.
    """
    if get_num_threads() == 1:
        yield work
        return
    with ThreadPoolExecutor(1, "dfd") as pool:
        yield pool.submit(work).result
