"""Fig. 22: what every method does to the surface, in four measures of distortion."""

from __future__ import annotations

from bench.paper.comparison import compared, methods_of, pulls, table
from bench.paper.context import Context
from bench.paper.handle_sets import LEGEND
from bench.paper.report import Page, Section

__all__ = ["page"]


def page(context: Context) -> Page:
    """Two pulls, with pictures."""
    drawn, rows = [], []
    for name, case in pulls(context, 2):
        pictures, own = compared(context, name, case, methods_of(context, case, context.ball))
        drawn.append(pictures)
        rows += own
    text = (
        "Area, angle, edge and volume are the measures of Implicit-ARAP, in which the paper reports its deformations; "
        "it says that DFD distorts more by all four.\n\n" + LEGEND
    )
    look_for = (
        "A method that distorts least is not the one that looks most natural: compare the pictures with the table."
    )
    return Page("Fig. 22: surface metrics", look_for, [Section("Two deformations", text, drawn, table(rows))])
