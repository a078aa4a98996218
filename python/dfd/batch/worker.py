"""One job in a worker: its own threads, its own folder, a record at the end. Pool and Ray call the same function."""

from __future__ import annotations

import errno
import faulthandler
import os
import shutil
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import psutil

from dfd.batch.folder import EXIT_NOTE, OWNER, BatchFolder, read_settings
from dfd.batch.record import TOO_MUCH, Cause, Job, Limits, Record, Stopped, modified
from dfd.batch.settings import BatchSettings
from dfd.batch.steps import Work
from dfd.common.progress import Stages
from dfd.common.threads import set_num_threads

EVERY = 0.1  # seconds between two measurements of memory

# Errors of the folder, not of a shape: every other shape would fail too.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


def work(job: Job) -> Record | Stopped:
    """Do one job and publish its record; Stopped where the batch's folder cannot be written."""
    _use_threads(job.limits.threads)
    try:
        settings = _settings(job.root)
        folder = BatchFolder(job.root, sharded=settings.sharded)
        attempt = folder.begin_attempt(job.name, job.token)
        with guarded(attempt / EXIT_NOTE, job.limits) as watched:
            record = _done(job, settings, attempt, watched)
        if record.status == "failed":
            for path in [each for each in attempt.iterdir() if each.name not in (OWNER, EXIT_NOTE)]:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        return folder.publish(attempt, record)
    except OSError as error:
        return Stopped(why=f"{job.root} cannot be used: {error.strerror or error}")


def _done(job: Job, settings: BatchSettings, attempt: Path, watched: Watched) -> Record:
    """Do the steps; an exception becomes a failed record.

    Raises OSError if the folder is full or can only be read.
    """
    start, clock, when = time.perf_counter(), Stages(show=False), modified(job.path)
    task = Work(job, settings, attempt)
    cause: Cause | None = None
    message = None
    with warnings.catch_warnings(record=True) as shown:
        warnings.simplefilter("always", UserWarning)
        try:
            task.run(clock)
        except MemoryError as error:
            cause, message = "memory", _one_line(error) or "memory ran out"
        except (OSError, ValueError) as error:
            if isinstance(error, OSError) and error.errno in FULL:
                raise
            cause, message = "input", _one_line(error)
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            cause = "error"
            message = f"{type(error).__name__}: {_one_line(error)} ({Path(frame.filename).name}, line {frame.lineno})"
    files = sorted(path.name for path in attempt.iterdir() if path.name not in (OWNER, EXIT_NOTE))
    return job.record(
        settings.hash(),
        seconds=time.perf_counter() - start,
        cause=cause,
        message=message,
        sha256=task.sha256,
        size=task.size,
        modified=when,
        timings=clock.seconds,
        memory=watched.highest,
        figures=task.figures,
        files=files if cause is None else [],
        warnings=sorted({_one_line(each.message) for each in shown if issubclass(each.category, UserWarning)}),
    )


@lru_cache(maxsize=1)
def _settings(root: str) -> BatchSettings:
    settings = read_settings(Path(root))
    if settings is None:
        raise FileNotFoundError("the machine of a worker must see the same folder as that of the driver")
    return settings


@lru_cache(maxsize=1)
def _use_threads(count: int) -> None:
    """Compute on `count` threads from now on, against the environment: Ray sets OMP_NUM_THREADS by itself.

    Once in a worker's life, by when all libraries are loaded: to look for them takes longer than some shapes.
    """
    from threadpoolctl import threadpool_limits

    set_num_threads(count)
    os.environ["OMP_NUM_THREADS"] = str(count)  # torch begins with it, where something loads torch later
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(count)
    threadpool_limits(count)  # BLAS


def _one_line(error: object) -> str:
    return " ".join(str(error).split())


@dataclass
class Watched:
    """The memory of a task."""

    highest: int = 0  # the most that was measured, bytes


@contextmanager
def guarded(exit_note: Path, limits: Limits) -> Iterator[Watched]:
    """End this process when the block exceeds `limits`, with the reason in the file `exit_note`."""
    watched, over = Watched(), threading.Event()
    process = psutil.Process()
    with exit_note.open("wb", buffering=0) as stream:

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
