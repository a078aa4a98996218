"""Pages about what a person sets: symmetry (Fig. 5), fixed points (Fig. 6) and locality (Fig. 7)."""

from __future__ import annotations

import numpy as np

import dfd
from bench.paper.page import BoxHandle, Context, Page, Section, Table, aim, before_after, pulls_of, silhouettes
from bench.quality.measures import area_fractions
from dfd.editing.presets import PRESETS as DEFAULTS
from dfd.pictures.picture import picture

SYMMETRY = pulls_of("scorpion", "human_neutral", "koala", "spot", "quadruped")
MIDDLE, TWIST = (0.5, 0.5, 0.5), (0, 50, 0)
TWISTS = {
    "robot": BoxHandle((0.5, 0.62, 1.0), rotation=TWIST, pivot=MIDDLE, fixed=((0.25, 0.0, 1.0),)),
    "human_neutral": BoxHandle((0.5, 0.75, 1.0), rotation=TWIST, pivot=MIDDLE, fixed=((0.45, 0.0, 1.0),)),
    "kaiju": BoxHandle((0.5, 0.6, 0.8), rotation=TWIST, pivot=MIDDLE, fixed=((0.3, 0.0, 0.7),)),
    "*": BoxHandle((0.5, 0.7, 1.0), rotation=TWIST, pivot=MIDDLE, fixed=((0.5, 0.0, 1.0),)),
}
ALIKE = 0.5  # the paper's weight (Eq. 4) above which a vertex counts as alike to the fixed point

TURNS = {
    "spot": BoxHandle((0.3, 1.0, 0.15), rotation=(0, 0, 30), pivot=(0.45, 0.88, 0.2), azimuth=150),
    "koala": BoxHandle((0.0, 0.95, 0.75), rotation=(0, 0, 35), pivot=(0.5, 0.6, 0.7), azimuth=35),
    "quadruped": BoxHandle((0.3, 1.0, 0.9), rotation=(0, 0, 40), pivot=(0.5, 0.72, 0.8), azimuth=35),
    "*": BoxHandle((0.5, 1.0, 0.5), rotation=(0, 0, 40), pivot=MIDDLE, azimuth=35),
}
LOCALITIES = (0, 2, 8, 32)
FOLLOWS = 0.1


def fig5(context: Context) -> Page:
    """Planes of symmetry that are seen, and one handle with and without them."""
    drawn, rows = [], []
    for subject in context.subjects(SYMMETRY, (2, 4), refined=True):
        mesh, handle, own = subject.shape.mesh, subject.case.on(subject.shape), DEFAULTS[subject.preset]
        planes = dfd.symmetry_planes(subject.field, mesh, threshold=own.threshold, candidates=own.candidates)
        every = dfd.symmetry_planes(subject.field, mesh, threshold=2.0, candidates="axes")
        for plane in every or planes:
            found = any(np.allclose(plane.normal, each.normal, atol=1e-3) for each in planes)
            rows.append([*subject.label, str(np.round(plane.normal, 2)), plane.score, "yes" if found else ""])
        alone, both = (subject.session([handle], symmetric=symmetric) for symmetric in (False, True))
        where = aim(mesh, mesh.vertices[[handle["at"]]], alone.vertices, both.vertices)
        row = [(picture(mesh, **where), "source")]
        if planes:
            side = mesh.vertices @ np.array(planes[0].normal) - planes[0].offset
            row.append((picture(mesh, weights=(side > 0).astype(float), **where), "sides of the plane"))
        row += before_after(both, where)[:1]
        row.append((silhouettes(mesh, alone.vertices, where), "one handle"))
        row.append((silhouettes(mesh, both.vertices, where), "with the plane" if planes else "no plane found"))
        drawn.append((subject.heading, row))
    text = (
        f"The score is the mean distance between the features of a vertex and of its mirror image. The paper takes "
        f"coordinate planes with a score below ε = {DEFAULTS['paper'].threshold:g}; the default also looks for others."
    )
    look_for = "The plane divides the shape as a person would, though its pose is not symmetric, and both sides follow."
    table = Table(["shape", "preset", "normal", "score", "found"], rows)
    return Page("Fig. 5: visual symmetry", look_for, [Section("Planes and edits", text, drawn, table)])


def fig6(context: Context) -> Page:
    """Feature space constraints (Eq. 6): a twist without and with a fixed point, which holds what looks like it."""
    drawn, rows = [], []
    for subject in context.subjects(TWISTS, (2, 3)):
        mesh, handle = subject.shape.mesh, subject.case.on(subject.shape)
        held = [subject.shape.at(point) for point in subject.case.fixed]
        free, fixed = (subject.session([handle], fixed=some) for some in ([], held))
        where = aim(mesh, mesh.vertices[[handle["at"]]], free.vertices, fixed.vertices)
        source = picture(mesh, handles=[handle["at"]], fixed=held, **where)
        images = [(source, "handle and fixed point")]
        alike = dfd.bind(subject.field.features(mesh), held)[:, 0] >= ALIKE
        for name, session in (("free", free), ("fixed", fixed)):
            images += [(image, f"{what}, {name}") for image, what in before_after(session, where)]
            moved = np.linalg.norm(session.vertices - mesh.vertices, axis=1) / mesh.diagonal
            means = [100 * float(moved[each].mean()) if each.any() else None for each in (alike, ~alike)]
            rows.append([*subject.label, name, *means])
        drawn.append((subject.heading, images))
    columns = ["shape", "preset", "", "alike to the fixed point: moved %", "all else: moved %"]
    text = (
        "Weights and result without the fixed point and with it. In the "
        f"table: mean distances moved, of the diagonal of the box; alike is what has a weight of at least {ALIKE} for "
        "the fixed point. dfd lets handles arrive at their targets in spite of fixed points, the paper does not."
    )
    look_for = "With a fixed point (square) on one foot, both feet stay where they are while the body still turns."
    return Page("Fig. 6: feature space constraints", look_for, [Section("Twists", text, drawn, Table(columns, rows))])


def fig7(context: Context) -> Page:
    """Locality (Eq. 7): one rotation under growing λ."""
    drawn, rows = [], []
    for subject in context.subjects(TURNS, (1, 2)):
        mesh, handle = subject.shape.mesh, subject.case.on(subject.shape)
        sessions = {each: subject.session([{**handle, "locality": each}]) for each in LOCALITIES}
        where = aim(mesh, mesh.vertices[[handle["at"]]], *(each.vertices for each in sessions.values()))
        where["azimuth"] = subject.case.azimuth
        source = (picture(mesh, handles=[handle["at"]], **where), "handle")
        pictures = {f"λ = {each}": before_after(session, where) for each, session in sessions.items()}
        drawn.append((subject.heading, [source, *((pair[0][0], name) for name, pair in pictures.items())]))
        drawn.append(("", [source, *((pair[1][0], name) for name, pair in pictures.items())]))
        areas = area_fractions(mesh)
        for value, session in sessions.items():
            rows.append([*subject.label, value, 100 * float(areas[session.following[:, 0] > FOLLOWS].sum())])
    text = f"In the table: how much of the surface has a weight above {FOLLOWS}."
    look_for = "Without locality all that looks alike turns; the larger λ, the nearer to the tip of the horn it ends."
    table = Table(["shape", "preset", "λ", "follows, % of the area"], rows)
    return Page("Fig. 7: locality weighting", look_for, [Section("One rotation", text, drawn, table)])
