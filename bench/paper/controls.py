"""Pages that show edits (Fig. 1 to 3), symmetry (Fig. 5), fixed points (Fig. 6) and locality (Fig. 7)."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

import dfd
from bench.paper.distortion import surface_metrics
from bench.paper.page import HALF, Page, Row, following, gallery
from bench.paper.subjects import CASES, MIRRORED, Context, Subject, pulls_of
from dfd.editing.presets import PRESETS as DEFAULTS

FREE, FIXED = "free", "fixed"
LOCALITIES = (0, 2, 8, 32)

SYMMETRY = pulls_of("scorpion", "human_neutral", "koala", "spot", "quadruped")
POSED = pulls_of("posed robot", "scorpion", "human_neutral", "koala", "spot")


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

    subjects = context.subjects(CASES["affine"], (4, 4), refined=True)
    return gallery(subjects, lambda subject: {"edit": subject.pull()}, flipped)


def fig3(context: Context) -> Page:
    """Translations by one handle, with its weights."""
    return gallery(
        context.subjects(CASES["pulls"], (4, 10), refined=True),
        lambda subject: {"edit": subject.pull()},
        lambda _, session, __: {"follows %": following(session)},
        f"follows: percentage of the surface area with a weight above {HALF}.",
    )


def fig5(context: Context) -> Page:
    """Planes of visual symmetry, and a translation of one handle with and without such a plane."""

    def subjects() -> Iterator[Subject]:
        for subject in context.subjects(POSED, (2, 5), refined=True):
            yield subject
            if subject.preset == "paper":
                yield replace(subject, name=MIRRORED, field=context.field(subject.shape, "paper", mirrored=True))

    def score(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        if plane := session.symmetry:
            return {"plane found %": 100, "normal": str(np.round(plane.normal, 2)), "score": plane.score}
        axes = dfd.symmetry_planes(subject.shape.mesh, subject.field, threshold=2.0, candidates="axes")
        return {"plane found %": 0, "normal": "", "score": axes[0].score if axes else None}

    def sides(subject: Subject) -> dict[str, Any]:
        plane = subject.pull(symmetric=True).symmetry
        return {"weights": subject.shape.mesh.vertices @ plane.normal > plane.offset} if plane else {}

    text = (
        "One arm of the posed robot is raised. Score: mean distance between the features of vertices and of their "
        f"mirror images. The paper accepts coordinate planes with a score below ε = {DEFAULTS['paper'].threshold:g}. "
        "If no plane is accepted, the score is that of the best coordinate plane. The first picture colors the sides."
    )
    return gallery(
        subjects(),
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
        alike = list(map(subject.shape.at, subject.case.stays))
        lengths = np.linalg.norm((session.vertices - subject.shape.mesh.vertices)[alike], axis=1)
        return {"similar places move %": 100 * float(lengths.mean()) / subject.shape.mesh.diagonal}

    return gallery(
        context.subjects(CASES["twists"], (2, 3)),
        lambda subject: {FREE: subject.pull(), FIXED: subject.pull(fixed=held(subject))},
        moved,
        "similar places move: mean motion of marked places that look like the fixed point, in % of the diagonal.",
    )


def fig7(context: Context) -> Page:
    """Locality (Eq. 7): one rotation with increasing λ."""

    def related(subject: Subject, session: dfd.Deformer, _: dfd.Deformer) -> Row:
        return {
            "related places follow %": 100
            * float(session.following[list(map(subject.shape.at, subject.case.like)), 0].mean())
        }

    return gallery(
        context.subjects(CASES["turns"], (2, 3)),
        lambda subject: {f"λ = {each}": subject.pull({"locality": each}) for each in LOCALITIES},
        related,
        "related places follow: mean weight at marked places that look like the handle's, such as the other horn.",
    )
