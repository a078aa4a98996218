"""The driver of a batch: hands out shapes, records the results, and writes the table and the page.

All its state is in the folder, so it may be interrupted at any moment: the next run resumes.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dfd.batch.folder import BatchFolder
from dfd.batch.inputs import Shape
from dfd.batch.page import gather, write_page, write_table
from dfd.batch.pool import Slots
from dfd.batch.record import (
    CAUSES,
    FAILED_EXPORT,
    Cause,
    Job,
    Limits,
    Record,
    Stopped,
    WorkerDied,
    exit_reason,
    modified,
    new_token,
)
from dfd.batch.settings import BatchSettings

ATTEMPTS = 2  # at a shape whose worker dies without a note: the system may have killed it for other tasks' memory
LOOK_EVERY = 1.0  # seconds


class Watcher(Protocol):
    """Receives the progress of a batch."""

    def begun(self, total: int, finished: int) -> None:
        """So many shapes in all, and so many finished by earlier runs."""

    def ended(self, record: Record) -> None:
        """A shape is finished."""

    def looked(self) -> None:
        """Called at least every second or so."""


@dataclass
class Summary:
    """The results of a run."""

    # done, failed: shapes of this run's rank, those of earlier runs included
    done: int = 0
    failed: int = 0
    causes: Counter[str] = field(default_factory=Counter)  # how many failed of what
    missing: int = 0  # shapes of all ranks that are not finished
    # seconds, busy: wall time, and the sum over the shapes of this run
    seconds: float = 0.0
    busy: float = 0.0

    def count(self, record: Record) -> None:
        """Count a finished shape."""
        if record.status == "done":
            self.done += 1
        else:
            self.failed += 1
            self.causes[record.cause or "error"] += 1


def run_batch(
    shapes: Sequence[Shape],
    settings: BatchSettings,
    folder: BatchFolder,
    slots: Slots,
    limits: Limits,
    watcher: Watcher,
    *,
    rank: int = 0,
    world_size: int = 1,
    retry: bool = False,
) -> Summary:
    """Finish every shape of this rank, each once, and write the table and the page when no rank has one left.

    `shapes` are those of all ranks, in one order; `retry` repeats what failed before.

    Raises OSError if the folder can no longer be written.
    """
    start, summary = time.perf_counter(), Summary()
    mine = shapes[rank::world_size]
    folder.sweep()
    todo: deque[tuple[Shape, int]] = deque()
    for shape in mine:
        record = folder.record(shape.name)
        if record is not None and _stands(record, shape, settings, retry):
            summary.count(record)
        else:
            todo.append((shape, 1))
    watcher.begun(len(mine), summary.done + summary.failed)
    root, running = str(folder.root.resolve()), 0
    while todo or running:
        while todo and slots.free():
            shape, attempt = todo.popleft()
            if attempt == 1:
                folder.retire(shape.name)  # of another file, or a failure that is retried
            slots.submit(Job(root=root, **asdict(shape), attempt=attempt, token=new_token(), limits=limits))
            running += 1
        for job, outcome in slots.wait(LOOK_EVERY):
            running -= 1
            if isinstance(outcome, Stopped):
                raise OSError(f"`--output`: {outcome.why}")
            record = _after_death(job, outcome, settings, folder) if isinstance(outcome, WorkerDied) else outcome
            if record is None:
                todo.append((Shape(job.name, job.path, job.field), job.attempt + 1))
                continue
            summary.count(record)
            summary.busy += record.seconds
            watcher.ended(record)
        watcher.looked()
    summary.missing = sum(not folder.finished(shape.name) for shape in shapes)
    if summary.missing == 0:
        table = gather((record for shape in shapes if (record := folder.record(shape.name))), settings)
        write_table(folder.root, table)
        write_page(folder, settings, table)
    summary.seconds = time.perf_counter() - start
    return summary


def _stands(record: Record, shape: Shape, settings: BatchSettings, retry: bool) -> bool:
    """Whether a record of an earlier run is that of this shape's present file, under these settings."""
    if record.settings != settings.hash() or record.path != shape.path:
        return False
    if record.modified is not None and record.modified != modified(shape.path):
        return False
    return record.status == "done" or not retry


def _after_death(job: Job, died: WorkerDied, settings: BatchSettings, folder: BatchFolder) -> Record | None:
    """The record of a shape whose worker ended, or None where it is to be tried again."""
    published = folder.record(job.name)  # it may have been published before the worker died
    if published is not None:
        return published
    note, seconds = folder.clear_away(job.name, job.token)
    known = exit_reason(note, job.limits)
    if known is None and job.attempt < ATTEMPTS:
        return None
    cause: Cause
    cause, message = known or ("crash", f"{died.how}, {job.attempt} times")
    when = modified(job.path)
    record = job.record(settings.hash(), seconds=seconds, cause=cause, message=message, modified=when)
    return folder.publish(folder.begin_attempt(job.name, new_token()), record)


A_LINE_EACH = 1000  # shapes; of more only those that failed have a line
LINE_EVERY = 30.0  # seconds between two lines of a log


class BatchProgress:
    """Draws on standard error: shapes a minute, time left, failures so far."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._bar = Progress(
            TextColumn("shapes"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]:.1f} a minute"),
            TextColumn("{task.fields[failed]} failed"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=self._console,
        )
        self._task = self._bar.add_task("shapes", total=None, rate=0.0, failed=0)
        self._total = self._before = self._ended = self._failed = 0
        self._start = self._told = time.monotonic()

    @contextmanager
    def shown(self) -> Iterator[BatchProgress]:
        """Draw for as long as the block lasts."""
        if self._console.is_terminal:
            with self._bar:
                yield self
        else:
            yield self

    def begun(self, total: int, finished: int) -> None:
        self._total, self._before = total, finished
        self._start = self._told = time.monotonic()
        self._bar.update(self._task, total=total, completed=finished)
        if finished:
            self._console.print(f"{finished} of {total} shapes were finished before")

    def ended(self, record: Record) -> None:
        self._ended += 1
        self._failed += record.status == "failed"
        if record.cause is not None:
            self._console.print(f"{record.name} failed: {CAUSES[record.cause]}: {record.message}", markup=False)
        elif self._total <= A_LINE_EACH:
            self._console.print(f"{record.name} done in {record.seconds:.1f} s", markup=False)
        for why in (text for name, text in record.figures.items() if name.endswith(FAILED_EXPORT) and text):
            self._console.print(f"{record.name}: not exported: {why}", markup=False)
        self._bar.update(self._task, advance=1, rate=self._rate(), failed=self._failed)

    def looked(self) -> None:
        """Write a line from time to time where there is no terminal, and shapes have none of their own."""
        if self._total > A_LINE_EACH and not self._console.is_terminal and time.monotonic() - self._told >= LINE_EVERY:
            self._told = time.monotonic()
            rate, left = self._rate(), self._total - self._before - self._ended
            time_left = f"{left / rate:.0f} minutes left" if rate > 0 else "time left unknown"
            self._console.print(
                f"{self._before + self._ended} of {self._total} shapes, {rate:.1f} a minute, {time_left}, "
                f"{self._failed} failed"
            )

    def _rate(self) -> float:
        """Shapes a minute, of this run."""
        return 60.0 * self._ended / max(time.monotonic() - self._start, 1e-3)
