"""Distill a field in a process of its own, which can be stopped, and receive its progress."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from dfd.common.progress import Stages
from dfd.mesh.mesh import Mesh

LESS_URGENT = 5  # the process gets less processor time than one that answers a user, on systems with `os.nice`
TICK = 0.5  # seconds after which progress is reported again, even if no item was finished


def distill_apart(
    read: Callable[[], Mesh],
    settings: dict[str, Any],
    path: Path,
    tell: Callable[[str, int, int | None], object],
    started: Callable[[BaseProcess], object],
) -> None:
    """Distill a shape in a new process, and save its field at `path`. If that process crashes, this one continues.

    `read` reads the mesh in that process. `settings` are the arguments of `dfd.distill`. `tell` is called with the name
    of a stage, the number of finished items and the number of all items. `started` is called with the process, so that
    the caller can kill it.

    Raises ValueError if the distillation failed or was stopped.
    """
    context = get_context("spawn")
    messages, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_distill, args=(read, settings, path, theirs), daemon=True)
    process.start()
    theirs.close()  # Close our copy of the sending end. Then `recv` raises EOFError when the process ends.
    started(process)
    message: Any = None
    with messages, suppress(EOFError, OSError):
        latest: tuple[Any, ...] = ()
        while True:
            while latest and not messages.poll(TICK):
                tell(*latest)
            if not isinstance(message := messages.recv(), tuple):
                break
            latest = message
            tell(*latest)
    process.join()
    if isinstance(message, str):
        raise ValueError(message)
    if message is not True:
        code = process.exitcode or 0
        lost = ", perhaps for lack of memory" if code < 0 else f" (exit code {code})"
        raise ValueError(f"The distillation ended before it was done{lost}")


class SentStages(Stages):
    """Stages that send their progress to another process through a pipe."""

    def __init__(self, pipe: Connection) -> None:
        super().__init__(show=False)
        self._pipe = pipe

    @contextmanager
    def stage(self, name: str, total: int | None = None) -> Iterator[Any]:
        """Measure the time of the `with` block as the stage `name`, and send its progress."""
        done = 0
        self._pipe.send((name, 0, total))

        def advance(count: int = 1) -> None:
            nonlocal done
            done += count
            self._pipe.send((name, done, total))

        with super().stage(name, total):
            yield advance


def _distill(read: Callable[[], Mesh], settings: dict[str, Any], path: Path, pipe: Connection) -> None:
    """Distill a field and save it at `path`. Send tuples of progress to `pipe`, then True or an error message."""
    from dfd.distillation.distill import distill

    stages = SentStages(pipe)
    if hasattr(os, "nice"):
        os.nice(LESS_URGENT)
    try:
        with stages.stage("read"):
            mesh = read()
        distill(mesh, **settings, progress=stages).save(path)
        pipe.send(True)
    except (OSError, ValueError, MemoryError) as error:
        pipe.send(f"Memory ran out: {error}" if isinstance(error, MemoryError) else str(error))
