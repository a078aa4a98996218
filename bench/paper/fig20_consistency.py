"""Fig. 20: the same parts are found on different shapes of one class."""

from __future__ import annotations

from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim, blank, heat
from bench.paper.measures import vertex_shares
from bench.paper.report import Page, Section, Table

__all__ = ["page"]

FOLLOWS = 0.5

# Points from 0 to 1 along the sides of each chair's box.
LEG, SEAT, BACK = (0.0, 0.0, 1.0), (0.5, 0.5, 0.7), (0.5, 1.0, 0.15)
CASES = {
    "kaykit_chair_A": {"leg": LEG, "seat": SEAT, "back": BACK},
    "chair_2": {"leg": LEG, "seat": SEAT, "back": BACK},
    "kaykit_armchair": {"leg": LEG, "seat": (0.5, 0.45, 0.8), "back": BACK, "arm": (0.08, 0.75, 0.75)},
    "couch_small1": {"leg": LEG, "seat": (0.5, 0.5, 0.7), "back": BACK, "arm": (0.05, 0.85, 0.8)},
    "chair": {"leg": LEG, "seat": SEAT, "back": BACK},
    "bench_1": {"leg": LEG, "seat": (0.5, 0.45, 0.7), "back": BACK, "arm": (0.0, 0.65, 0.7)},
    "*": {"leg": LEG, "seat": SEAT, "back": BACK},
}
PARTS = ("leg", "seat", "back", "arm")


def page(context: Context) -> Page:
    """Weights of the same places on each chair."""
    sections = []
    shapes = [(shape.refined(), case) for shape, case in context.cases(CASES, most=3 if context.quick else 6)]
    for preset in PRESETS:
        drawn, rows = [], []
        for shape, places in shapes:
            field = context.field(shape, preset)
            areas = vertex_shares(shape.mesh)
            images, numbers = [], []
            for part in PARTS:
                if part not in places:
                    images.append((blank(), ""))
                    numbers.append(None)
                    continue
                at = shape.at(places[part])
                weights = context.session(shape, field, preset, [{"at": at}]).following[:, 0]
                images.append((heat(shape.mesh, weights, [at], **aim(shape.mesh, [], azimuth=35.0)), part))
                numbers.append(100 * float(areas[weights > FOLLOWS].sum()))
            drawn.append((shape.name, images))
            rows.append([shape.name, *numbers])
        text = f"In the table: how much of the surface, in % of its area, has a weight above {FOLLOWS} for each part."
        sections.append(Section(named(preset), text, drawn, Table(["shape", *PARTS], rows)))
    look_for = "In a column the same part lights up on every chair: all legs, the seat, the back, both arms."
    return Page("Fig. 20: consistent weights within a class", look_for, sections)
