"""Set the number of threads of the C++ kernels, and run Python functions on the same number of threads.

`dfd` imports this module before its kernels, so that the kernels and torch use the same OpenMP runtime. The runtime's
threads do not survive a fork, so the kernels and torch compute on one thread in a forked process. Processes that the
method "spawn" starts use all threads.
"""

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from dfd.common import check, openmp

T = TypeVar("T")


def set_num_threads(count: int) -> None:
    """Set the number of threads of all later calls; results do not depend on this number.

    Raises ValueError if `count` is not a whole number from 1 to 1024. Raises RuntimeError if `count` is above 1 in a
    forked process.
    """
    global _threads
    wanted = check.whole("set_num_threads", "count", count, minimum=1, maximum=1024)
    if _forked and wanted > 1:
        raise RuntimeError(
            "set_num_threads: a forked process computes on one thread, since OpenMP does not survive a fork; "
            'start it with the method "spawn" instead'
        )
    _threads = wanted


def get_num_threads() -> int:
    """Return the number of threads that calls use."""
    return _threads


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Make NumPy and SciPy compute matrix products on the calling thread alone while the `with` block runs.

    Use this function if several threads of dfd compute small matrix products at the same time. Otherwise, the BLAS
    library would start further threads, which spin while they wait, and the work takes at least twice as long.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield


def _default_threads() -> int:
    """Return OMP_NUM_THREADS if it is set, else the number of physical cores that this process may use."""
    try:
        wanted = int(os.environ.get("OMP_NUM_THREADS", "").split(",")[0])
    except ValueError:
        wanted = 0
    if wanted >= 1:
        return min(wanted, 1024)
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 1))
    return max(1, min(_physical_cores(allowed), _quota(len(allowed))))


def _physical_cores(allowed: set[int]) -> int:
    """Return the number of physical cores to which the logical processors `allowed` belong."""
    cores = set()
    for processor in allowed:
        siblings = Path(f"/sys/devices/system/cpu/cpu{processor}/topology/thread_siblings_list")
        try:
            cores.add(siblings.read_text())
        except OSError:
            cores.add(str(processor))
    return len(cores)


def _quota(most: int) -> int:
    """Return the number of whole processors that the container's control group (cgroup) grants, at most `most`."""
    group = Path("/sys/fs/cgroup")
    for names in (("cpu.max",), ("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")):  # cgroup 2, then 1
        with suppress(OSError, ValueError, ZeroDivisionError):  # no such file, or "max" for no limit
            granted, period = map(int, " ".join((group / name).read_text() for name in names).split())
            return min(most, max(1, granted // period)) if granted > 0 else most
    return most


def _after_fork() -> None:
    global _forked, _threads
    _forked = True
    _threads = 1
    # torch's parallel loops would wait for threads that the fork has ended.
    openmp.use_one_thread()
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


openmp.load_runtime()
_forked = False
_threads = _default_threads()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def parallel_ranges(count: int, size: int, work: Callable[[int, int], None]) -> None:
    """Call `work(begin, end)` for ranges of `size` items that cover [0, `count`), on `get_num_threads()` threads.

    An error that `work` raises is raised again here.
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
            for _ in starts:  # empties `starts` after an error, so that no thread begins another range
                pass
        for other in taking:
            other.result()


@contextmanager
def beside(work: Callable[[], T]) -> Iterator[Callable[[], T]]:
    """Run `work` on another thread while the `with` block runs; yield a function that waits for `work`.

    The function returns the result of `work`, or raises its error. The `with` block does not end before `work`. If
    `get_num_threads()` is 1, the function runs `work` itself.
    """
    if get_num_threads() == 1:
        yield work
        return
    with ThreadPoolExecutor(1, "dfd") as pool:
        yield pool.submit(work).result
