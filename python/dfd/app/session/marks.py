"""Marks: vertices of the shape, and the positions at which they must arrive. A fit moves the handles accordingly."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from pydantic import TypeAdapter, ValidationError

from dfd.app.protocol import messages
from dfd.common.check import recorded_warnings
from dfd.editing.deformer import Deformer
from dfd.editing.edit import Edit

MARKS = TypeAdapter[tuple[messages.Mark, ...]](messages.Marks)


@dataclass(frozen=True, repr=False)
class MarkedEdit(Edit):
    """An edit with the marks of the page. Undo also takes back marks, but edit files do not contain them."""

    marks: tuple[messages.Mark, ...] = ()


def replace_marks(deformer: Deformer, given: Sequence[messages.Mark], fits: bool) -> str | None:
    """Replace the marks; if `fits`, fit the handles that move a mark. A mark without a target gets its present place.

    Return what the fit warned of.

    Raises ValueError if the mesh lacks a vertex, or no handle moves a mark.
    """
    vertices = np.array([mark.vertex for mark in given], np.int64)
    if missing := vertices[vertices >= len(deformer.mesh.vertices)].tolist():
        raise ValueError(f"There is no vertex {missing[0]}")
    here = deformer.vertices[vertices].tolist()
    marks = tuple(
        messages.Mark(vertex=mark.vertex, target=mark.target or tuple(place))
        for mark, place in zip(given, here, strict=True)
    )
    said = None
    if fits:
        moved = np.flatnonzero(np.any(deformer.following[vertices], axis=0))
        handles = [deformer.handles[index].id for index in moved]
        targets = {mark.vertex: mark.target for mark in marks}
        with recorded_warnings() as warnings:
            deformer.fit(targets, handles=handles or None)
        said = ". ".join(str(each).partition(": ")[2] for each in warnings).replace("`targets`", "The marks") or None
    deformer.apply(MarkedEdit(**{**vars(deformer.edit), "marks": marks}))
    return said


def marks_in(edit: Edit) -> tuple[messages.Mark, ...]:
    """Return the marks of an edit."""
    return edit.marks if isinstance(edit, MarkedEdit) else ()


def marks_text(edit: Edit) -> str:
    """Return the marks of an edit as JSON."""
    return MARKS.dump_json(marks_in(edit)).decode()


def with_marks(edit: Edit, text: str) -> Edit:
    """Return an edit with the marks that `marks_text` wrote; without marks, or if the text is damaged, `edit`."""
    with suppress(ValidationError):
        if marks := MARKS.validate_json(text):
            return MarkedEdit(**{**vars(edit), "marks": marks})
    return edit


def marks_of(deformer: Deformer) -> tuple[messages.MarkState, ...]:
    """Return the marks of the present edit, with the distances from their targets."""
    marks = marks_in(deformer.edit)
    posed = deformer.vertices if marks else deformer.mesh.vertices
    return tuple(
        messages.MarkState(
            **dict(mark),
            position=tuple(deformer.mesh.vertices[mark.vertex].tolist()),
            missing=float(np.linalg.norm(posed[mark.vertex] - mark.target)),
        )
        for mark in marks
    )
