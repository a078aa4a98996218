"""Milliseconds against the number of handles and of threads, on 500,000 vertices; against faces see `bench.paper`."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import dfd
from dfd.common.files import atomic_write

from .made_input import MadeInput, make_input
from .measure import measure

Row = tuple[str, float, float]  # series, position on the horizontal axis, milliseconds


def draw(folder: Path) -> Iterator[Path]:
    """Measure, and write each figure as CSV and PNG."""
    made = make_input(500_000)
    for axis, rows in (("handles", list(_handles(made))), ("threads", list(_threads(made)))):
        text = io.StringIO()
        csv.writer(text).writerows([("series", axis, "milliseconds"), *rows])
        figure = Figure(figsize=(7, 4.5), layout="constrained", dpi=160)
        axes = figure.subplots()
        for name in dict.fromkeys(series for series, _, _ in rows):
            positions, values = zip(*(row[1:] for row in rows if row[0] == name), strict=True)
            axes.plot(positions, values, "o-", markersize=3, label=name)
        title = f"{len(made.vertices):,} vertices"
        axes.set(xscale="log", yscale="log", xlabel=axis, ylabel="milliseconds", title=title)
        axes.grid(visible=True, color="0.9")
        axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
        with atomic_write(folder / f"{axis}.csv") as target:
            target.write_text(text.getvalue(), encoding="utf-8")
        yield folder / f"{axis}.csv"
        with atomic_write(folder / f"{axis}.png") as target:
            figure.savefig(target, format="png")
        yield folder / f"{axis}.png"


def _handles(made: MadeInput) -> Iterator[Row]:
    for count in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000):
        for name, call in _calls(made, count).items():
            yield f"dfd {name}", count, _milliseconds(call)


def _threads(made: MadeInput) -> Iterator[Row]:
    before = dfd.get_num_threads()
    try:
        for threads in range(1, before + 1):
            dfd.set_num_threads(threads)
            for count in (1, 10, 100):
                calls = _calls(made, count)
                for name in ("bind", "pose"):
                    yield f"dfd {name} {count}", threads, _milliseconds(calls[name])
    finally:
        dfd.set_num_threads(before)


def _calls(made: MadeInput, count: int) -> dict[str, Callable[[], object]]:
    handles, transforms = made.handles(count), made.transforms[:count]
    out, posed = np.empty((len(made.vertices), count), np.float32), np.empty_like(made.vertices)
    weights = dfd.bind(made.compact, handles) / count
    drag = dfd.Drag(made.vertices, weights, transforms, [0])
    return {
        "bind": lambda: dfd.bind(made.compact, handles, out=out),
        "pose": lambda: dfd.pose(made.vertices, weights, transforms, out=posed),
        "drag frame": lambda: drag.pose(transforms[:1], out=posed),
    }


def _milliseconds(call: Callable[[], object]) -> float:
    return 1e3 * measure(call, seconds=0.3, least=3).best
