"""Fig. 6: a fixed point holds all that looks like it (Eq. 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import dfd
from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim, before_after
from bench.paper.report import Page, Section, Table
from dfd.pictures.picture import picture

__all__ = ["page"]

ALIKE = 0.5  # the paper's weight (Eq. 4) above which a vertex counts as alike to the fixed point


@dataclass(frozen=True)
class Twist:
    """Where a shape is turned, where it is held, both from 0 to 1 along the sides of its box, and how."""

    handle: tuple[float, float, float]
    fixed: tuple[float, float, float]
    rotation: tuple[float, float, float]


CASES = {
    "robot": Twist((0.5, 0.62, 1.0), (0.25, 0.0, 1.0), (0, 50, 0)),
    "human_neutral": Twist((0.5, 0.75, 1.0), (0.45, 0.0, 1.0), (0, 50, 0)),
    "kaiju": Twist((0.5, 0.6, 0.8), (0.3, 0.0, 0.7), (0, 50, 0)),
    "*": Twist((0.5, 0.7, 1.0), (0.5, 0.0, 1.0), (0, 50, 0)),
}


def page(context: Context) -> Page:
    """Each shape twisted without and with a fixed point."""
    drawn, rows = [], []
    for shape, case in context.cases(CASES, most=2 if context.quick else 3):
        at, held = shape.at(case.handle), shape.at(case.fixed)
        middle = shape.mesh.bounds.mean(axis=0)
        handle = {"at": at, "rotation": case.rotation, "pivot": middle}
        for preset in PRESETS:
            field = context.field(shape, preset)
            free = context.session(shape, field, preset, [handle])
            fixed = context.session(shape, field, preset, [handle], fixed=[held])
            where = aim(shape.mesh, shape.mesh.vertices[[at]], free.vertices, fixed.vertices)
            source = picture(shape.mesh, handles=[at], fixed=[held], **where)
            drawn.append(
                (
                    f"{shape.name}, {named(preset)}",
                    [(source, "handle and fixed point"), *before_after(free, where), *before_after(fixed, where)],
                )
            )
            alike = dfd.bind(field.features(shape.mesh), [held])[:, 0] >= ALIKE
            for name, session in (("free", free), ("fixed", fixed)):
                moved = np.linalg.norm(session.vertices - shape.mesh.vertices, axis=1) / shape.mesh.diagonal
                means = [100 * float(moved[each].mean()) if each.any() else None for each in (alike, ~alike)]
                rows.append([shape.name, named(preset), name, *means])
    columns = ["shape", "preset", "", "alike to the fixed point: moved %", "all else: moved %"]
    text = (
        "Left to right: the shape, weights and result without the fixed point, weights and result with it. In the "
        f"table: mean distances moved, of the diagonal of the box; alike is what has a weight of at least {ALIKE} for "
        "the fixed point. dfd lets handles arrive at their targets in spite of fixed points, the paper does not."
    )
    look_for = "With a fixed point (square) on one foot, both feet stay where they are while the body still turns."
    return Page("Fig. 6: feature space constraints", look_for, [Section("Twists", text, drawn, Table(columns, rows))])
