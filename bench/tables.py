"""Format tables as CSV and as Markdown, and write text files. The text of a None cell is empty."""

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dfd.common.errors import one_line
from dfd.common.files import write_file

Rows = Sequence[Sequence[Any]]


def write_text(path: Path, text: str) -> None:
    """Write a file atomically; create its folder if there is none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, text)


def to_csv(columns: Iterable[str], rows: Rows) -> str:
    """Return CSV text: a line of column names, then one line for each row."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow(["" if cell is None else f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row])
    return text.getvalue()


def to_markdown(columns: Iterable[str], rows: Rows, form: str = ".3g") -> str:
    """Return a Markdown table whose columns of numbers are aligned right; `form` is the format of floats."""
    right = [all(cell is None or isinstance(cell, int | float) for cell in each) for each in zip(*rows, strict=True)]
    rule = "|" + "|".join("---:" if each else "---" for each in right) + "|"
    return "\n".join([_line(columns), rule, *(_line(_shown(cell, form) for cell in row) for row in rows)])


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |"


def _shown(cell: Any, form: str) -> str:
    if cell is None:
        return ""
    if isinstance(cell, bool) or not isinstance(cell, int | float | np.number):
        return one_line(cell)
    return f"{cell:,}" if isinstance(cell, int) else f"{cell:{form}}"
