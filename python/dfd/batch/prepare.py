"""The edits of a batch, brought into its folder with the meshes and fields that they were made on."""

from __future__ import annotations

import filecmp
import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path

import dfd
from dfd.batch.folder import BatchFolder
from dfd.batch.inputs import NAME
from dfd.batch.one_edit import Original, field_path
from dfd.batch.settings import EditSource
from dfd.batch.steps import source_of
from dfd.common.files import atomic_write
from dfd.field.field import Field

__all__ = ["EditFiles", "describe_edits", "place_edits"]

EditFiles = tuple[Path, Path]  # an edit, and the mesh that it was made on


def describe_edits(edits: Sequence[EditFiles]) -> tuple[EditSource, ...]:
    """Say what the edits are, once each is read together with its mesh and its field.

    Raises
    ------
    ValueError
        If an edit does not belong to its mesh, or two have one name.
    OSError
        If a file cannot be read; the field is looked for beside the mesh, as NAME.field.safetensors.
    """
    sources: list[EditSource] = []
    for edit, mesh in edits:
        name = edit.name.removesuffix(".json").removesuffix(".edit")
        if not NAME.fullmatch(name):
            raise ValueError(f"batch: `edits` must have names of letters, digits, _, - and dots, got {edit.name}")
        if any(name == source.name for source in sources):
            raise ValueError(f"batch: `edits` must have distinct names, got {name} twice")
        shape = dfd.load(mesh)
        Original.read(edit, shape, Field.load(field_path(mesh), mesh=shape))
        digest = hashlib.sha256(b"".join(path.read_bytes() for path in (edit, mesh, field_path(mesh)))).hexdigest()
        sources.append(EditSource(name=name, mesh=f"{name}.original{mesh.suffix.lower()}", sha256=digest))
    return tuple(sources)


def place_edits(folder: BatchFolder, edits: Sequence[EditFiles], sources: Sequence[EditSource]) -> None:
    """Copy what `describe_edits` read into the batch's folder.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    if sources:
        folder.edits.mkdir(exist_ok=True)
    for (edit, mesh), source in zip(edits, sources, strict=True):
        there = source_of(folder.edits, source.name, source.mesh)
        for path, place in zip((mesh, edit, field_path(mesh)), there, strict=True):
            if not (place.is_file() and filecmp.cmp(path, place, shallow=False)):  # another rank may be reading it
                with atomic_write(place, "output") as temporary:
                    shutil.copyfile(path, temporary)
