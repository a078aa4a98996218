"""All cases of a folder in the layouts of APAP-Bench 3D and DeepMetaHandles, by every method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bench.paper.compare import COLUMNS, Row, compare
from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim, blank
from bench.paper.handles import Case, find
from bench.paper.methods import others
from bench.paper.report import Page, Section, Table
from dfd.pictures.picture import picture

__all__ = ["methods_of", "page", "pictures"]

LEGEND = """\
- **handle off**: the largest distance that a handle is from its target, of the diagonal of the box.
- **area**, **angle**, **edge**: mean changes over the surface, of areas and lengths relative ones.
- **volume**: how much the enclosed volume changed; empty where the surface is open.
- **flipped faces**: folded over against the faces around them, and not so at rest.
- DFD is moved by its handles alone, as in the paper; **fixed points** holds those of the set.
- Other methods are given handles, fixed points and their neighbors. **biharmonic** (coordinates) and **BBW** work
  within tetrahedra of fTetWild, of the shape simplified to 6,000 faces; **NeuralMLS** is written from its paper. Shapes
  of DeepMetaHandles give them all control points, and their own coordinates where the set has them. The networks of
  APAP and DeepMetaHandles cannot be had."""


def page(context: Context) -> Page:
    """Compare all cases of the folder; ValueError or OSError if it holds none."""
    if context.folder is None:
        raise ValueError("handles: give the folder of the set, as `python -m bench.paper handles FOLDER`")
    rows: list[Row] = []
    drawn = []
    failed = 0
    for found in find(context.folder):
        context.say(found.name)
        try:
            case = found.read()
        except (ValueError, OSError) as error:
            failed += 1
            rows.append(Row(found.name, "", note=" ".join(str(error).split())))
            context.say(f"  {error}")
            continue
        own = compare(found.name, case, methods_of(context, case))
        rows += own
        drawn.append((found.name, pictures(case, own)))
    table = Table(
        ["shape", "method", *COLUMNS, "note"], [[row.shape, row.method, *row.values, row.note] for row in rows]
    )
    look_for = "Parts that look like the one that is pulled follow it, and nothing else moves."
    sections = [Section("Results", LEGEND, drawn, table)]
    return Page("The paper's comparisons on sets of handles", look_for, sections, failed=failed)


def methods_of(context: Context, case: Case) -> dict[str, Callable[[], NDArray[np.float64]]]:
    """Every method by its name, ready to be called on `case`."""
    methods: dict[str, Callable[[], NDArray[np.float64]]] = {}
    for preset in PRESETS:
        methods[named(preset)] = partial(context.solve, case, preset)
        if len(case.fixed):
            methods[f"{named(preset)}, fixed points"] = partial(context.solve, case, preset, fixed=True)
    return {**methods, **others(case, context.ball)}


def pictures(case: Case, rows: Sequence[Row]) -> list[tuple[NDArray[np.uint8], str]]:
    """The source and what each method made of it, with one camera, each with its caption.

    Dots are the handles, in the source where they start and else where they are to be; squares are fixed points.
    """
    moved = [row.vertices for row in rows if row.vertices is not None]
    source = case.mesh.vertices[case.handles]
    where = aim(case.mesh, source, case.targets, *moved, fixed=case.mesh.vertices[case.fixed])
    drawn = [(picture(case.mesh, handles=source, **where), "source")]
    for row in rows:
        if row.vertices is None:
            drawn.append((blank(), f"{row.method}: {row.note}"))
        else:
            drawn.append((picture(case.mesh, vertices=row.vertices, handles=case.targets, **where), row.method))
    return drawn
