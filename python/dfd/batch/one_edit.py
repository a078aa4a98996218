"""Transferring one edit to many shapes by feature similarity; where it does not fit, a shape is refused."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from dfd.common import check
from dfd.common.files import sha256_of_files
from dfd.editing.agreement import agreements
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit
from dfd.editing.edit_file import read_edit, read_made_on
from dfd.editing.transfer import transfer
from dfd.field.field import Field, FieldSource
from dfd.mesh.mesh import Mesh, load

LEAST = 0.5  # confidence: below it, another part is likelier
# Least cosine of features between a handle and a similar region on another shape. Measured for a handle on a chair's
# leg: 0.40 to 0.71 for legs of other seats and of a nightstand, 0.42 for a table's foot, 0.29 to 0.34 for a bird.
# A learned metric sets shapes farther apart: 0.26 to 0.65 for legs of seats, 0.06 to 0.28 for animals without legs.
SIMILAR, SIMILAR_LEARNED = 0.45, 0.25


@dataclass(frozen=True)
class Original:
    """An edit and the shape that it was made on."""

    edit: Edit  # in the units of `mesh`
    mesh: Mesh
    field: Field

    @cached_property
    def session(self) -> Deformer:
        """Return a session of the edit on its own shape."""
        session = Deformer(self.mesh, self.field, other_shape=True)
        session.apply(self.edit)
        return session

    @classmethod
    def read(cls, path: str | os.PathLike[str], mesh: Mesh, field: Field) -> Original:
        """Read the edit in `path`, made on `mesh`.

        Raises OSError if `path` cannot be read. Raises ValueError if it is no edit of the shape, or has no handle.
        """
        edit = read_edit(path, mesh)
        if not edit.handles:
            raise ValueError(f"{os.fspath(path)}: `handles` must hold a handle: the edit moves nothing")
        return cls(edit, mesh, field)


class UnlikeError(ValueError):
    """The other shape lacks the part of a handle; `confidence` maps the names of all handles to their confidence."""

    def __init__(self, message: str, confidence: Mapping[str, float]) -> None:
        super().__init__(message)
        self.confidence = dict(confidence)


@dataclass(frozen=True)
class Carried:
    """An edit transferred to another shape."""

    deformer: Deformer  # a session of the other shape with the edit
    # Confidence in [0, 1] by name: how likely a handle moves the same part (`dfd.editing.agreement`), and how similar a
    # fixed point looks (`dfd.editing.transfer`).
    confidence: dict[str, float]
    unsure: tuple[str, ...] = ()  # those below the threshold, carried by `force`


def carry(
    original: Original,
    mesh: Mesh,
    field: Field,
    *,
    threshold: float | None = None,
    force: bool = False,
    features: Any = None,
) -> Carried:
    """Transfer an edit to another shape of its class; for its own shape it is unchanged.

    `field` is that of the other shape, by the same encoder; `features` are as `Deformer` takes them. `threshold`, in
    [0, 1] and by default 0.5, is the least confidence. With `force`, handles below it are transferred too, and listed
    in `Carried.unsure`; a field of another shape is accepted as well.

    Raises UnlikeError if a confidence is below `threshold` without `force`; ValueError as `transfer` and `Deformer`.
    """
    lowest = check.number("carry", "threshold", LEAST if threshold is None else threshold, minimum=0.0, maximum=1.0)
    similar = SIMILAR if field.settings.get("metric", "none") == "none" else SIMILAR_LEARNED
    edit = original.edit
    names = [handle.name or f"handle {handle.id}" for handle in edit.handles]
    names += [f"fixed {number}" for number in range(1, 1 + len(edit.fixed))]
    sure = [1.0] * len(names)
    deformer = Deformer(mesh, field, features=features, other_shape=force)
    if mesh.content_hash == original.mesh.content_hash:
        deformer.apply(edit)
    else:
        found = transfer(edit, original.mesh, original.field, mesh, field)
        deformer.apply(found.edit)
        looks = [*(found.similarity[handle.id] for handle in edit.handles), *found.fixed_similarity]
        sure = [min(LEAST * each / similar, 1.0) for each in looks]
        for number, likely in enumerate(agreements(original.session, deformer)):
            sure[number] = likely if sure[number] >= LEAST else min(sure[number], likely)
    confidence = dict(zip(names, sure, strict=True))
    least = min(confidence, key=confidence.__getitem__)
    if confidence[least] < lowest and not force:
        raise UnlikeError(
            f"what {least} holds there is not the part that it held: confidence {confidence[least]:.2f}, "
            f"asked for {lowest:.2f}",
            confidence,
        )
    return Carried(deformer, confidence, tuple(name for name in names if confidence[name] < lowest))


def field_path(mesh: Path, folder: Path | None = None) -> Path:
    """Return the default path of a mesh file's field: next to the mesh or in `folder`, with the mesh's name."""
    return (mesh.parent if folder is None else folder) / f"{mesh.stem}.field.safetensors"


class EditSource(BaseModel):
    """An edit for every shape, with the mesh and the field that it was made on; all paths are absolute."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    edit: Path
    mesh: Path
    field: Path
    sha256: str  # of the three files together

    def original(self) -> Original:
        """Read all three; raises as `Original.read` and `Field.load`."""
        mesh = load(self.mesh)
        return Original.read(self.edit, mesh, Field.load(self.field, mesh=mesh))


def find_files(edit: Path, made_on: Path | None = None) -> EditSource:
    """Find the files of an edit: the given mesh or the one it names; the field it names or the one next to the mesh.

    Raises ValueError if `edit` is no edit, or no mesh is known. Raises OSError if a file is missing or unreadable.
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
    own = field if field is not None and field.is_file() and sha256 in (None, FieldSource.of(field).sha256) else beside
    if not own.is_file():
        changed = "" if field is None else f", and {field} is {'another one' if field.is_file() else 'gone'}"
        raise FileNotFoundError(f"{own}, the field of {mesh}, does not exist{changed}: `dfd distill` makes it")
    name = edit.name.removesuffix(".json").removesuffix(".edit")
    files = {"edit": edit.absolute(), "mesh": mesh.absolute(), "field": own.absolute()}
    return EditSource(name=name, **files, sha256=sha256_of_files(*files.values()))
