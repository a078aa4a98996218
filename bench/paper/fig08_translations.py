"""Fig. 8: one handle translated without fixed points, beside methods that need constraints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.paper.compare import Row, compare
from bench.paper.comparison import pulls, table
from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.drawing import aim, blank, heat, silhouettes
from bench.paper.handle_sets import LEGEND, methods_of
from bench.paper.handles import Case
from bench.paper.report import Page, Section
from dfd.pictures.picture import picture

__all__ = ["page"]


def page(context: Context) -> Page:
    """The cases of APAP-Bench where the folder given has them, else pulls of our own."""
    drawn, rows = [], []
    for name, case in pulls(context, 2 if context.quick else 6):
        own = compare(name, case, methods_of(context, case))
        rows += own
        drawn.append((name, _pictures(context, case, own)))
    text = (
        "A dot is the handle, where it starts; squares are fixed points, which only the other methods need. Blue: the "
        "outline before; green: after.\n\n" + LEGEND
    )
    look_for = "Both ears, all legs go along with the one that is pulled, and nothing else moves or turns."
    return Page("Fig. 8: translations beside other methods", look_for, [Section("Pulls", text, drawn, table(rows))])


def _pictures(context: Context, case: Case, rows: list[Row]) -> list[tuple[NDArray[np.uint8], str]]:
    source = case.mesh.vertices[case.handles]
    moved = [row.vertices for row in rows if row.vertices is not None]
    where = aim(case.mesh, source, case.targets, *moved)
    fixed = case.mesh.vertices[case.fixed]
    drawn = [(picture(case.mesh, handles=source, fixed=fixed, **where), "source")]
    shape, handles = Shape("", case.mesh), [{"at": int(handle)} for handle in case.handles]
    of_preset = {named(preset): preset for preset in PRESETS}
    for row in rows:
        if row.method.endswith("fixed points"):
            continue
        if row.vertices is not None and (preset := of_preset.get(row.method)):
            follows = context.session(shape, context.field(shape, preset), preset, handles).following.max(axis=1)
            drawn.append((heat(case.mesh, follows, case.handles, **where), f"{row.method}: weights"))
        image = blank() if row.vertices is None else silhouettes(case.mesh, row.vertices, where)
        drawn.append((image, f"{row.method}: {row.note}" if row.note else row.method))
    return drawn
