"""Fig. 9, 16 and 21: the fifty control points of DeepMetaHandles, by other methods, by one handle of DFD and by all."""

from __future__ import annotations

from functools import partial

import numpy as np

from bench.paper.comparison import compared, dense, methods_of, table
from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.handle_sets import LEGEND
from bench.paper.handles import Case
from bench.paper.report import Page, Section, Table

__all__ = ["page", "page_dense"]

TEXT = (
    "The network of DeepMetaHandles cannot be had. A folder in its layout is taken as it is; without one the control "
    "points are fifty farthest points, and their offsets lengthen the legs, as we chose.\n\n"
)


def page(context: Context) -> Page:
    """Other methods with all control points, DFD with the one that goes farthest."""
    drawn, rows = [], []
    for name, case in dense(context, 2 if context.quick else 12):
        pictures, own = compared(context, name, case, methods_of(context, case, 0.0))
        drawn.append(pictures)
        rows += own
    look_for = "All legs lengthen alike, seat and back stay; DFD needs one handle for it, others fifty."
    return Page(
        "Fig. 9: layouts of DeepMetaHandles (as Fig. 16)",
        look_for,
        [Section("Shapes", TEXT + LEGEND, drawn, table(rows))],
    )


def page_dense(context: Context) -> Page:
    """DFD with all control points as handles."""
    drawn, rows, sums = [], [], []
    for name, case in dense(context, 2 if context.quick else 6):
        methods = {named(preset): partial(_all_handles, context, case, preset, sums, name) for preset in PRESETS}
        pictures, own = compared(context, name, case, methods)
        drawn.append(pictures)
        rows += own
    look_for = (
        "The paper finds shapes reasonable although weights sum to more than 1. By Eq. 1 to the letter they then also "
        "grow about the origin, by that sum; dfd's default prevents it in part."
    )
    sections = [
        Section("Fifty handles", TEXT + LEGEND, drawn, table(rows)),
        Section("Sums of weights", table=Table(["shape", "preset", "mean sum", "largest sum"], sums)),
    ]
    return Page("Fig. 21: dense handles", look_for, sections)


def _all_handles(context: Context, case: Case, preset: str, sums: list[list[object]], name: str) -> np.ndarray:
    shape = Shape("", case.mesh)
    moves = case.held_to - case.mesh.vertices[case.held]
    handles = [{"at": int(at), "translation": move} for at, move in zip(case.held, moves, strict=True)]
    deformer = context.session(shape, context.field(shape, preset), preset, handles)
    total = deformer.weights.sum(axis=1)
    sums.append([name, named(preset), float(total.mean()), float(total.max())])
    return deformer.vertices
