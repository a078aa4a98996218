"""What an edit did to a shape, in numbers and in a sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dfd.app.protocol.answers import ReportMessage

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["report"]

# Of the box's diagonal: less is no motion that anyone would see.
SEEN = 1e-4


def report(deformer: Deformer) -> ReportMessage:
    """How much moved, how far, and whether the handles arrived where they were sent."""
    mesh = deformer.mesh
    posed = deformer.vertices
    if posed is mesh.vertices:
        return ReportMessage(moved=0.0, largest=0.0, missed=0.0, text="Nothing has moved")
    squared = np.zeros(len(posed))
    for axis in range(3):
        squared += np.square(posed[:, axis] - mesh.vertices[:, axis])
    lengths = np.sqrt(squared, out=squared)
    moved, largest = float((lengths > SEEN * mesh.diagonal).mean()), float(lengths.max())
    missed = 0.0
    for handle in deformer.handles:
        if handle.place.vertex is not None and not handle.transform.rests:
            goal = handle.matrix @ np.array([*handle.place.position, 1.0])
            missed = max(missed, float(np.linalg.norm(posed[handle.place.vertex] - goal)))
    if moved == 0:
        return ReportMessage(moved=moved, largest=largest, missed=missed, text="Nothing has moved")
    one = sum(not handle.transform.rests for handle in deformer.handles) == 1
    arrived = "the handle arrived" if one else "all handles arrived"
    if missed > SEEN * mesh.diagonal:
        arrived = f"{'the handle' if one else 'a handle'} missed its place by {missed:.3g}"
    percent = f"{100 * moved:.0f} %" if moved >= 0.01 else f"{100 * moved:.2g} %"
    text = f"Moved {percent} of the vertices by up to {largest:.3g}; {arrived}"
    return ReportMessage(moved=moved, largest=largest, missed=missed, text=text)
