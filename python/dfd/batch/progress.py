"""How far a batch is, for people: a bar in a terminal, a line now and then in a log."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dfd.batch.record import Record

__all__ = ["BatchProgress"]

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
        """So many shapes in all, and so many finished by earlier runs."""
        self._total, self._before = total, finished
        self._start = self._told = time.monotonic()
        self._bar.update(self._task, total=total, completed=finished)
        if finished:
            self._console.print(f"{finished} of {total} shapes were finished before")

    def ended(self, record: Record) -> None:
        """A shape is finished."""
        self._ended += 1
        self._failed += record.status == "failed"
        if record.status == "failed":
            self._console.print(f"{record.name} failed ({record.cause}): {record.message}", markup=False)
        self._bar.update(self._task, advance=1, rate=self._rate(), failed=self._failed)

    def looked(self) -> None:
        """Write a line where a log is all there is."""
        if not self._console.is_terminal and time.monotonic() - self._told >= LINE_EVERY:
            self._told = time.monotonic()
            rate, left = self._rate(), self._total - self._before - self._ended
            time_left = f"{left / rate:.0f} minutes left" if rate > 0 else "no time can be told yet"
            self._console.print(
                f"{self._before + self._ended} of {self._total} shapes, {rate:.1f} a minute, {time_left}, "
                f"{self._failed} failed"
            )

    def _rate(self) -> float:
        """Shapes a minute, of this run."""
        return 60.0 * self._ended / max(time.monotonic() - self._start, 1e-3)
