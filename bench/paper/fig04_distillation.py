"""Fig. 4: how many pixels teach the field, and what is left of a shape's looks when it is simplified."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.drawing import aim
from bench.paper.report import Page, Section, Table
from dfd.geometry.simplify import simplify
from dfd.pictures.colors import feature_colors
from dfd.pictures.picture import picture
from dfd.views.render import Supervision, Views, render

__all__ = ["page"]

CASES = dict.fromkeys(("koala", "plane_holes", "scorpion", "spot", "quadruped", "*"))
REDUCED = 0.99

SUPERVISION: tuple[Supervision, ...] = ("vertex", "barycentric")


def _distinct_pixels(views: Views) -> int:
    """How many pixels of all pictures show a point, each counted once however many vertices fall into it."""
    return len(np.unique(np.stack([views.view, np.rint(views.row), np.rint(views.column)]), axis=1).T)


def page(context: Context) -> Page:
    """Pixels that a vertex or a triangle covers, and fields of the shape and of a hundredth of its faces."""
    pixels: list[list[Any]] = []
    reduced: list[list[Any]] = []
    drawn = []
    for shape, _ in context.cases(CASES, most=1 if context.quick else 4):
        counts = [
            _distinct_pixels(render(shape.mesh, views=8, resolution=252, framing="paper", supervision=kind))
            for kind in SUPERVISION
        ]
        pixels.append([shape.name, len(shape.mesh.vertices), *counts])
        begin = time.perf_counter()
        few = simplify(shape.mesh, max(500, round((1 - REDUCED) * len(shape.mesh.faces))))
        seconds = time.perf_counter() - begin
        where = aim(shape.mesh, np.empty((0, 3)))
        row = [
            (picture(shape.mesh, **where), f"{len(shape.mesh.faces):,} faces"),
            (picture(few, **where), f"{len(few.faces):,} faces"),
        ]
        for preset in PRESETS:
            own = context.field(shape, preset).features(shape.mesh)
            of_few = context.field(Shape(f"{shape.name} reduced", few), preset).features(shape.mesh)
            # Colors of both by the same directions; fields of two fits have their own turn of feature space.
            colors = feature_colors(np.concatenate([own, of_few]))
            row += [
                (picture(shape.mesh, colors=some, **where), f"{named(preset)}: field of {what}")
                for some, what in zip(np.split(colors, 2), ("the shape", "the reduced one"), strict=True)
            ]
            off = np.linalg.norm(own - of_few, axis=1).mean()
            spread = np.linalg.norm(own - own.mean(axis=0), axis=1).mean()
            reduced.append([shape.name, named(preset), len(few.faces), seconds, float(off), float(spread)])
        drawn.append((shape.name, row))
    first = (
        "Eight pictures of 252². Other methods learn from the pixels that a vertex falls into, barycentric "
        "distillation from every pixel that a triangle covers."
    )
    second = (
        "Fields distilled from the shape and from the reduced one, both evaluated at the shape's vertices; the "
        "distance of the two beside the spread of the features. The paper: Lucy, 28 million faces, takes 5.7 minutes "
        "to render and 3.7 s to reduce by 99 % and render."
    )
    look_for = "All pixels of the shape teach, not one a vertex; the reduced shape looks like the whole one."
    sections = [
        Section(
            "Pixels", first, table=Table(["shape", "vertices", "pixels of vertices", "pixels of triangles"], pixels)
        ),
        Section(
            "Reduced by 99 %",
            second,
            drawn,
            Table(["shape", "preset", "faces", "seconds to reduce", "mean distance", "spread"], reduced),
        ),
    ]
    return Page("Fig. 4: barycentric feature distillation", look_for, sections)
