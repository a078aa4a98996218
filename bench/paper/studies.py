"""The sheets of both user studies: anonymous options in an order of chance, and the key in a file of its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bench.paper.compare import compare
from bench.paper.comparison import affine, marked, methods_of, pulls
from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim, silhouettes
from bench.paper.handles import Case
from bench.paper.report import Page, Section
from dfd.pictures.picture import picture

__all__ = ["desirable", "realistic"]

SEED = 0
OTHERS = ("ARAP", "biharmonic", "NeuralMLS")
DRAGGED = (
    "Original point: blue dot; dragged point: green dot. Silhouette before: blue; after: green. Missing textures or \
colors do not count."
)


def desirable(context: Context) -> Page:
    """The first study (Fig. 23): the best two, by what moves and what does not."""
    text = (
        "Imagine that you shape models by dragging single points of them. For each question select the **best 2** "
        "deformations: those that move only parts **related** to the dragged point, keep all **symmetries**, and whose "
        f"silhouettes **overlap** wherever the shape is unrelated to it. {DRAGGED}"
    )
    return _page(context, "study1", "Study of deformations", text, 15, both=True)


def realistic(context: Context) -> Page:
    """The second study (Fig. 24): the most realistic."""
    text = (
        "For each question select the **most realistic** deformation: how well are the details of the shape, and the "
        f"parts that are deformed, preserved? {DRAGGED}"
    )
    return _page(context, "study2", "Study of realism", text, 14, both=False)


def _page(context: Context, name: str, title: str, text: str, most: int, *, both: bool) -> Page:
    draws = np.random.default_rng(SEED)
    sections, key = [], {}
    for number, (shape, case) in enumerate(pulls(context, 2 if context.quick else most), 1):
        context.say(shape)
        moved = _moved(context, shape, case, both)
        order = [list(moved)[each] for each in draws.permutation(len(moved))]
        key[f"question {number}"] = {"shape": shape, **{f"option {at}": method for at, method in enumerate(order, 1)}}
        where = aim(case.mesh, case.mesh.vertices[case.handles], case.targets, *moved.values())
        drawn = [(marked(case, where, picture(case.mesh, **where)), "before")]
        for at, method in enumerate(order, 1):
            outlined = silhouettes(case.mesh, moved[method], where)
            drawn.append((marked(case, where, outlined), f"Option {at}"))
        sections.append(Section(f"Question {number}", pictures=[(f"Question {number}", drawn)]))
    return Page(title, text, sections, files={f"{name}_key.json": json.dumps({"seed": SEED, **key}, indent=2) + "\n"})


def _moved(context: Context, shape: str, case: Case, both: bool) -> Mapping[str, NDArray[np.float64]]:
    methods: dict[str, Callable[[], NDArray[np.float64]]] = {}
    every = methods_of(context, case, context.ball)
    for preset in PRESETS:
        methods[f"{named(preset)}, translation"] = every[named(preset)]
        if both:
            methods[f"{named(preset)}, affine"] = partial(affine, context, case, preset)
    rows = compare(shape, case, {**methods, **{name: every[name] for name in OTHERS}})
    for row in rows:
        if row.note:
            context.say(f"  {row.method} is left out: {row.note}")
    return {row.method: row.vertices for row in rows if row.vertices is not None}
