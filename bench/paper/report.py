"""A page about one figure or table of the paper: pictures, tables, and what to look for.

`write` makes NAME.md with one PNG for each section that has pictures and one CSV for each table, and NAME.json with all
numbers of the page.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from bench.tables import to_csv, to_markdown, write_text
from dfd.common.linear_algebra import UInt8
from dfd.pictures.contact_sheet import contact_sheet
from dfd.pictures.picture import save_png

Row = tuple[str, Sequence[tuple[UInt8, str]]]  # a heading, and pictures with their captions
CELL = 320


@dataclass(frozen=True)
class Table:
    """Numbers and words: one list a row, as many entries as `columns`; None where there is none."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Section:
    """A part of a page."""

    heading: str
    text: str = ""
    pictures: Sequence[Row] = ()
    table: Table | None = None
    image: Image.Image | None = None  # a picture of its own kind, such as a plot


@dataclass(frozen=True)
class Page:
    """What `python -m bench.paper NAME` makes: the title, one sentence with what to look for, and the sections."""

    title: str
    look_for: str
    sections: Sequence[Section]
    facts: Mapping[str, Any] = field(default_factory=dict)  # further numbers, for NAME.json alone
    files: Mapping[str, str] = field(default_factory=dict)  # further texts to write beside the page, by their names
    failed: int = 0  # how many of its shapes could not be done; the command's exit code tells


def write(page: Page, name: str, folder: Path, notes: Sequence[str], settings: Mapping[str, Any]) -> Path:
    """Write `page` into `folder` and return the path of its Markdown file.

    `notes` are lines about how the page was made; `settings` go into NAME.json.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f"# {page.title}", "", page.look_for, "", *[f"- {note}" for note in notes]]
    tables = {}
    for number, section in enumerate(page.sections, 1):
        stem = f"{name}_{number}"
        lines += ["", f"## {section.heading}"]
        if section.text:
            lines += ["", section.text]
        if section.pictures:
            save_png(folder / f"{stem}.png", contact_sheet(section.pictures, cell=CELL))
            lines += ["", f"![{section.heading}]({stem}.png)"]
        if section.image is not None:
            save_png(folder / f"{stem}_plot.png", section.image)
            lines += ["", f"![{section.heading}]({stem}_plot.png)"]
        if section.table is not None:
            write_text(folder / f"{stem}.csv", to_csv(section.table.columns, section.table.rows))
            tables[section.heading] = [dict(zip(section.table.columns, row, strict=True)) for row in section.table.rows]
            lines += ["", *to_markdown(section.table.columns, section.table.rows)]
    document = {"page": name, "title": page.title, **settings, "tables": tables, **page.facts}
    write_text(folder / f"{name}.json", json.dumps(document, indent=2, default=_plain) + "\n")
    for other, text in page.files.items():
        write_text(folder / other, text)
    write_text(folder / f"{name}.md", "\n".join(lines) + "\n")
    return folder / f"{name}.md"


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)
