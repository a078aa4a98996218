"""A distillation in its own process, which can be stopped at any time, and whose crash affects nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from dfd.app.options import SessionOptions, Source, read_shape
from dfd.common.progress import Stages

INTERVAL = 0.1  # least seconds between two messages about one stage


class DistillProcess:
    """The parent's side of the process. The child reads the shape from `source`, and saves its field at `path`."""

    def __init__(self, source: Source, options: SessionOptions, path: Path) -> None:
        context = get_context("spawn")
        self._messages, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_distill, args=(source, options, path, theirs), daemon=True)
        self._process.start()
        theirs.close()  # so that the pipe closes when the process ends

    def run(self, tell: Callable[[str, int, int | None], object]) -> None:
        """Wait for the field; `tell` is called with a stage, items done and their total.

        Raises ValueError if the distillation failed or was stopped.
        """
        message: Any = None
        with self._messages, suppress(EOFError, OSError):
            while isinstance(message := self._messages.recv(), tuple):
                tell(*message)
        self._process.join()
        if isinstance(message, str):
            raise ValueError(message)
        if message is not True:
            code = self._process.exitcode or 0
            lost = ", perhaps for lack of memory" if code < 0 else f" (exit code {code})"
            raise ValueError(f"The distillation ended before it was done{lost}")

    def stop(self) -> None:
        """End the process at once."""
        self._process.kill()


class SentStages(Stages):
    """Stages that send their progress through a pipe."""

    def __init__(self, pipe: Connection) -> None:
        super().__init__(show=False)
        self._pipe = pipe

    @contextmanager
    def stage(self, name: str, total: int | None = None) -> Iterator[Any]:
        """Time the block under `name` and send its progress, at most once per `INTERVAL`."""
        done, sent = 0, time.monotonic()
        self._pipe.send((name, 0, total))

        def advance(count: int = 1) -> None:
            nonlocal done, sent
            done += count
            if time.monotonic() - sent >= INTERVAL or done == total:
                sent = time.monotonic()
                self._pipe.send((name, done, total))

        with super().stage(name, total):
            yield advance


def _distill(source: Source, options: SessionOptions, path: Path, pipe: Connection) -> None:
    """Save the field of a shape at `path`; send tuples of progress to `pipe`, then True or an error message."""
    from dfd.distillation.distill import distill

    stages = SentStages(pipe)
    try:
        with stages.stage("read"):
            mesh, _ = read_shape(source)
        distill(mesh, **options.distill_arguments(), progress=stages).save(path)
        pipe.send(True)
    except (OSError, ValueError, MemoryError) as error:
        pipe.send(f"Memory ran out: {error}" if isinstance(error, MemoryError) else str(error))
