"""Find the shapes of a batch, from mesh files, globs or a CSV manifest."""

import csv
import glob
import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

MESH_ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")
LONGEST_NAME = 100  # characters; the rest of a longer name is replaced by a hash


@dataclass(frozen=True)
class Shape:
    """One shape of a batch."""

    name: str  # name of its folder, unique in the batch even if case is ignored
    path: str  # absolute path of its file
    field: str | None = None  # path of its field, if the manifest names one


def find_shapes(inputs: Sequence[str]) -> list[Shape]:
    """Return the shapes that `inputs` name, ordered by name.

    `inputs` are mesh files and globs, or one CSV manifest with a column `path` and optional columns `name` and `field`.
    Paths in a manifest are relative to its folder. Without a manifest, the name of a shape is its path relative to the
    folder that all inputs share. Unsafe characters in a name are replaced. A long or repeated name ends in a hash.

    Raises ValueError if `inputs` is empty, or a manifest is not valid or is not the only input. Raises OSError if a
    glob matches nothing, or a file does not exist or cannot be read.
    """
    if not inputs:
        raise ValueError("`MESH` must name a mesh, a glob or a manifest, got none")
    manifests = [each for each in inputs if each.lower().endswith(".csv")]
    if manifests and len(inputs) > 1:
        raise ValueError(f"`MESH` must be meshes and globs or one manifest, got {manifests[0]} and others")
    found = _of_manifest(Path(inputs[0])) if manifests else _of_globs(inputs)
    shapes: dict[str, Shape] = {}
    for wanted, path, field in found:
        name = re.sub(r"[^A-Za-z0-9_.\-]", "_", wanted).lstrip(".-")
        if len(name) > LONGEST_NAME or name.casefold() in shapes or not name:
            name = f"{name[:LONGEST_NAME]}-{hashlib.sha256(os.fsencode(path)).hexdigest()[:12]}"
        shapes[name.casefold()] = Shape(name, str(path), None if field is None else str(field))
    return sorted(shapes.values(), key=lambda shape: shape.name)


def matches(pattern: str) -> list[Path]:
    """Return the file that `pattern` names, or all meshes that the pattern matches, sorted by path.

    Raises FileNotFoundError if there is no such file.
    """
    if not has_magic(pattern):
        if not Path(pattern).is_file():
            raise FileNotFoundError(f"`MESH`: {pattern} does not exist or is no file")
        return [Path(pattern)]
    found = [Path(path) for path in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207  # patterns may be absolute
    meshes = [path for path in found if path.suffix.lower() in MESH_ENDINGS]
    if not meshes:
        raise FileNotFoundError(f"`MESH`: nothing matches {pattern}")
    return meshes


def has_magic(pattern: str) -> bool:
    """Return whether a pattern has wildcards. Brackets in the name of an existing file are not wildcards."""
    return glob.has_magic(pattern) and not Path(pattern).exists()


def _of_globs(patterns: Sequence[str]) -> Iterator[tuple[str, Path, None]]:
    paths = dict.fromkeys(path.absolute() for pattern in patterns for path in matches(pattern))
    # Names are relative to a folder that depends only on the patterns, so that files added later change no other name.
    shared = Path(os.path.commonpath([_fixed_folder(Path(pattern).absolute()) for pattern in patterns]))
    return (("-".join(path.relative_to(shared).parts), path, None) for path in paths)


def _fixed_folder(pattern: Path) -> Path:
    """Return the innermost parent folder of `pattern` that has no wildcard in its path."""
    folder = pattern.parent
    while has_magic(str(folder)):
        folder = folder.parent
    return folder


def _of_manifest(manifest: Path) -> Iterable[tuple[str, Path, Path | None]]:
    try:
        with manifest.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream, strict=True)
            columns, rows = reader.fieldnames or (), list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"`MESH`: {manifest} is no CSV file in UTF-8: {error}") from None
    if "path" not in columns:
        raise ValueError(f"`MESH`: {manifest} must have a column `path`, got {', '.join(columns) or 'none'}")
    if not rows:
        raise ValueError(f"`MESH`: {manifest} has no rows")
    folder, shapes = manifest.absolute().parent, []
    for number, row in enumerate(rows, 1):
        values = {column: (row.get(column) or "").strip() for column in ("path", "name", "field")}
        if not values["path"]:
            raise ValueError(f"`MESH`: row {number} of {manifest} has no path")
        path, field = folder / values["path"], folder / values["field"] if values["field"] else None
        shapes.append((values["name"] or path.name, path, field))
    return shapes
