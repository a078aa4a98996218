"""Pages about edits (Fig. 1 to 3), symmetry (Fig. 5), fixed points (Fig. 6) and locality (Fig. 7)."""

from typing import Any

import numpy as np

import dfd
from bench.paper.distortion import surface_metrics
from bench.paper.page import Page, Row, following, gallery
from bench.paper.subjects import PULLS, BoxHandle, Context, Subject, pulls_of
from dfd.editing.presets import PRESETS as DEFAULTS

MIDDLE, TWIST = (0.5, 0.5, 0.5), (0, 50, 0)
TWISTS = {
    "robot": BoxHandle((0.5, 0.62, 1.0), rotation=TWIST, pivot=MIDDLE, fixed=((0.25, 0.0, 1.0),)),
    "human_neutral": BoxHandle((0.5, 0.75, 1.0), rotation=TWIST, pivot=MIDDLE, fixed=((0.45, 0.0, 1.0),)),
    "kaiju": BoxHandle((0.5, 0.6, 0.8), rotation=TWIST, pivot=MIDDLE, fixed=((0.3, 0.0, 0.7),)),
}
ALIKE = 0.5  # weight (Eq. 4) for the fixed point, above which a vertex is alike

TURNS = {
    "spot": BoxHandle((0.3, 1.0, 0.15), rotation=(0, 0, 30), pivot=(0.45, 0.88, 0.2), azimuth=150),
    "koala": BoxHandle((0.0, 0.95, 0.75), rotation=(0, 0, 35), pivot=(0.5, 0.6, 0.7), azimuth=35),
    "quadruped": BoxHandle((0.3, 1.0, 0.9), rotation=(0, 0, 40), pivot=(0.5, 0.72, 0.8), azimuth=35),
}
LOCALITIES = (0, 2, 8, 32)
FOLLOWS = 0.1

SYMMETRY = pulls_of("scorpion", "human_neutral", "koala", "spot", "quadruped")
AFFINE = {
    "scorpion": BoxHandle((0.0, 0.2, 1.0), scale=(1.5, 1.5, 1.5), locality=1.0),
    "kaykit_chair_A": BoxHandle((0.5, 1.0, 0.1), rotation=(-25, 0, 0), pivot=(0.5, 0.5, 0.15)),
    "human_neutral": BoxHandle((0.5, 1.0, 0.5), scale=(1.4, 1.4, 1.4), pivot=(0.5, 0.85, 0.5)),
    **TURNS,
}


def fig1(context: Context) -> Page:
    """Edits of the teaser: one handle, mirrored by the plane of symmetry."""
    return gallery(
        context.subjects(SYMMETRY, (2, 4), refined=True),
        lambda subject: {"edit": subject.pull(symmetric=True)},
        lambda _, session, __: {"plane %": 100 * (session.symmetry is not None)},
    )


def fig2(context: Context) -> Page:
    """Affine edits by one handle: rotations and scales, some with locality."""

    def flipped(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        mesh = subject.shape.mesh
        return {"flipped %": 100 * surface_metrics(mesh, session.vertices)["flipped faces"] / len(mesh.faces)}

    subjects = context.subjects(AFFINE, (3, 6), refined=True)
    return gallery(subjects, lambda subject: {"edit": subject.pull()}, flipped)


def fig3(context: Context) -> Page:
    """Translations by one handle, with its weights."""

    def off(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        handle, mesh = subject.case.on(subject.shape), subject.shape.mesh
        target = mesh.vertices[handle["at"]] + handle["translation"]
        return {"off %": 100 * float(np.linalg.norm(session.vertices[handle["at"]] - target)) / mesh.diagonal}

    subjects = context.subjects(PULLS, (3, 10), refined=True)
    return gallery(subjects, lambda subject: {"edit": subject.pull()}, off)


def fig5(context: Context) -> Page:
    """Planes of visual symmetry, and one handle with and without them."""

    def score(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        if plane := session.symmetry:
            return {"plane %": 100, "normal": str(np.round(plane.normal, 2)), "score": plane.score}
        axes = dfd.symmetry_planes(subject.field, subject.shape.mesh, threshold=2.0, candidates="axes")
        return {"plane %": 0, "normal": "", "score": axes[0].score if axes else None}

    def sides(subject: Subject) -> dict[str, Any]:
        plane = subject.pull(symmetric=True).symmetry
        return {"weights": subject.shape.mesh.vertices @ plane.normal > plane.offset} if plane else {}

    text = (
        "The score is the mean distance between the features of a vertex and of its mirror image. The paper takes "
        f"coordinate planes with a score below ε = {DEFAULTS['paper'].threshold:g}; the default also looks for others. "
        "Without a plane, the score is that of the best coordinate plane. Colors of the first picture: its sides."
    )
    return gallery(
        context.subjects(SYMMETRY, (2, 4), refined=True),
        lambda subject: {"one handle": subject.pull(), "with a plane": subject.pull(symmetric=True)},
        score,
        text,
        source=sides,
    )


def fig6(context: Context) -> Page:
    """Feature space constraints (Eq. 6): a twist without and with a fixed point, which holds similar parts."""

    def held(subject: Subject) -> list[int]:
        return [subject.shape.at(point) for point in subject.case.fixed]

    def moved(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        mesh = subject.shape.mesh
        alike = dfd.bind(subject.field.features(mesh), held(subject))[:, 0] >= ALIKE
        lengths = 100 * np.linalg.norm(session.vertices - mesh.vertices, axis=1) / mesh.diagonal
        sets = {"alike moves %": alike, "all else moves %": ~alike}
        return {name: float(lengths[each].mean()) for name, each in sets.items() if each.any()}

    text = (
        f"Mean distances moved, of the diagonal. Alike vertices have a weight of at least {ALIKE} for the fixed point. "
        "With fixed points, handles of dfd still reach their targets; the paper's do not."
    )
    return gallery(
        context.subjects(TWISTS, (2, 3)),
        lambda subject: {"free": subject.pull(), "fixed": subject.pull(fixed=held(subject))},
        moved,
        text,
    )


def fig7(context: Context) -> Page:
    """Locality (Eq. 7): one rotation under growing λ."""
    return gallery(
        context.subjects(TURNS, (1, 2)),
        lambda subject: {f"λ = {each}": subject.pull({"locality": each}) for each in LOCALITIES},
        lambda _, session, __: {"follows %": following(session, FOLLOWS)},
        f"How much of the surface has a weight above {FOLLOWS}.",
    )
