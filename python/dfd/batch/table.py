"""The table of a batch: a row a shape, in a Parquet file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import pyarrow
from pyarrow import parquet

from dfd.batch.record import Record
from dfd.batch.settings import BatchSettings
from dfd.common.files import atomic_write

__all__ = ["TABLE", "gather", "write_table"]

TABLE = "shapes.parquet"
PLAIN = {
    "name": pyarrow.string(),
    "path": pyarrow.string(),
    "status": pyarrow.string(),
    "cause": pyarrow.string(),
    "message": pyarrow.string(),
    "sha256": pyarrow.string(),
    "size": pyarrow.int64(),
    "seconds": pyarrow.float64(),
    "memory": pyarrow.int64(),
    "attempts": pyarrow.int64(),
    "settings": pyarrow.string(),
    "host": pyarrow.string(),
    "finished": pyarrow.string(),
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
    """Write the table as `shapes.parquet` into the folder of its batch.

    Raises
    ------
    OSError
        If it cannot be written.
    """
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
