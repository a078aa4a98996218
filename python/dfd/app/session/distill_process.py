"""A distillation in a process of its own, so that it can be stopped at any moment and take nothing down with it.

    python -m dfd.app.session.distill_process     reads its order, pickled; writes JSON lines, how far it is

It ends when its input ends, and so with whoever started it.
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

from dfd.app.options import SessionOptions, Source
from dfd.app.session.shapes import read_shape
from dfd.common.progress import Stages

__all__ = ["DistillProcess", "try_lock"]

INTERVAL = 0.1  # seconds between two lines about one stage


class DistillProcess:
    """The process, from outside.

    Parameters
    ----------
    source
        The shape, which it reads for itself.
    options
        The encoder and the settings.
    folder
        Of the session: the field is written into it, and what is done until then is kept there.
    """

    def __init__(self, source: Source, options: SessionOptions, folder: Path, lock: Path | None) -> None:
        self._cancelled = False
        self._process = subprocess.Popen(
            [sys.executable, "-m", "dfd.app.session.distill_process"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._process.stdin is not None
        pickle.dump((source, options, folder, lock), self._process.stdin)
        self._process.stdin.flush()

    def run(self, tell: Callable[[str, int, int | None], object]) -> Path | None:
        """Wait for the field's file; None if it was cancelled. `tell` hears stages, what is done and of how much.

        Raises
        ------
        ValueError
            With a sentence, if there is no field.
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
        """Stop it; what is done is kept for the next one."""
        self._cancelled = True
        self._process.kill()


class TellingStages(Stages):
    """Stages that write how far they are, a JSON line each."""

    def __init__(self, stream: IO[str]) -> None:
        super().__init__(show=False)
        self._stream = stream

    def tell(self, **message: Any) -> None:
        """Write one line."""
        self._stream.write(json.dumps(message) + "\n")
        self._stream.flush()

    @contextmanager
    def stage(self, name: str, total: int | None = None) -> Iterator[Any]:
        """Time the block under `name` and tell of every step, though not too often."""
        done, told = 0, time.monotonic()
        self.tell(stage=name, done=0, total=total)

        def advance(count: int = 1) -> None:
            nonlocal done, told
            done += count
            now = time.monotonic()
            if now - told >= INTERVAL or done == total:
                told = now
                self.tell(stage=name, done=done, total=total)

        with super().stage(name, total):
            yield advance


def main() -> None:
    """Carry out the order that the input begins with."""
    # Whatever a library prints would be taken for an answer.
    stages = TellingStages(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)
    source, options, folder, lock = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        with _alone(lock, stages):
            path = _distill(source, options, folder, stages)
    except MemoryError as error:
        stages.tell(error=": ".join(["Memory ran out", *filter(None, [str(error)])]))
    except (OSError, ValueError) as error:
        stages.tell(error=str(error))
    else:
        stages.tell(field=str(path))


def _distill(source: Source, options: SessionOptions, folder: Path, stages: TellingStages) -> Path:
    from dfd.distillation.distill import distill

    with stages.stage("read"):
        mesh, _ = read_shape(source)
    field = distill(mesh, **options.distill_arguments(), progress=stages, checkpoint=folder / "distillation")
    path = folder / "distilled.field.safetensors"
    field.save(path)
    return path


def _end_with_input() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


@contextmanager
def _alone(lock: Path | None, stages: TellingStages) -> Iterator[None]:
    """Wait until no other distillation of the same server runs: two at once would take twice as long each.

    What the other one made may be what this one is for; it then finds it in the cache.
    """
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
    """Whether this process holds the file's lock now; the system releases it when the process ends, however that is."""
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
