"""Pages that show edits (Fig. 1 to 3), symmetry (Fig. 5), fixed points (Fig. 6) and locality (Fig. 7)."""

from typing import Any

import numpy as np

import dfd
from bench.paper.distortion import surface_metrics
from bench.paper.page import Page, Row, following, gallery
from bench.paper.subjects import PULLS, BoxHandle, Context, Subject, pulls_of
from dfd.editing.presets import PRESETS as DEFAULTS

# The fixed point is on a part that moves with the handle's part if it is free, so that Eq. 6 has something to hold.
SWING = (-40, 0, 0)
TWISTS = {
    "quadruped": BoxHandle((0.2, 0.0, 0.85), rotation=SWING, pivot=(0.5, 0.55, 0.75), fixed=((0.2, 0.0, 0.1),)),
    "spot": BoxHandle((0.2, 0.0, 0.2), rotation=SWING, pivot=(0.5, 0.4, 0.25), fixed=((0.2, 0.0, 0.8),)),
    "robot": BoxHandle((0.5, 0.62, 1.0), rotation=(0, 50, 0), pivot=(0.5, 0.5, 0.5), fixed=((0.25, 0.0, 1.0),)),
}
SIMILAR = 0.5  # A vertex is similar to a fixed point if a handle at this point gives it at least this weight (Eq. 4).

TURNS = {
    "spot": BoxHandle((0.3, 1.0, 0.15), rotation=(0, 0, 30), pivot=(0.45, 0.88, 0.2), azimuth=150),
    "koala": BoxHandle((0.0, 0.95, 0.75), rotation=(0, 0, 35), pivot=(0.5, 0.6, 0.7), azimuth=35),
    "quadruped": BoxHandle((0.3, 1.0, 0.9), rotation=(0, 0, 40), pivot=(0.5, 0.72, 0.8), azimuth=35),
}
LOCALITIES = (0, 2, 8, 32)
FOLLOWS = 0.1  # A vertex follows the handle if its weight is above this.

SYMMETRY = pulls_of("scorpion", "human_neutral", "koala", "spot", "quadruped")
POSED = pulls_of("posed robot", "scorpion", "human_neutral", "koala", "spot")
HALF = 0.5  # A vertex counts in Fig. 3 if its weight is above this.
AFFINE = {
    "scorpion": BoxHandle((0.0, 0.2, 1.0), scale=(1.5, 1.5, 1.5), locality=1.0),
    "kaykit_chair_A": BoxHandle((0.5, 1.0, 0.1), rotation=(-25, 0, 0), pivot=(0.5, 0.5, 0.15)),
    "human_neutral": BoxHandle((0.5, 1.0, 0.5), scale=(1.4, 1.4, 1.4), pivot=(0.5, 0.85, 0.5)),
    **TURNS,
}


def fig1(context: Context) -> Page:
    """Edits as in the teaser: one handle, mirrored at the plane of symmetry."""
    return gallery(
        context.subjects(SYMMETRY, (2, 4), refined=True),
        lambda subject: {"edit": subject.pull(symmetric=True)},
        lambda _, session, __: {"plane found %": 100 * (session.symmetry is not None)},
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
    return gallery(
        context.subjects(PULLS, (3, 10), refined=True),
        lambda subject: {"edit": subject.pull()},
        lambda _, session, __: {"follows %": following(session, HALF)},
        f"The table has the percentage of the surface area with a weight above {HALF}. The handle's own weight is 1, "
        "so it reaches its target by definition.",
    )


def fig5(context: Context) -> Page:
    """Planes of visual symmetry, and a translation of one handle with and without such a plane."""

    def score(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        if plane := session.symmetry:
            return {"plane found %": 100, "normal": str(np.round(plane.normal, 2)), "score": plane.score}
        axes = dfd.symmetry_planes(subject.shape.mesh, subject.field, threshold=2.0, candidates="axes")
        return {"plane found %": 0, "normal": "", "score": axes[0].score if axes else None}

    def sides(subject: Subject) -> dict[str, Any]:
        plane = subject.pull(symmetric=True).symmetry
        return {"weights": subject.shape.mesh.vertices @ plane.normal > plane.offset} if plane else {}

    text = (
        "The posed robot is no mirror image of itself: one of its arms is raised. "
        "Score: mean distance between the features of vertices and of their mirror images. The paper accepts coordinate"
        f" planes with a score below ε = {DEFAULTS['paper'].threshold:g}; dfd's default also tries other planes. If no "
        "plane is accepted, the score is that of the best coordinate plane. The first picture colors the two sides."
    )
    return gallery(
        context.subjects(POSED, (2, 5), refined=True),
        lambda subject: {"one handle": subject.pull(), "with a plane": subject.pull(symmetric=True)},
        score,
        text,
        source=sides,
    )


def fig6(context: Context) -> Page:
    """Feature space constraints (Eq. 6): one rotation, without and with a fixed point."""

    def held(subject: Subject) -> list[int]:
        return [subject.shape.at(point) for point in subject.case.fixed]

    def moved(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        mesh = subject.shape.mesh
        similar = dfd.bind(subject.field.features(mesh), held(subject))[:, 0] >= SIMILAR
        lengths = 100 * np.linalg.norm(session.vertices - mesh.vertices, axis=1) / mesh.diagonal
        sets = {"similar vertices move %": similar, "other vertices move %": ~similar}
        return {name: float(lengths[each].mean()) for name, each in sets.items() if each.any()}

    text = (
        "The table has the mean motion of vertices, in % of the diagonal. Vertices are similar to the fixed point if a "
        f"handle at this point would give them a weight of at least {SIMILAR}. With dfd's default, handles reach their "
        "targets despite fixed points. With the paper preset, they do not."
    )
    return gallery(
        context.subjects(TWISTS, (2, 3)),
        lambda subject: {"free": subject.pull(), "fixed": subject.pull(fixed=held(subject))},
        moved,
        text,
    )


def fig7(context: Context) -> Page:
    """Locality (Eq. 7): one rotation with increasing λ."""
    return gallery(
        context.subjects(TURNS, (1, 2)),
        lambda subject: {f"λ = {each}": subject.pull({"locality": each}) for each in LOCALITIES},
        lambda _, session, __: {"follows %": following(session, FOLLOWS)},
        f"The table has the percentage of the surface area with a weight above {FOLLOWS}.",
    )
