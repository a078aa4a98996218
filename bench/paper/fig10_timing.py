"""Fig. 10: seconds to preprocess, bind and pose one shape at growing resolution."""

from __future__ import annotations

import time
from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image

import dfd
from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.fig18_high_resolution import subdivided
from bench.paper.report import Page, Section, Table
from bench.speed.measure import measure
from dfd.common.progress import Stages
from dfd.geometry.simplify import simplify

__all__ = ["PHASES", "page", "plot", "resampled"]

PHASES = ("preprocess", "bind", "pose")
CASES = {"koala": None, "scorpion": None, "spot": None, "quadruped": None, "*": None}
FACES = (1_000, 10_000, 100_000, 400_000, 1_600_000)


def page(context: Context) -> Page:
    """Every shape at every resolution, with nothing taken from the cache."""
    rows: list[list[Any]] = []
    for given, _ in context.cases(CASES, most=1 if context.quick else 3):
        for count in FACES[:3] if context.quick else FACES:
            shape = resampled(given, count)
            for preset in PRESETS:
                model = context.loaded(preset)
                start = time.perf_counter()
                field = context.field(shape, preset, encoder=model, stages=Stages(show=False))
                preprocess = time.perf_counter() - start
                mesh, vertex = shape.mesh, shape.at((0.5, 1.0, 0.5))
                features = field.features(mesh)
                weights = dfd.bind(features, [vertex])
                transform = np.eye(3, 4)[None] + 0.1
                short = 0.3 if context.quick else 1.0
                bind = measure(lambda: dfd.bind(field.features(mesh), [vertex]), seconds=short, least=3)  # noqa: B023
                rebind = measure(lambda: dfd.bind(features, [vertex]), seconds=short, least=3)  # noqa: B023
                pose = measure(lambda: dfd.pose(mesh.vertices, weights, transform), seconds=short, least=3)  # noqa: B023
                taken = [preprocess, bind.median, rebind.median, pose.median]
                rows.append([shape.name, named(preset), len(mesh.faces), *taken])
                context.say(f"{shape.name}, {len(mesh.faces):,} faces, {named(preset)}: {preprocess:.1f} s")
    text = (
        "Preprocess: all of `dfd.distill` but loading the encoder. Bind: the field's forward pass at all vertices "
        "and the weights of one handle; rebind: the weights of a further handle alone; pose: the moved shape. Medians "
        "of repeated calls. A shape is simplified, or its faces are cut into four, to get near each resolution. The "
        "paper's plot has no numbers; its text says that biharmonic coordinates fail above 10⁵ faces, in the "
        "tetrahedra and in binding, and that DFD's preprocessing hardly depends on the resolution."
    )
    columns = ["shape", "preset", "faces", "preprocess s", "bind s", "rebind s", "pose s"]
    series = {
        name: [(row[2], {"preprocess": row[3], "bind": row[4], "pose": row[6]}) for row in rows if row[1] == name]
        for name in map(named, PRESETS)
    }
    look_for = "Preprocessing hardly grows with the number of faces; bind and pose grow no faster than it does."
    sections = [Section("Seconds", text, table=Table(columns, rows), image=plot(series))]
    return Page("Fig. 10: method timing", look_for, sections)


def resampled(shape: Shape, count: int) -> Shape:
    """The shape with about `count` faces: faces cut into four until there are enough, then simplified."""
    times = 0
    while len(shape.mesh.faces) * 4**times < count:
        times += 1
    return Shape(shape.name, simplify(subdivided(shape, times).mesh, count))


def plot(series: dict[str, Sequence[tuple[int, dict[str, float]]]]) -> Image.Image:
    """Seconds over faces, both logarithmic, a panel for each phase and a line for each method."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4), layout="constrained")
    panels = figure.subplots(1, len(PHASES))
    for panel, phase in zip(panels, PHASES, strict=True):
        for color, (name, points) in zip(matplotlib.colormaps["tab10"].colors, series.items(), strict=False):
            panel.plot(
                [faces for faces, _ in points],
                [taken[phase] for _, taken in points],
                "o",
                color=color,
                label=name,
            )
        panel.set(xscale="log", yscale="log", title=phase, xlabel="faces", ylabel="seconds")
        panel.grid(visible=True, which="both", alpha=0.25)
    panels[0].legend()
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    return Image.open(stream).convert("RGB")
