"""Fig. 13: distilled from a coarse copy by all pixels (Eq. 3) or by its vertices alone, and used on the fine mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

import dfd
from bench.paper.context import Context, named
from bench.paper.drawing import aim, before_after
from bench.paper.measures import roughness, vertex_shares
from bench.paper.report import Page, Section, Table
from dfd.common.preset import Preset
from dfd.geometry.simplify import simplify
from dfd.pictures.picture import picture

__all__ = ["page"]

COARSE = 1000  # faces, 1 % of the fine shapes': the paper reduces by 99 %
CASES = {  # where each shape is taken hold of, from 0 to 1 along the sides of its box
    "koala": (0.0, 0.95, 0.75),
    "scorpion": (0.0, 0.2, 1.0),
    "human_neutral": (0.0, 0.72, 0.5),
    "quadruped": (0.2, 1.0, 0.9),
    "*": (0.5, 1.0, 0.5),
}
OFFSET = np.array([0.0, 0.12, 0.0])  # of the diagonal
COARSE_COPY: dict[str, Any] = {"simplify_to": COARSE}
KINDS: dict[str, tuple[Preset, dict[str, Any]]] = {  # columns: the preset, and what is changed of it
    "fine copy, all pixels": ("paper", {}),
    "coarse copy, vertices alone": ("paper", {**COARSE_COPY, "supervision": "vertex"}),
    "coarse copy, all pixels": ("paper", COARSE_COPY),
    "coarse copy, dfd default": ("default", COARSE_COPY),
}


def page(context: Context) -> Page:
    """The weights and a pull on the fine mesh, by fields of coarse and fine copies."""
    drawn, rows, lengths = [], [], []
    for shape, place in context.cases(CASES, most=1 if context.quick else 2):
        at = shape.at(place)
        sessions: dict[str, dfd.Deformer] = {}
        dense = len(context.field(shape, "paper", **COARSE_COPY).settings["losses"])
        lengths.append(f"{shape.name} {dense:,}")
        for name, (preset, changes) in KINDS.items():
            length = {"steps": dense} if "supervision" in changes else {}
            field = context.field(shape, preset, **changes, **length)
            handle = {"at": at, "translation": OFFSET * shape.mesh.diagonal}
            sessions[name] = context.session(shape, field, preset, [handle])
        where = aim(shape.mesh, shape.mesh.vertices[[at]], *(each.vertices for each in sessions.values()))
        pairs = [before_after(session, where) for session in sessions.values()]
        copy = simplify(shape.mesh, COARSE)
        drawn.append(
            (
                f"{shape.name}: weights",
                [
                    (picture(copy, **where), f"the coarse copy, {len(copy.faces):,} faces"),
                    *[(pair[0][0], name) for pair, name in zip(pairs, KINDS, strict=True)],
                ],
            )
        )
        drawn.append(
            (
                f"{shape.name}: moved",
                [
                    (picture(shape.mesh, handles=[at], **where), f"the fine mesh, {len(shape.mesh.faces):,} faces"),
                    *[(pair[1][0], name) for pair, name in zip(pairs, KINDS, strict=True)],
                ],
            )
        )
        areas, fine = vertex_shares(shape.mesh), sessions["fine copy, all pixels"].weights[:, 0]
        for name, session in sessions.items():
            weights = session.weights[:, 0]
            off = float(areas @ np.abs(weights - fine)) if KINDS[name][0] == "paper" else None
            rows.append([shape.name, name, roughness(shape.mesh, weights), off])
    text = (
        f"Fits of the {named('paper')} to the coarse copy take the same number of steps, as many as its epochs over "
        f"all pixels take ({', '.join(lengths)}): with vertices alone the same samples come again and again. "
        "Roughness is the mean of |∇W| on the fine mesh, in weight per diagonal; off is the mean difference from the "
        "weights of the fine copy."
    )
    look_for = (
        "Weights by vertices alone lie farther from those of the fine copy than weights by all pixels do; in the paper "
        "they are blotched, and the pull tears the surface."
    )
    table = Table(["shape", "field", "roughness", "off"], rows)
    title = "Fig. 13: barycentric distillation from coarse to fine"
    return Page(title, look_for, [Section("One pull on the fine mesh", text, drawn, table)])
