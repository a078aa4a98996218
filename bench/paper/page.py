"""The table, as CSV for programs and as Markdown for people, and the page of pictures."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.paper.compare import METHODS, Row
from bench.paper.handles import Case
from dfd.pictures.before_after import azimuth_towards
from dfd.pictures.picture import picture

__all__ = ["pictures", "to_csv", "to_markdown"]

COLUMNS = ("handle off %", "area %", "angle °", "edge %", "volume %", "flipped faces")
LEGEND = """\
- **handle off**: the largest distance that a handle is from its target, of the diagonal of the box.
- **area**, **angle**, **edge**: mean changes over the surface, of areas and lengths relative ones.
- **volume**: how much the enclosed volume changed; empty where the surface is open.
- **flipped faces**: folded over against the faces around them, and not so at rest.
- **ours** is moved by its handles alone, as in the paper; **ours, fixed points** holds those of the set.
- **ARAP** and **biharmonic** are libigl's over the surface, given handles, fixed points and their neighbors; the paper
  solves the latter within tetrahedra. Shapes of DeepMetaHandles give them all control points, and their own
  coordinates where the set has them.
"""


def to_csv(rows: Sequence[Row]) -> str:
    """One line a shape and method; empty where there is no number."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["shape", "method", *COLUMNS, "note"])
    for row in rows:
        values = ["" if value is None else f"{value:.6g}" for value in _values(row)]
        table.writerow([row.shape, row.method, *values, row.note])
    return text.getvalue()


def to_markdown(rows: Sequence[Row], heading: str) -> str:
    """The same for people, with what the columns mean."""
    lines = ["# The paper's comparisons", "", heading, ""]
    lines += ["| " + " | ".join(["shape", "method", *COLUMNS]) + " |", "|---|---|" + "---:|" * len(COLUMNS)]
    for row in rows:
        values = ["" if value is None else f"{value:.3g}" for value in _values(row)]
        if row.note:
            values = [row.note.replace("|", "/"), *[""] * (len(COLUMNS) - 1)]
        lines.append("| " + " | ".join([row.shape.replace("|", "/"), row.method, *values]) + " |")
    return "\n".join(lines) + "\n\n" + LEGEND


def _values(row: Row) -> list[float | None]:
    if row.missing is None or row.metrics is None:
        return [None] * len(COLUMNS)
    volume = None if row.metrics.volume is None else 100 * row.metrics.volume
    relative = [100 * row.missing, 100 * row.metrics.area, row.metrics.angle, 100 * row.metrics.edge_length]
    return [*relative, volume, row.metrics.flipped_faces]


def pictures(case: Case, rows: Sequence[Row], resolution: int) -> list[tuple[NDArray[np.uint8], str]]:
    """The source and what each of the paper's methods made of it, with one camera, each with its caption.

    Dots are the handles, in the source where they start and else where they are to be; squares are fixed points.
    """
    by_method = {row.method: row for row in rows}
    moved = {name: by_method[name].vertices for name in METHODS}
    frame = [case.mesh.vertices, case.targets, *(each for each in moved.values() if each is not None)]
    fixed = case.mesh.vertices[case.fixed]
    where: dict[str, Any] = {
        "azimuth": azimuth_towards(case.mesh, case.mesh.vertices[case.handles]),
        "frame": frame,
        "fixed": fixed,
        "resolution": resolution,
    }
    drawn = [(picture(case.mesh, handles=case.mesh.vertices[case.handles], **where), "source")]
    for name, vertices in moved.items():
        if vertices is None:
            drawn.append((np.full((resolution, resolution, 3), 255, np.uint8), f"{name}: {by_method[name].note}"))
        else:
            drawn.append((picture(case.mesh, vertices=vertices, handles=case.targets, **where), name))
    return drawn
