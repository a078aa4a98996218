"""Fig. 5: symmetry that is seen, not measured: planes of shapes that are posed, and edits of one side."""

from __future__ import annotations

import numpy as np

import dfd
from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim, before_after, silhouettes
from bench.paper.report import Page, Section, Table
from dfd.editing.presets import PRESETS as DEFAULTS
from dfd.pictures.picture import picture

__all__ = ["page"]

# A handle on one side, from 0 to 1 along the box, and where it goes, in diagonals.
CASES = {
    "scorpion": ((0.0, 0.2, 1.0), (-0.08, 0.04, 0.04)),
    "human_neutral": ((1.0, 0.75, 0.5), (0.02, 0.12, 0.05)),
    "koala": ((0.0, 0.95, 0.75), (-0.08, 0.08, 0.0)),
    "spot": ((0.1, 1.0, 0.4), (-0.08, 0.05, 0.0)),
    "quadruped": ((0.2, 1.0, 0.9), (-0.08, 0.08, 0.0)),
    "*": ((1.0, 0.5, 0.5), (0.1, 0.0, 0.0)),
}


def page(context: Context) -> Page:
    """The planes found by both presets, and one handle with and without them."""
    drawn, rows = [], []
    for given, (at, offset) in context.cases(CASES, most=2 if context.quick else 4):
        shape = given.refined()
        for preset in PRESETS:
            field = context.field(shape, preset)
            own = DEFAULTS[preset]
            planes = dfd.symmetry_planes(field, shape.mesh, threshold=own.threshold, candidates=own.candidates)
            every = dfd.symmetry_planes(field, shape.mesh, threshold=2.0, candidates="axes")
            for plane in every or planes:
                found = any(np.allclose(plane.normal, each.normal, atol=1e-3) for each in planes)
                rows.append(
                    [shape.name, named(preset), str(np.round(plane.normal, 2)), plane.score, "yes" if found else ""]
                )
            handles = [{"at": shape.at(at), "translation": np.array(offset) * shape.mesh.diagonal}]
            alone = context.session(shape, field, preset, handles)
            both = context.session(shape, field, preset, handles, symmetric=True)
            where = aim(shape.mesh, shape.mesh.vertices[[shape.at(at)]], alone.vertices, both.vertices)
            row = [(picture(shape.mesh, **where), "source")]
            if planes:
                side = shape.mesh.vertices @ np.array(planes[0].normal) - planes[0].offset
                row.append((picture(shape.mesh, weights=(side > 0).astype(float), **where), "sides of the plane"))
            row += before_after(both, where)[:1]
            row.append((silhouettes(shape.mesh, alone.vertices, where), "one handle"))
            row.append(
                (silhouettes(shape.mesh, both.vertices, where), "with the plane" if planes else "no plane found")
            )
            drawn.append((f"{shape.name}, {named(preset)}", row))
    text = (
        f"The score is the mean distance between the features of a vertex and of its mirror image. The paper takes "
        f"coordinate planes with a score below ε = {DEFAULTS['paper'].threshold:g}; the default also looks for others."
    )
    look_for = "The plane divides the shape as a person would, though its pose is not symmetric, and both sides follow."
    table = Table(["shape", "preset", "normal", "score", "found"], rows)
    return Page("Fig. 5: visual symmetry", look_for, [Section("Planes and edits", text, drawn, table)])
