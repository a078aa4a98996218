"""Measure the wall times of the stages of a long call, and show progress bars with the time left."""

import importlib.util
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class Advance(Protocol):
    """A callback that takes the number of newly finished items, by default 1."""

    def __call__(self, count: int = 1) -> None: ...


class Stages:
    """Measures the wall times of the stages of a call; with `show`, each stage has a progress bar on standard error.

    There are no bars if standard error is neither a terminal nor a notebook.

    `seconds` maps each stage's name to its wall time, in the order in which the stages ended. `latest` is the name of
    the stage that began last.
    """

    def __init__(self, show: bool = True) -> None:
        self.seconds: dict[str, float] = {}
        self.latest: str | None = None
        self._show = show

    def __str__(self) -> str:
        """Return the names and times of the stages as a text."""
        return ", ".join(f"{name} {seconds:.1f} s" for name, seconds in self.seconds.items())

    @contextmanager
    def stage(self, name: str, total: int | None = None) -> Iterator[Advance]:
        """Measure the `with` block as the stage `name`; the yielded callback counts finished items, out of `total`."""
        self.latest = name
        start = time.perf_counter()
        try:
            if self._show:
                with _bar() as bar:
                    task = bar.add_task(name, total=total)
                    yield lambda count=1: bar.advance(task, count)
                    bar.update(task, total=total or 1, completed=total or 1)
            else:
                yield lambda count=1: None
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def _bar() -> Progress:
    # In a notebook without ipywidgets, Rich warns at each progress bar, unless it is forced to write plain text.
    force_jupyter = False if importlib.util.find_spec("ipywidgets") is None else None
    console = Console(stderr=True, force_jupyter=force_jupyter)
    return Progress(
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not (console.is_terminal or console.is_jupyter),
    )
