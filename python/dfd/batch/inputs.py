"""Which shapes a batch is of: files, globs or a manifest, here or wherever fsspec reads."""

from __future__ import annotations

import csv
import glob
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

MESH_ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf", ".fbx")
MANIFEST_ENDINGS = (".csv", ".parquet")
COLUMNS = ("path", "name", "field")
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,119}")


@dataclass(frozen=True)
class Shape:
    """One shape of a batch."""

    name: str  # what its folder is called, distinct from all others also where case does not count
    path: str  # its file: a path here, or a URL that fsspec reads
    field: str | None = None  # its field, if one is given


def find_shapes(inputs: Sequence[str]) -> list[Shape]:
    """The shapes that `inputs` name, ordered by name.

    `inputs` are mesh files and globs, whose names follow from where they lie below the folder that all of them share;
    or one manifest, CSV or Parquet, with a column `path`, and optionally `name` and `field`. Paths in a manifest are
    relative to it. Anything may be a URL such as s3://bucket/shapes/*.glb.

    Raises ValueError if two shapes have one name, a name cannot be that of a folder, or a manifest lacks a column or a
    value; OSError if a glob matches nothing, or a manifest cannot be read.
    """
    if not inputs:
        raise ValueError("`MESH` must name a mesh, a glob or a manifest, got none")
    manifests = [each for each in inputs if each.lower().endswith(MANIFEST_ENDINGS)]
    if manifests and len(inputs) > 1:
        raise ValueError(f"`MESH` must be meshes and globs or one manifest, got {manifests[0]} and others")
    shapes = _of_manifest(inputs[0]) if manifests else _of_globs(inputs)
    _check_names(shapes)
    return sorted(shapes, key=lambda shape: shape.name)


def is_remote(path: str) -> bool:
    """Whether a path is a URL for fsspec."""
    return "://" in path


def has_magic(pattern: str) -> bool:
    """Whether a pattern stands for several files."""
    return glob.has_magic(pattern)


def local_matches(pattern: str) -> list[Path]:
    """The meshes that a pattern matches here, in order; FileNotFoundError if there is none."""
    found = [Path(path) for path in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207  # also absolute ones
    meshes = [path for path in found if path.suffix.lower() in MESH_ENDINGS]
    if not meshes:
        raise FileNotFoundError(f"nothing matches {pattern}")
    return meshes


def _of_globs(patterns: Sequence[str]) -> list[Shape]:
    found: dict[str, None] = {}
    for pattern in patterns:
        found |= dict.fromkeys(_matches(pattern))
    # Relative to the folder that the patterns share, not the files: then an added file renames no other one.
    roots = [_fixed(pattern) for pattern in patterns]
    shared = roots[0]
    while not all(root[: len(shared)] == shared for root in roots):
        shared = shared[:-1]
    return [Shape(_name(PurePosixPath(_posix(path)).parts[len(shared) :]), path) for path in found]


def _matches(pattern: str) -> list[str]:
    if not is_remote(pattern):
        if has_magic(pattern) and not Path(pattern).exists():
            return [str(path) for path in local_matches(pattern)]
        if not Path(pattern).exists():
            raise FileNotFoundError(f"`MESH`: {pattern} does not exist")
        return [pattern]
    if not has_magic(pattern):
        return [pattern]
    system, inside = _fsspec().core.url_to_fs(pattern)
    scheme = pattern.partition("://")[0]
    found = sorted(path for path in system.glob(inside) if path.lower().endswith(MESH_ENDINGS))
    if not found:
        raise FileNotFoundError(f"`MESH`: nothing matches {pattern}")
    return [path if is_remote(path) else f"{scheme}://{path}" for path in found]


def _fixed(pattern: str) -> tuple[str, ...]:
    """The folders of a pattern before its first wildcard, or before the file that it names."""
    parts = PurePosixPath(_posix(pattern)).parts
    fixed = next((number for number, part in enumerate(parts) if has_magic(part)), len(parts))
    return parts[: min(fixed, len(parts) - 1)]


def _posix(path: str) -> str:
    return path if is_remote(path) else Path(path).as_posix()


def _name(parts: Iterable[str]) -> str:
    return re.sub(r"[^A-Za-z0-9_.\-]", "_", "-".join(parts)).lstrip(".-")


def _of_manifest(manifest: str) -> list[Shape]:
    rows = _rows(manifest)
    base = manifest.rpartition("/")[0]

    def beside_manifest(path: str) -> str:
        return path if is_remote(path) or Path(path).is_absolute() or not base else f"{base}/{path}"

    shapes = []
    for number, row in enumerate(rows, 1):
        values = {column: str(row[column]).strip() for column in COLUMNS if row.get(column) not in (None, "")}
        if "path" not in values:
            raise ValueError(f"`MESH`: row {number} of {manifest} has no path")
        path = beside_manifest(values["path"])
        field = beside_manifest(values["field"]) if "field" in values else None
        shapes.append(Shape(values.get("name") or _name([PurePosixPath(_posix(path)).name]), path, field))
    if not shapes:
        raise ValueError(f"`MESH`: {manifest} has no rows")
    return shapes


def _rows(manifest: str) -> list[dict[str, Any]]:
    """The rows of a CSV or Parquet file; ValueError if it is no such file, or lacks the column `path`."""
    data = _read(manifest)
    if manifest.lower().endswith(".csv"):
        try:
            reader = csv.DictReader(io.StringIO(data.decode("utf-8-sig")), strict=True)
            columns, rows = list(reader.fieldnames or ()), list(reader)
        except (UnicodeDecodeError, csv.Error) as error:
            raise ValueError(f"`MESH`: {manifest} is no CSV file in UTF-8: {error}") from None
    else:
        import pyarrow
        from pyarrow import parquet

        try:
            table = parquet.read_table(pyarrow.BufferReader(data))
        except (pyarrow.ArrowException, OSError) as error:
            raise ValueError(f"`MESH`: {manifest} is no Parquet file: {error}") from None
        columns, rows = table.column_names, table.to_pylist()
    if "path" not in columns:
        raise ValueError(f"`MESH`: {manifest} must have a column path, got {', '.join(map(str, columns)) or 'none'}")
    return rows


def _read(path: str) -> bytes:
    if not is_remote(path):
        return Path(path).read_bytes()
    with _fsspec().open(path, "rb") as stream:
        data: bytes = stream.read()
    return data


def _fsspec() -> Any:
    """fsspec, with its own way of finding what reads a kind of URL; ValueError if it is not installed."""
    try:
        import fsspec
    except ImportError:
        raise ValueError("`MESH`: URLs need fsspec: pip install 'dfd[batch]'") from None
    return fsspec


def _check_names(shapes: Sequence[Shape]) -> None:
    taken: dict[str, Shape] = {}
    for shape in shapes:
        if not NAME.fullmatch(shape.name):
            raise ValueError(
                f"`name` must be letters, digits, _, - and dots, at most 120 and no dot first, "
                f"got {shape.name!r} for {shape.path}"
            )
        before = taken.setdefault(shape.name.casefold(), shape)
        if before is not shape:
            raise ValueError(
                f"`name` must be distinct, but {before.path} and {shape.path} are both {shape.name}; "
                "a manifest with a column name tells them apart"
            )
