"""`python -m bench.speed`: the table of targets, and `figures` over handles and threads, in bench/results/speed."""

from __future__ import annotations

import argparse
import csv
import io
import os
import sys
from pathlib import Path

import torch
from rich.console import Console
from rich.table import Table

import dfd
import dfd._core as _core
from dfd.common.files import atomic_write

from . import table

OUTPUT = Path(__file__).resolve().parents[1] / "results" / "speed"
COLUMNS = ("work", "best ms", "median ms", "spread ms", "against", "its best ms", "ratio", "target", "met")


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("what", nargs="*", metavar="table|figures", help="what to measure (default: table)")
    parser.add_argument("--vertices", type=int, default=500_000, help="of the table (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=dfd.get_num_threads(), help="default: %(default)s")
    options = parser.parse_args()
    wanted = options.what or ["table"]
    if unknown := set(wanted) - {"table", "figures"}:
        parser.error(f"there is no {min(unknown)}: choose from table, figures")
    dfd.set_num_threads(options.threads)
    torch.set_num_threads(options.threads)
    if options.threads != int(os.environ.get("OPENBLAS_NUM_THREADS", 0)):  # NumPy's products read it once, at start
        os.environ["OPENBLAS_NUM_THREADS"] = str(options.threads)
        os.execv(sys.executable, [sys.executable, "-m", "bench.speed", *sys.argv[1:]])
    OUTPUT.mkdir(parents=True, exist_ok=True)
    console = Console(width=170)
    console.print(f"{options.threads} threads, {_core.instruction_set()}")
    if "table" in wanted:
        _table(console, options.vertices)
    if "figures" in wanted:
        from .figures import draw

        for path in draw(OUTPUT):
            console.print(f"wrote {path}")


def _table(console: Console, vertex_count: int) -> None:
    shown = Table(*COLUMNS, title=f"{vertex_count:,} vertices; ratios are of the best times")
    rows = [_row(line) for line in table.lines(vertex_count)]
    for row in rows:
        shown.add_row(*row)
    console.print(shown)
    text = io.StringIO()
    csv.writer(text).writerows([COLUMNS, *rows])
    with atomic_write(OUTPUT / "table.csv") as path:
        path.write_text(text.getvalue(), encoding="utf-8")


def _row(line: table.Line) -> list[str]:
    times = [f"{1e3 * seconds:.3f}" for seconds in (line.timing.best, line.timing.median, line.timing.spread)]
    other = "" if line.other is None else f"{1e3 * line.other.best:.3f}"
    met = {None: "", True: "yes", False: "no"}[line.met]
    return [line.work, *times, line.against, other, line.value, line.target, met]


if __name__ == "__main__":
    main()
