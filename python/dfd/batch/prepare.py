"""The edits of a batch, brought into its folder with the meshes and fields that they were made on."""

from __future__ import annotations

import filecmp
import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import dfd
from dfd.batch.folder import BatchFolder
from dfd.batch.inputs import NAME
from dfd.batch.one_edit import Original, field_path
from dfd.batch.settings import EditSource
from dfd.batch.steps import source_of
from dfd.common.files import atomic_write
from dfd.editing.edit_file import read_made_on
from dfd.field.field import Field, FieldSource


class EditFiles(NamedTuple):
    """An edit, and the mesh and the field that it was made on."""

    edit: Path
    mesh: Path
    field: Path


def find_files(edit: Path, made_on: Path | None = None) -> EditFiles:
    """The files of an edit: the given mesh or the one it names, and the field it names or the one next to the mesh.

    Raises ValueError if it is no edit, or says no mesh and none is named; OSError if it or the mesh that it says cannot
    be read, or there is no field.
    """
    named, field, sha256 = read_made_on(edit)
    mesh = named if made_on is None else made_on
    if mesh is None:
        raise ValueError(f"`--made-on` must name the mesh that {edit} was made on: it does not say")
    if not mesh.is_file():
        hint = "" if made_on is not None else ": `--made-on` must say where it is now"
        raise FileNotFoundError(f"{mesh}, on which {edit} was made, does not exist{hint}")
    beside = field_path(mesh)
    if named is None or not (named.is_file() and named.samefile(mesh)):
        field = None  # it is of another mesh
    if field is not None and field.is_file() and sha256 in (None, FieldSource.of(field).sha256):
        return EditFiles(edit, mesh, field)
    if beside.is_file():
        return EditFiles(edit, mesh, beside)
    changed = "" if field is None else f", and {field} is {'another one' if field.is_file() else 'gone'}"
    raise FileNotFoundError(f"{beside}, the field of {mesh}, does not exist{changed}: `dfd distill` makes it")


def describe_edits(edits: Sequence[EditFiles]) -> tuple[EditSource, ...]:
    """Describe the edits, after checking each with its mesh and its field.

    Raises ValueError if an edit does not belong to its mesh, or two have one name; OSError if a file cannot be read.
    """
    sources: list[EditSource] = []
    for edit, mesh, field in edits:
        name = edit.name.removesuffix(".json").removesuffix(".edit")
        if not NAME.fullmatch(name):
            raise ValueError(f"`--edit` must have names of letters, digits, _, - and dots, got {edit.name}")
        if any(name == source.name for source in sources):
            raise ValueError(f"`--edit` must have distinct names, got {name} twice")
        shape = dfd.load(mesh)
        Original.read(edit, shape, Field.load(field, mesh=shape))
        digest = hashlib.sha256(b"".join(path.read_bytes() for path in (edit, mesh, field))).hexdigest()
        sources.append(EditSource(name=name, mesh=f"{name}.original{mesh.suffix.lower()}", sha256=digest))
    return tuple(sources)


def place_edits(folder: BatchFolder, edits: Sequence[EditFiles], sources: Sequence[EditSource]) -> None:
    """Copy what `describe_edits` read into the batch's folder; OSError if it cannot be written."""
    if sources:
        folder.edits.mkdir(exist_ok=True)
    for (edit, mesh, field), source in zip(edits, sources, strict=True):
        there = source_of(folder.edits, source.name, source.mesh)
        for path, copy in zip((mesh, edit, field), there, strict=True):
            if not (copy.is_file() and filecmp.cmp(path, copy, shallow=False)):  # another rank may be reading it
                with atomic_write(copy, "output") as temporary:
                    shutil.copyfile(path, temporary)
