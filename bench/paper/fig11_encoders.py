"""Fig. 11: one deformation with the features of several image encoders."""

from __future__ import annotations

import numpy as np

from bench.paper.context import PRESETS, Context, named
from bench.paper.drawing import aim
from bench.paper.fig12_encoder_weights import encoders, missing, shapes
from bench.paper.report import Page, Section, Table
from dfd.geometry.metrics import surface_metrics
from dfd.pictures.picture import picture

__all__ = ["page"]

OFFSET = np.array([0.0, -0.12, 0.0])  # of the diagonal


def page(context: Context) -> Page:
    """One handle pulled down, with each encoder's features."""
    drawn, rows = [], []
    found, absent = encoders(context)
    for shape, at in shapes(context):
        for preset in PRESETS:
            handle = {"at": at, "translation": OFFSET * shape.mesh.diagonal}
            moved = {}
            for name, encoder in found.items():
                field = context.field(shape, preset, encoder=context.loaded(preset, *encoder))
                moved[name] = context.session(shape, field, preset, [handle]).vertices
            source = shape.mesh.vertices[[at]]
            where = aim(shape.mesh, source, *moved.values())
            target = source + handle["translation"]
            images = [(picture(shape.mesh, handles=source, **where), "source")]
            for name, vertices in moved.items():
                images.append((picture(shape.mesh, vertices=vertices, handles=target, **where), name))
                metrics = surface_metrics(shape.mesh, vertices)
                change = [100 * metrics.area, metrics.angle, metrics.flipped_faces]
                rows.append([shape.name, named(preset), name, *change])
            drawn.append((f"{shape.name}, {named(preset)}", images))
    text = "No fixed point, no regularization. In the table: mean changes over the surface." + missing(absent)
    table = Table(["shape", "preset", "encoder", "area %", "angle °", "flipped faces"], rows)
    look_for = "With every encoder what looks like the pulled part comes along, and the surface stays smooth."
    title = "Fig. 11: deformations with other image models"
    return Page(title, look_for, [Section("One pull", text, drawn, table)])
