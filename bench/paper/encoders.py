"""Pages with the features of several image encoders: one deformation (Fig. 11) and weights (Fig. 12)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.paper.context import PRESETS, Context, Shape, named, session
from bench.paper.drawing import aim, heat
from bench.paper.report import Page, Section, Table
from bench.quality.measures import area_fractions
from dfd.common.linear_algebra import Float64
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER, KNOWN_ENCODERS
from dfd.geometry.metrics import surface_metrics
from dfd.pictures.picture import picture

Choice = tuple[str, int | None]  # an encoder's name, and the block whose tokens are taken; None is its own choice
OTHERS = tuple(name for name in KNOWN_ENCODERS if name != DEFAULT_ENCODER)
BLOCKS = (3, 6, 9, 12)
CASES = {  # where each shape is taken hold of, from 0 to 1 along the sides of its box
    "spot": (0.2, 0.0, 0.2),
    "scorpion": (0.0, 0.2, 0.4),
    "human_neutral": (0.0, 0.72, 0.5),
    "quadruped": (0.0, 0.0, 0.9),
    "*": (0.0, 0.0, 1.0),
}
OFFSET = np.array([0.0, -0.12, 0.0])  # of the diagonal


def fig11(context: Context) -> Page:
    """One handle pulled down, with each encoder's features."""
    drawn, rows = [], []
    found, absent = encoders(context)
    for shape, place in context.cases(CASES, (1, 3)):
        at, offset = shape.at(place), OFFSET * shape.mesh.diagonal
        for preset in PRESETS:
            handle = {"at": at, "translation": offset}
            moved = {name: _session(context, shape, handle, preset, each).vertices for name, each in found.items()}
            source = shape.mesh.vertices[[at]]
            where = aim(shape.mesh, source, *moved.values())
            images = [(picture(shape.mesh, handles=source, **where), "source")]
            for name, vertices in moved.items():
                images.append((picture(shape.mesh, vertices=vertices, handles=source + offset, **where), name))
                metrics = surface_metrics(shape.mesh, vertices)
                change = [100 * metrics.area, metrics.angle, metrics.flipped_faces]
                rows.append([shape.name, named(preset), name, *change])
            drawn.append((f"{shape.name}, {named(preset)}", images))
    text = "No fixed point, no regularization. In the table: mean changes over the surface." + missing(absent)
    table = Table(["shape", "preset", "encoder", "area %", "angle °", "flipped faces"], rows)
    look_for = "With every encoder what looks like the pulled part comes along, and the surface stays smooth."
    title = "Fig. 11: deformations with other image models"
    return Page(title, look_for, [Section("One pull", text, drawn, table)])


def fig12(context: Context) -> Page:
    """The weights of one handle by each encoder."""
    drawn, rows = [], []
    found, absent = encoders(context)
    for shape, place in context.cases(CASES, (1, 3)):
        at, areas = shape.at(place), area_fractions(shape.mesh)
        for preset in PRESETS:
            weights = {
                name: _session(context, shape, {"at": at}, preset, encoder).weights[:, 0]
                for name, encoder in found.items()
            }
            where = aim(shape.mesh, shape.mesh.vertices[[at]])
            images = [(heat(shape.mesh, values, [at], **where), name) for name, values in weights.items()]
            drawn.append((f"{shape.name}, {named(preset)}", images))
            reference = next(iter(weights.values()))
            for name, values in weights.items():
                rows.append([shape.name, named(preset), name, correlation(values, reference, areas)])
    text = (
        "In the table: the correlation over the surface with the weights of the first encoder. The paper shows DINO, "
        "CLIP, SAM 2, Diff3F and others." + missing(absent)
    )
    table = Table(["shape", "preset", "encoder", "correlation"], rows)
    look_for = "All encoders light up the same parts; some tell a part from its surroundings more sharply than others."
    return Page("Fig. 12: different encoders", look_for, [Section("Weights of one handle", text, drawn, table)])


def _session(context: Context, shape: Shape, handle: dict[str, Any], preset: Preset, encoder: Choice) -> dfd.Deformer:
    field = context.field(shape, preset, encoder=context.loaded(preset, *encoder))
    return session(shape.mesh, field, preset, [handle])


def encoders(context: Context) -> tuple[dict[str, Choice], dict[str, str]]:
    """Encoders by what a page calls them, the one that is used by itself first; and why others are not available."""
    own = context.loaded("paper")
    label = str(own.name).rpartition("/")[2]
    found: dict[str, Choice] = {f"{label}, block {own.block}": (own.name, None)}
    for block in BLOCKS[1::2] if context.quick else BLOCKS:
        if block <= own.depth and block != own.block:
            found[f"{label}, block {block}"] = (own.name, block)
    absent = {}
    for name in () if context.quick else OTHERS:
        try:
            context.say(f"looking for {name}")
            context.loaded("paper", name)
            found[name] = (name, None)
        except (OSError, ValueError) as error:
            absent[name] = " ".join(str(error).split())
    return found, absent


def missing(absent: dict[str, str]) -> str:
    """What a page says about encoders that were not to be had."""
    if not absent:
        return ""
    return "\n\nNot available here: " + ", ".join(absent) + f". The first one: {next(iter(absent.values()))}"


def correlation(first: NDArray[np.floating], second: NDArray[np.floating], areas: Float64) -> float:
    """Pearson's correlation of weights (V,) over a surface whose vertices have `areas` (V,) that sum to 1."""
    a, b = (values - areas @ values for values in (first.astype(float), second.astype(float)))
    return float(areas @ (a * b) / max(np.sqrt((areas @ a**2) * (areas @ b**2)), 1e-12))
