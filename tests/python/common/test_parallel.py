"""Work beside other work: at once where there are threads for it, later where there are none, never lost."""

from __future__ import annotations

import threading

import pytest

import dfd
from dfd.common.threads import beside, parallel_ranges


def test_what_is_beside_is_done_while_the_block_runs() -> None:
    dfd.set_num_threads(2)
    begun, go_on = threading.Event(), threading.Event()

    def work() -> str:
        begun.set()
        assert go_on.wait(20)
        return "done"

    with beside(work) as result:
        assert begun.wait(20)  # although nobody has asked for it
        go_on.set()
    assert result() == "done"


@pytest.mark.parametrize("threads", [1, 2])
def test_what_it_raises_is_raised_where_it_is_asked_for(threads: int) -> None:
    dfd.set_num_threads(threads)

    def work() -> None:
        raise ValueError("no ground")

    with beside(work) as result:
        pass
    with pytest.raises(ValueError, match="^no ground$"):
        result()


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_ranges_cover_everything_once(threads: int) -> None:
    dfd.set_num_threads(threads)
    seen: list[int] = []
    parallel_ranges(23, 5, lambda begin, end: seen.extend(range(begin, end)))
    assert sorted(seen) == list(range(23))
