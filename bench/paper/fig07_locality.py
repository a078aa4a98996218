"""Fig. 7: locality weighting (Eq. 7) narrows one deformation down."""

from __future__ import annotations

from dataclasses import dataclass

from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim, before_after
from bench.paper.measures import vertex_shares
from bench.paper.report import Page, Section, Table
from dfd.pictures.picture import picture

__all__ = ["page"]

LOCALITIES = (0, 2, 8, 32)
FOLLOWS = 0.1


@dataclass(frozen=True)
class Turn:
    """Where a shape is taken hold of and about what it turns, from 0 to 1 along the sides of its box, and how."""

    handle: tuple[float, float, float]
    pivot: tuple[float, float, float]
    rotation: tuple[float, float, float]
    azimuth: float


CASES = {
    "spot": Turn((0.3, 1.0, 0.15), (0.45, 0.88, 0.2), (0, 0, 30), 150),
    "koala": Turn((0.0, 0.95, 0.75), (0.5, 0.6, 0.7), (0, 0, 35), 35),
    "quadruped": Turn((0.3, 1.0, 0.9), (0.5, 0.72, 0.8), (0, 0, 40), 35),
    "*": Turn((0.5, 1.0, 0.5), (0.5, 0.5, 0.5), (0, 0, 40), 35),
}


def page(context: Context) -> Page:
    """Each shape turned by one handle under growing λ."""
    drawn, rows = [], []
    for shape, case in context.cases(CASES, most=1 if context.quick else 2):
        at = shape.at(case.handle)
        low, high = shape.mesh.bounds
        handle = {"at": at, "rotation": case.rotation, "pivot": low + case.pivot * (high - low)}
        areas = vertex_shares(shape.mesh)
        for preset in PRESETS:
            field = context.field(shape, preset)
            sessions = [context.session(shape, field, preset, [{**handle, "locality": each}]) for each in LOCALITIES]
            where = aim(shape.mesh, shape.mesh.vertices[[at]], *(each.vertices for each in sessions))
            where["azimuth"] = case.azimuth
            pairs = [before_after(session, where) for session in sessions]
            names = [f"λ = {each}" for each in LOCALITIES]
            source = picture(shape.mesh, handles=[at], **where)
            weights = [(pair[0][0], name) for pair, name in zip(pairs, names, strict=True)]
            moved = [(pair[1][0], name) for pair, name in zip(pairs, names, strict=True)]
            drawn.append((f"{shape.name}, {named(preset)}", [(source, "handle"), *weights]))
            drawn.append(("", [(source, "handle"), *moved]))
            for value, session in zip(LOCALITIES, sessions, strict=True):
                follows = areas[session.following[:, 0] > FOLLOWS].sum()
                rows.append([shape.name, named(preset), value, 100 * float(follows)])
    text = f"In the table: how much of the surface has a weight above {FOLLOWS}."
    look_for = "Without locality the whole head turns; the larger λ, the nearer to the tip of the horn it ends."
    table = Table(["shape", "preset", "λ", "follows, % of the area"], rows)
    return Page("Fig. 7: locality weighting", look_for, [Section("One rotation", text, drawn, table)])
