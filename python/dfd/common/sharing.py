"""Work that is split into ranges, which wait for nobody."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from dfd.common.threads import get_num_threads

__all__ = ["share"]


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
