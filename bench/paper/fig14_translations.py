"""Fig. 14 and 15: pulls of one handle by every method, with and without the neighbors of its constraints."""

from __future__ import annotations

from dataclasses import replace

from bench.paper.comparison import compared, methods_of, pulls, table
from bench.paper.context import Context
from bench.paper.handle_sets import LEGEND
from bench.paper.report import Page, Section

__all__ = ["page", "page_without_neighbors"]

# What the paper's studies found of such pictures (Sec. 4.2 and K), of users, per cent.
STUDIES = (
    "DFD-T 82 % and DFD-A 79 % among the best two of six; 64 % the most realistic of five (ARAP 17.7, NeuralMLS 15.2,\
 biharmonic 2.2, APAP 0.93)"
)
TEXT = (
    "Blue dots are handles, green ones their targets, squares fixed points for the other methods; blue is the "
    f"outline before, green after. The paper's users chose {STUDIES}.\n\n"
)


def page(context: Context) -> Page:
    """Every pull, other methods given all within the ball."""
    return _page(context, f"Fig. 14: one handle, others with a ball of {context.ball:g}", "with neighbors")


def page_without_neighbors(context: Context) -> Page:
    """Every pull, other methods given the points alone."""
    return _page(replace(context, ball=0.0), "Fig. 15: one handle, others without neighbors", "points alone")


def _page(context: Context, title: str, heading: str) -> Page:
    drawn, rows = [], []
    for name, case in pulls(context, 2 if context.quick else 10):
        pictures, own = compared(context, name, case, methods_of(context, case, context.ball))
        drawn.append(pictures)
        rows += own
    look_for = (
        "Parts that look like the one that is pulled follow it; other methods tilt the shape or draw out a spike."
    )
    return Page(title, look_for, [Section(heading.capitalize(), TEXT + LEGEND, drawn, table(rows))])
