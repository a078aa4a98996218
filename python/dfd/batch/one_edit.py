"""Transfer one edit to many shapes by the similarity of features, and refuse shapes without the edited parts."""

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
from dfd.editing.agreement import agreements, reason
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit
from dfd.editing.edit_file import read_edit, read_made_on
from dfd.editing.transfer import transfer
from dfd.field.field import Field, FieldSource
from dfd.mesh.mesh import Mesh, load

CONFIDENT = 0.5  # the default threshold; below this confidence, a handle probably moves another part
# If the cosine between a handle's features on both shapes is SIMILAR, the confidence is 0.5. For fields with a learned
# metric, SIMILAR_LEARNED replaces SIMILAR, because this metric increases differences between shapes. Without a learned
# metric, cosines between legs of different seats were 0.40 to 0.71, and between a chair's leg and a bird at most 0.34.
SIMILAR, SIMILAR_LEARNED = 0.45, 0.25


@dataclass(frozen=True)
class Original:
    """An edit, and the mesh and the field on which it was made."""

    edit: Edit  # in the units of `mesh`
    mesh: Mesh
    field: Field

    @cached_property
    def session(self) -> Deformer:
        """Return a session with the edit on its own shape."""
        session = Deformer(self.mesh, self.field, other_shape=True)
        session.apply(self.edit)
        return session

    @classmethod
    def read(cls, path: str | os.PathLike[str], mesh: Mesh, field: Field) -> Original:
        """Read the edit in the file `path`, which was made on `mesh`.

        Raises OSError if `path` cannot be read. Raises ValueError if it is no edit of this shape, or has no handle.
        """
        edit = read_edit(path, mesh)
        if not edit.handles:
            raise ValueError(f"{os.fspath(path)}: `handles` must hold a handle: the edit moves nothing")
        return cls(edit, mesh, field)


class UnlikeError(ValueError):
    """The target shape probably lacks one of the edited parts. `confidence` is as in `Carried`."""

    def __init__(self, message: str, confidence: Mapping[str, float]) -> None:
        super().__init__(message)
        self.confidence = dict(confidence)


@dataclass(frozen=True)
class Carried:
    """An edit transferred to another shape."""

    deformer: Deformer  # a session of the other shape with the edit
    # Confidence of each handle and fixed point, 0 to 1, by name. For a handle, it is at most the probability that the
    # handle moves the same part (`dfd.editing.agreement`). A fixed point's confidence grows with the features' cosine.
    confidence: dict[str, float]


def carry(
    original: Original, mesh: Mesh, field: Field, *, threshold: float | None = None, features: Any = None
) -> Carried:
    """Transfer an edit to another shape of the same class. If `mesh` is the mesh of the edit, the edit stays unchanged.

    `field` is the field of the other shape, made with the same encoder. `features` are as in `Deformer`. `threshold`,
    in [0, 1] and by default 0.5, is the smallest accepted confidence.

    Raises UnlikeError if a confidence is below `threshold`. Raises ValueError if `transfer` or `Deformer` raises it.
    """
    lowest = check.number("carry", "threshold", CONFIDENT if threshold is None else threshold, minimum=0.0, maximum=1.0)
    similar = SIMILAR if field.settings.get("metric", "none") == "none" else SIMILAR_LEARNED
    edit = original.edit
    names = [handle.name or f"handle {handle.id}" for handle in edit.handles]
    names += [f"fixed {number}" for number in range(1, 1 + len(edit.fixed))]
    sure, looks, unlike = [1.0] * len(names), [1.0] * len(names), [False] * len(names)
    deformer = Deformer(mesh, field, features=features)
    if mesh.content_hash == original.mesh.content_hash:
        deformer.apply(edit)
    else:
        parts = original.session.bound.parts, deformer.bound.parts
        found = transfer(edit, original.mesh, original.field, mesh, field, parts=parts)
        deformer.apply(found.edit)
        looks = [*(found.similarity[handle.id] for handle in edit.handles), *found.fixed_similarity]
        sure = [min(CONFIDENT * each / similar, 1.0) for each in looks]
        unlike = [each < CONFIDENT for each in sure]
        for number, likely in enumerate(agreements(original.session, deformer)):
            sure[number] = min(sure[number], likely) if unlike[number] else likely
    confidence = dict(zip(names, sure, strict=True))
    least = min(confidence, key=confidence.__getitem__)
    if confidence[least] < lowest:
        number = sure.index(confidence[least])
        if number < len(edit.handles) and not unlike[number]:
            why = reason(original.session, deformer, number)
        else:
            why = f"its features are too different, with a similarity of {looks[number]:.2f}"
        raise UnlikeError(
            f"{least} may be on a wrong part of this shape: confidence {confidence[least]:.2f} is below {lowest:.2f}, "
            f"because {why}",
            confidence,
        )
    return Carried(deformer, confidence)


def field_path(mesh: Path) -> Path:
    """Return the default path of a mesh file's field: next to the mesh, with the mesh's name."""
    return mesh.with_name(f"{mesh.stem}.field.safetensors")


class EditSource(BaseModel):
    """The file of an edit, and the files of the mesh and the field on which it was made. All paths are absolute."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    edit: Path
    mesh: Path
    field: Path
    sha256: str  # SHA-256 of the three files together

    def original(self) -> Original:
        """Read the three files. Raise the errors of `Original.read` and `Field.load`."""
        mesh = load(self.mesh)
        return Original.read(self.edit, mesh, Field.load(self.field, mesh=mesh))


def find_files(edit: Path, made_on: Path | None = None) -> EditSource:
    """Find the mesh and the field on which an edit was made. `made_on` replaces the mesh that the edit names.

    If the edit names this mesh and an unchanged field, this field is used. Otherwise, the field is the file
    `field_path(mesh)`.

    Raises ValueError if `edit` is no edit, or no mesh is known. Raises OSError if a file is missing or unreadable.
    """
    named, field, sha256 = read_made_on(edit)
    mesh = named if made_on is None else made_on
    if mesh is None:
        raise ValueError(f"`--made-on` must name the mesh that {edit} was made on: the edit does not name it")
    if not mesh.is_file():
        hint = "" if made_on is not None else ": `--made-on` must say where it is now"
        raise FileNotFoundError(f"{mesh}, on which {edit} was made, does not exist{hint}")
    beside = field_path(mesh)
    if named is None or not (named.is_file() and named.samefile(mesh)):
        field = None  # the field that the edit names belongs to another mesh
    own = field if field is not None and field.is_file() and sha256 in (None, FieldSource.of(field).sha256) else beside
    if not own.is_file():
        changed = "" if field is None else f", and {field} {'has changed' if field.is_file() else 'is missing'}"
        raise FileNotFoundError(f"{own}, the field of {mesh}, does not exist{changed}: `dfd distill` makes it")
    name = edit.name.removesuffix(".json").removesuffix(".edit")
    files = {"edit": edit.absolute(), "mesh": mesh.absolute(), "field": own.absolute()}
    return EditSource(name=name, **files, sha256=sha256_of_files(*files.values()))
