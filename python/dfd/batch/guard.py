"""Ends the process of a task that takes too long or too much, and leaves word of why.

A task may hang where no Python code can reach it: inside an extension, or in a file that never answers. So the time is
kept by `faulthandler`, whose watch is a thread of its own that needs no interpreter lock; memory by a thread that looks
every tenth of a second. Both write their reason into a file and end the process; whoever started it reads the file.
"""

from __future__ import annotations

import faulthandler
import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from dfd.batch.record import Cause, Limits

__all__ = ["Watched", "guarded", "understood"]

EVERY = 0.1  # seconds between two looks at the memory
TOO_MUCH = "Memory"


class Watched:
    """How much memory a task had at most, bytes, as far as it was looked at."""

    def __init__(self) -> None:
        self.highest = 0


@contextmanager
def guarded(last_words: Path, limits: Limits) -> Iterator[Watched]:
    """End this process when the block exceeds `limits`, with the reason in the file `last_words`."""
    watched, over = Watched(), threading.Event()
    process = psutil.Process()
    with last_words.open("wb", buffering=0) as stream:

        def watch() -> None:
            while True:
                watched.highest = max(watched.highest, process.memory_info().rss)
                if limits.memory is not None and watched.highest > limits.memory:
                    stream.write(f"{TOO_MUCH} {watched.highest}".encode())
                    os._exit(1)
                if over.wait(EVERY):
                    return

        watcher = threading.Thread(target=watch, daemon=True, name="dfd-memory")
        watcher.start()
        if limits.timeout is not None:
            faulthandler.dump_traceback_later(limits.timeout, exit=True, file=stream)
        try:
            yield watched
        finally:
            if limits.timeout is not None:
                faulthandler.cancel_dump_traceback_later()
            over.set()
            watcher.join()


def understood(words: str, limits: Limits) -> tuple[Cause, str] | None:
    """The cause of a death and a sentence for people, from the last words of its process; None where there are none."""
    if words.startswith(TOO_MUCH):
        had = int(words.split()[1])
        return "memory", f"needed more than the {(limits.memory or 0) / 2**30:.2g} GiB of a task, {had / 2**30:.2g} GiB"
    if words.startswith("Timeout"):
        frames = re.findall(
            r'File "[^"]*?((?:dfd/)?[^"/]+/[^"/]+)", line (\d+) in (\S+)', words.rpartition("Thread")[2]
        )
        where = next((each for each in frames if each[0].startswith("dfd/")), frames[0] if frames else None)
        at = f", in {where[2]} ({where[0]}, line {where[1]})" if where else ""
        return "timeout", f"took longer than {limits.timeout:g} s{at}"
    return None
