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
    """The parent's side of the process, which reads the shape itself; the field is put into `folder`."""

    def __init__(self, source: Source, options: SessionOptions, folder: Path, lock: Path | None) -> None:
        self._cancelled = False
        self._process = subprocess.Popen(
            [sys.executable, "-m", "dfd.app.session.distill_process"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._process.stdin is not None
        pickle.dump((source, options, folder, lock), self._process.stdin)
        self._process.stdin.flush()

    def run(self, tell: Callable[[str, int, int | None], object]) -> Path | None:
        """Wait for the field's file; None if cancelled. `tell` is called with a stage, items done and their total.

        Raises ValueError if the distillation failed.
        """
        assert self._process.stdout is not None
        result: dict[str, Any] = {}
        with self._process:
            for line in self._process.stdout:
                result = json.loads(line)
                if "stage" in result:
                    tell(result["stage"], result["done"], result["total"])
        if self._cancelled:
            return None
        if "field" in result:
            return Path(result["field"])
        code = self._process.returncode
        lost = ", perhaps for lack of memory" if code < 0 else f" (exit code {code})"
        raise ValueError(result.get("error", f"The distillation ended before it was done{lost}"))

    def cancel(self) -> None:
        """Stop it."""
        self._cancelled = True
        self._process.kill()


class JsonStages(Stages):
    """Stages that write their progress as JSON lines."""

    def __init__(self, stream: IO[str]) -> None:
        super().__init__(show=False)
        self._stream = stream

    def tell(self, **message: Any) -> None:
        """Write one line."""
        self._stream.write(json.dumps(message) + "\n")
        self._stream.flush()

    @contextmanager
    def stage(self, name: str, total: int | None = None) -> Iterator[Any]:
        """Time the block under `name` and write its progress, at most once per `INTERVAL`."""
        done, written = 0, time.monotonic()
        self.tell(stage=name, done=0, total=total)

        def advance(count: int = 1) -> None:
            nonlocal done, written
            done += count
            now = time.monotonic()
            if now - written >= INTERVAL or done == total:
                written = now
                self.tell(stage=name, done=done, total=total)

        with super().stage(name, total):
            yield advance


def main() -> None:
    """Run the job read from the input."""
    # Redirect stdout to stderr: output of libraries must not mix with the JSON lines.
    stages = JsonStages(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)
    source, options, folder, lock = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        with _exclusive(lock, stages):
            path = _distill(source, options, folder, stages)
    except MemoryError as error:
        stages.tell(error=": ".join(["Memory ran out", *filter(None, [str(error)])]))
    except (OSError, ValueError) as error:
        stages.tell(error=str(error))
    else:
        stages.tell(field=str(path))


def _distill(source: Source, options: SessionOptions, folder: Path, stages: JsonStages) -> Path:
    from dfd.distillation.distill import distill

    with stages.stage("read"):
        mesh, _ = read_shape(source)
    field = distill(mesh, **options.distill_arguments(), progress=stages)
    path = folder / "distilled.field.safetensors"
    field.save(path)
    return path


def _end_with_input() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


@contextmanager
def _exclusive(lock: Path | None, stages: JsonStages) -> Iterator[None]:
    """Wait until no other distillation of the same server runs: two at once would each take twice as long."""
    if lock is None:
        yield
        return
    with lock.open("w") as stream:
        if not try_lock(stream):
            stages.tell(stage="wait", done=0, total=None)
            while not try_lock(stream):
                time.sleep(INTERVAL)
        yield


def try_lock(stream: IO[str]) -> bool:
    """Whether this process holds the file's lock now; the system releases it when the process ends in any way."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    main()
