"""What an edit did to a shape, in numbers and in a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dfd.app.protocol.answers import ReportMessage

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["report"]


def report(deformer: Deformer) -> ReportMessage:
    """How much moved, how far, and whether the handles arrived where they were sent."""
    if not deformer.handles and deformer.default is None:
        return ReportMessage(moved=0.0, largest=0.0, missed=0.0, text="Nothing has moved")
    found = deformer.report()
    text = str(found)
    return ReportMessage(
        moved=found.moved,
        largest=found.farthest,
        missed=max((handle.missing for handle in found.handles), default=0.0),
        text=text[:1].upper() + text[1:],
    )
