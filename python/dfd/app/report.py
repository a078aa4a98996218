"""What an edit did to a shape, in numbers and in a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dfd.app.protocol.answers import ReportMessage

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["check_drawable", "report"]

LARGEST = 1e30  # graphics have 32-bit numbers, and multiply them with coordinates


def check_drawable(deformer: Deformer) -> None:
    """Refuse, before anything is told of it, what no page could draw.

    Raises
    ------
    ValueError
        If a number of a handle's transform, mesh units, is beyond 1e30.
    """
    for handle in deformer.handles:
        size = float(np.abs(handle.matrix).max())
        if size > LARGEST:
            raise ValueError(f"The transform of handle {handle.id} must stay below {LARGEST:g}, got {size:.3g}")


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
