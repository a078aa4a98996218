"""A distillation in a process of its own, so that it can be stopped at any time and a crash affects nothing else.

    python -m dfd.app.session.distill_process     reads a pickled job; writes progress as JSON lines

It exits when its input is closed, and so together with its parent process.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from dfd.app.options import SessionOptions, Source, read_shape
from dfd.common.progress import Stages

INTERVAL = 0.1  # seconds between two lines about one stage


class DistillProcess:
    """The parent's side of the process, which reads the shape itself and saves its field at `path`."""

    def __init__(self, source: Source, options: SessionOptions, path: Path) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "dfd.app.session.distill_process"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._process.stdin is not None
        pickle.dump((source, options, path), self._process.stdin)
        self._process.stdin.flush()

    def run(self, tell: Callable[[str, int, int | None], object]) -> None:
        """Wait for the field; `tell` is called with a stage, items done and their total.

        Raises ValueError if the distillation failed or was stopped.
        """
        assert self._process.stdout is not None
        last: dict[str, Any] = {}
        with self._process:
            for line in self._process.stdout:
                last = json.loads(line)
                if "stage" in last:
                    tell(last["stage"], last["done"], last["total"])
        if "saved" not in last:
            code = self._process.returncode
            lost = ", perhaps for lack of memory" if code < 0 else f" (exit code {code})"
            raise ValueError(last.get("error", f"The distillation ended before it was done{lost}"))

    def stop(self) -> None:
        """End the process at once."""
        self._process.kill()


class JsonStages(Stages):
    """Stages that write their progress as JSON lines."""

    def __init__(self, stream: IO[str]) -> None:
        super().__init__(show=False)
        self._stream = stream

    def write(self, **message: Any) -> None:
        """Write one line."""
        self._stream.write(json.dumps(message) + "\n")
        self._stream.flush()

    @contextmanager
    def stage(self, name: str, total: int | None = None) -> Iterator[Any]:
        """Time the block under `name` and write its progress, at most once per `INTERVAL`."""
        done, written = 0, time.monotonic()
        self.write(stage=name, done=0, total=total)

        def advance(count: int = 1) -> None:
            nonlocal done, written
            done += count
            if time.monotonic() - written >= INTERVAL or done == total:
                written = time.monotonic()
                self.write(stage=name, done=done, total=total)

        with super().stage(name, total):
            yield advance


def main() -> None:
    """Run the job read from the input."""
    # Redirect stdout to stderr: output of libraries must not mix with the JSON lines.
    stages = JsonStages(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)
    source, options, path = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        from dfd.distillation.distill import distill

        with stages.stage("read"):
            mesh, _ = read_shape(source)
        distill(mesh, **options.distill_arguments(), progress=stages).save(path)
        stages.write(saved=True)
    except (OSError, ValueError, MemoryError) as error:
        reason = str(error)
        stages.write(error=f"Memory ran out: {reason}" if isinstance(error, MemoryError) else reason)


def _end_with_input() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


if __name__ == "__main__":
    main()
