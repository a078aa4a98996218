"""Fig. 8: one handle translated without fixed points, beside methods that need constraints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.paper.compare import COLUMNS, Row, compare
from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.drawing import aim, blank, heat, silhouettes
from bench.paper.handle_sets import LEGEND, methods_of
from bench.paper.handles import Case, find
from bench.paper.report import Page, Section, Table
from dfd.pictures.picture import picture

__all__ = ["page"]


@dataclass(frozen=True)
class Pull:
    """A handle, how far it goes in diagonals of the box, and what other methods hold: from 0 to 1 along the box."""

    handle: tuple[float, float, float]
    offset: tuple[float, float, float]
    fixed: tuple[tuple[float, float, float], ...]


FEET = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
CASES = {
    "spot": Pull((0.0, 0.9, 0.3), (-0.12, 0.05, 0.0), FEET),
    "kaykit_chair_A": Pull((0.0, 0.0, 1.0), (0.0, -0.15, 0.0), ((0.2, 1.0, 0.0), (0.8, 1.0, 0.0))),
    "koala": Pull((0.0, 0.95, 0.75), (-0.08, 0.08, 0.0), FEET),
    "scorpion": Pull((0.0, 0.2, 1.0), (-0.05, 0.0, 0.1), ((0.5, 0.0, 0.5), (0.5, 0.9, 0.2))),
    "plane_holes": Pull((0.0, 0.2, 0.4), (-0.1, 0.1, 0.0), ((0.5, 0.5, 0.5), (1.0, 0.5, 0.5))),
    "chair": Pull((0.0, 0.0, 1.0), (0.0, -0.15, 0.0), ((0.2, 1.0, 0.0), (0.8, 1.0, 0.0))),
    "quadruped": Pull((0.2, 1.0, 0.9), (0.0, 0.12, 0.0), FEET),
    "*": Pull((0.5, 1.0, 0.5), (0.0, 0.15, 0.0), FEET),
}


def page(context: Context) -> Page:
    """The cases of APAP-Bench where the folder given has them, else pulls of our own."""
    drawn, rows = [], []
    for name, case in _cases(context):
        own = compare(name, case, methods_of(context, case))
        rows += [[row.shape, row.method, *row.values, row.note] for row in own]
        drawn.append((name, _pictures(context, case, own)))
    text = (
        "A dot is the handle, where it starts; squares are fixed points, which only the other methods need. Blue: the "
        "outline before; green: after.\n\n" + LEGEND
    )
    look_for = "Both ears, all legs go along with the one that is pulled, and nothing else moves or turns."
    table = Table(["shape", "method", *COLUMNS, "note"], rows)
    return Page("Fig. 8: translations beside other methods", look_for, [Section("Pulls", text, drawn, table)])


def _cases(context: Context) -> list[tuple[str, Case]]:
    if context.folder is not None:
        try:
            return [(found.name, found.read()) for found in find(context.folder)]
        except ValueError as error:
            context.say(f"No sets of handles: {error}")
    shapes = context.cases(CASES, most=2 if context.quick else 6)
    return [(shape.name, _pulled(shape.refined(), pull)) for shape, pull in shapes]


def _pulled(shape: Shape, pull: Pull) -> Case:
    vertices = shape.mesh.vertices
    handle = shape.at(pull.handle)
    fixed = np.array(list(dict.fromkeys(shape.at(point) for point in pull.fixed)), np.int64)
    target = vertices[[handle]] + np.array([pull.offset]) * shape.mesh.diagonal
    held = np.concatenate([[handle], fixed])
    return Case(shape.mesh, np.array([handle]), target, fixed, held, np.concatenate([target, vertices[fixed]]))


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
