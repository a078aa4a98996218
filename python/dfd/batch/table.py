"""The table of a batch: a row a shape, in a Parquet file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dfd.batch.record import Record
from dfd.batch.settings import BatchSettings
from dfd.common.files import atomic_write

__all__ = ["TABLE", "write_table"]

TABLE = "shapes.parquet"
PLAIN = ("name", "path", "status", "cause", "message", "sha256", "size", "seconds", "memory", "attempts", "settings")


def write_table(root: Path, settings: BatchSettings, records: Sequence[Record]) -> Path:
    """Write `shapes.parquet`, the settings in its metadata under `dfd-batch`.

    Columns: what a `Record` says; `seconds_STEP` for every step; a column for every figure; `versions`, `files` and
    `warnings` as JSON.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    columns: dict[str, list[Any]] = {name: [getattr(record, name) for record in records] for name in PLAIN}
    for step in ("read", *settings.steps):
        columns[f"seconds_{step}"] = [record.timings.get(step) for record in records]
    for figure in sorted({name for record in records for name in record.figures}):
        columns[figure if figure not in columns else f"figure_{figure}"] = [
            record.figures.get(figure) for record in records
        ]
    for name in ("files", "warnings", "versions"):
        columns[name] = [json.dumps(getattr(record, name), sort_keys=True) for record in records]
    columns |= {name: [getattr(record, name) for record in records] for name in ("host", "finished")}
    texts = {"cause", "message", "sha256"} | {name for name in columns if name.endswith("_refused")}
    arrays = {
        name: pyarrow.array(values, pyarrow.string() if name in texts else None) for name, values in columns.items()
    }
    table = pyarrow.table(arrays).replace_schema_metadata({"dfd-batch": settings.model_dump_json()})
    path = root / TABLE
    with atomic_write(path) as temporary:
        parquet.write_table(table, temporary)
    return path
