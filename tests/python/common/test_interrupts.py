"""Ctrl-C within a block ends it, whatever the block makes of it."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator

import pytest

from dfd.common.interrupts import heed_interrupts


@pytest.fixture(autouse=True)
def _as_a_program_starts() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def test_a_block_without_interruptions_is_left_alone() -> None:
    with heed_interrupts(), heed_interrupts(wait=True):
        pass
    with pytest.raises(KeyError), heed_interrupts():
        raise KeyError
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("wait", [False, True])
def test_an_interruption_that_is_swallowed_comes_at_the_end(wait: bool) -> None:
    done = []

    def swallow() -> None:
        with heed_interrupts(wait=wait):
            with contextlib.suppress(BaseException):
                interrupt()
                done.append("after")
            done.append("end")

    with pytest.raises(KeyboardInterrupt):
        swallow()
    assert done == (["after", "end"] if wait else ["end"])
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interruption_that_is_turned_into_another_error_is_one() -> None:
    @heed_interrupts()
    def turn() -> None:
        try:
            interrupt()
        except KeyboardInterrupt:
            raise ImportError("numpy") from None

    with pytest.raises(KeyboardInterrupt) as caught:
        turn()
    assert isinstance(caught.value.__cause__, ImportError)


def test_a_second_interruption_does_not_wait() -> None:
    done = []

    @heed_interrupts(wait=True)
    def press_twice() -> None:
        interrupt()
        done.append("first")
        interrupt()
        done.append("second")

    with pytest.raises(KeyboardInterrupt):
        press_twice()
    assert done == ["first"]


def test_blocks_may_lie_in_each_other() -> None:
    done = []

    @heed_interrupts(wait=True)
    def inner() -> None:
        interrupt()
        done.append("inner")

    @heed_interrupts()
    def outer() -> None:
        inner()
        done.append("outer")

    with pytest.raises(KeyboardInterrupt):
        outer()
    assert done == ["inner"]


@pytest.mark.parametrize("handler", [signal.SIG_IGN, lambda *_: None])
def test_a_program_that_has_its_own_way_keeps_it(handler: object) -> None:
    signal.signal(signal.SIGINT, handler)  # type: ignore[arg-type]
    with heed_interrupts(), heed_interrupts(wait=True):
        interrupt()
        assert signal.getsignal(signal.SIGINT) is handler


def test_other_threads_get_no_signals() -> None:
    done = []

    def work() -> None:
        with heed_interrupts(), heed_interrupts(wait=True):
            done.append(signal.getsignal(signal.SIGINT) is signal.default_int_handler)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join(60)
    assert done == [True]
