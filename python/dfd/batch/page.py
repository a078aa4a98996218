"""The page of a batch: every shape with its thumbnail, failures first; it opens from the folder, without a server."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pyarrow
from pyarrow import parquet

from dfd.batch.folder import BatchFolder
from dfd.batch.record import CAUSES, FAILED_EXPORT, Record, failures
from dfd.batch.settings import BatchSettings
from dfd.common.files import atomic_write

PAGE = "index.html"
ON_A_PAGE = 2000  # shapes; more are in index-2.html and so on

HEAD = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
body {{ font: 14px/1.4 system-ui, sans-serif; color: #1c1e24; margin: 2rem; }}
h1 {{ font-size: 1.3rem; font-weight: 600; }}
nav a, nav b {{ margin-right: .6rem; }}
main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(180px, 1fr)); gap: 1rem; }}
article {{ border: 1px solid #dcdee2; border-radius: 6px; padding: .5rem; overflow-wrap: anywhere; }}
article.failed {{ border-color: #c0392b; background: #fdf3f2; }}
img {{ width: 100%; aspect-ratio: 1; object-fit: contain; background: white; }}
small {{ color: #64686f; display: block; }}
a {{ color: inherit; }}
</style>
"""


def write_page(folder: BatchFolder, settings: BatchSettings, table: pyarrow.Table) -> Path:
    """Write `index.html` from the table of the batch, and further pages where there are more than 2,000 shapes.

    Raises OSError if it cannot be written.
    """
    ordered = table.sort_by([("status", "descending"), ("name", "ascending")])  # what failed comes first
    starts = range(0, max(1, len(ordered)), ON_A_PAGE)
    causes = Counter(table.column("cause").to_pylist())
    tally = [f"{causes.pop(None, 0):,} done", *(failures(cause, count) for cause, count in causes.most_common())]
    exports = [name for name in table.column_names if name.endswith(FAILED_EXPORT)]
    lacking = sum(any(row.values()) for row in table.select(exports).to_pylist()) if exports else 0
    title = f"{len(table):,} shapes: {', '.join(tally)}" + (f"; {lacking:,} without an export" if lacking else "")
    for number, start in enumerate(starts, 1):
        path = folder.root / _page_name(number)
        with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
            stream.write(HEAD.format(title=escape(title)) + f"<h1>{escape(title)}</h1>\n")
            stream.write(f"<p>Steps: {', '.join(settings.steps)}. <a href='shapes.parquet'>shapes.parquet</a></p>\n")
            if len(starts) > 1:
                stream.write("<nav>" + "".join(_links(len(starts), number)) + "</nav>\n")
            stream.write("<main>\n")
            stream.writelines(_article(folder, row) for row in ordered.slice(start, ON_A_PAGE).to_pylist())
            stream.write("</main>\n</html>\n")
    return folder.root / PAGE


def _page_name(number: int) -> str:
    return PAGE if number == 1 else f"index-{number}.html"


def _links(count: int, here: int) -> Iterator[str]:
    for number in range(1, count + 1):
        yield f"<b>{number}</b>" if number == here else f"<a href='{_page_name(number)}'>{number}</a>"


def _article(folder: BatchFolder, row: dict[str, Any]) -> str:
    link = quote(folder.shape(row["name"]).relative_to(folder.root).as_posix())
    shown = [name for name in json.loads(row["files"]) if name.endswith(".png")]
    shown.sort(key=lambda name: (name != "thumbnail.png", name))
    images = "".join(
        f"<a href='{link}/{quote(name)}'><img loading='lazy' src='{link}/{quote(name)}' alt='{escape(name)}'></a>"
        for name in shown
    )
    faces = row.get("faces")
    lines = [*([] if faces is None else [f"{faces:,} faces"]), f"{row['seconds']:.1f} s"]
    refused = [str(text) for name, text in row.items() if name.endswith(("_refused", FAILED_EXPORT)) and text]
    lines += [f"{CAUSES[row['cause']]}: {row['message']}"] if row["cause"] else refused
    text = "".join(f"<small>{escape(line)}</small>" for line in lines)
    return f"<article class='{row['status']}'>{images}<a href='{link}/'>{escape(row['name'])}</a>{text}</article>\n"


TABLE = "shapes.parquet"
PLAIN = {
    **dict.fromkeys(("name", "path", "status", "cause", "message", "sha256"), pyarrow.string()),
    **dict.fromkeys(("size", "seconds", "memory", "attempts"), pyarrow.int64()),
    **dict.fromkeys(("settings", "host", "finished"), pyarrow.string()),
    "seconds": pyarrow.float64(),
}
AS_JSON = ("files", "warnings", "versions")
AT_ONCE = 10_000  # records in memory; as rows they take a tenth


def gather(records: Iterable[Record], settings: BatchSettings) -> pyarrow.Table:
    """Return the table of `records`, in their order.

    Columns: what a `Record` says; `seconds_STEP` for every step; a column for every figure; `files`, `warnings` and
    `versions` as JSON. The settings are in its metadata under `dfd-batch`.
    """
    steps = ("read", *settings.steps)
    parts = [_rows(part, steps) for part in _parts(iter(records))] or [_rows([], steps)]
    table = pyarrow.concat_tables(parts, promote_options="permissive")
    return table.replace_schema_metadata({"dfd-batch": settings.model_dump_json()})


def write_table(root: Path, table: pyarrow.Table) -> Path:
    """Write the table as `shapes.parquet` into the folder of its batch; OSError if it cannot be written."""
    path = root / TABLE
    with atomic_write(path) as temporary:
        parquet.write_table(table, temporary)
    return path


def _parts(records: Iterator[Record]) -> Iterator[list[Record]]:
    while part := list(islice(records, AT_ONCE)):
        yield part


def _rows(records: Sequence[Record], steps: Sequence[str]) -> pyarrow.Table:
    columns: dict[str, Any] = {
        name: pyarrow.array([getattr(record, name) for record in records], kind) for name, kind in PLAIN.items()
    }
    for step in steps:
        seconds = [record.timings.get(step) for record in records]
        columns[f"seconds_{step}"] = pyarrow.array(seconds, pyarrow.float64())
    for figure in sorted({name for record in records for name in record.figures}):
        columns[figure] = pyarrow.array([record.figures.get(figure) for record in records])
    for name in AS_JSON:
        columns[name] = pyarrow.array([json.dumps(getattr(record, name), sort_keys=True) for record in records])
    return pyarrow.table(columns)
