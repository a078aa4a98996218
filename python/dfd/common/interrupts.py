"""Ctrl-C that is never lost: importing libraries, and the garbage they leave, may swallow a KeyboardInterrupt."""

from __future__ import annotations

import gc
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def heed_interrupts(*, wait: bool = False) -> Iterator[None]:
    """End this block with a KeyboardInterrupt, however else it ends, when SIGINT arrives within it.

    An exception that Python raises amid an extension's own import or in a finalizer may be turned into another one or
    be dropped; so the signal itself is noted here. Where a program ignores SIGINT or handles it in its own way, and in
    threads other than the main one, which get no signals, nothing changes.

    With `wait` the block comes to its end first, so that no library is left half imported; a second SIGINT stops it at
    once.
    """
    in_main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT) if in_main else None
    if before is not signal.default_int_handler and not isinstance(before, _Note):
        yield
        return
    note = _Note(wait)
    try:
        signal.signal(signal.SIGINT, note)
        yield
    except BaseException as error:
        if note.count and not isinstance(error, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.signal(signal.SIGINT, before)
    if note.count:
        raise KeyboardInterrupt


class _Note:
    """A handler of SIGINT that counts."""

    def __init__(self, wait: bool) -> None:
        self.count = 0
        self._wait = wait

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
        if self.count > 1 or not self._wait:
            signal.default_int_handler(number, frame)


@contextmanager
def importing() -> Iterator[None]:
    """Importing makes a million objects that stay: searching them for garbage, over and over, takes a tenth of it.

    The one search that comes at the end belongs to it, for an interruption that meets a finalizer there would be lost.
    """
    with heed_interrupts():
        enabled = gc.isenabled()
        gc.disable()
        try:
            yield
        finally:
            if enabled:
                gc.enable()
                gc.collect(0)
