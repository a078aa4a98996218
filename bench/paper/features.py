"""Pages that show features: distillation (Fig. 4, 13), encoders (Fig. 11, 12), and other shapes (Fig. 19, 20)."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import dfd
from bench.paper.distortion import surface_metrics
from bench.paper.page import HALF, Page, Pictures, Row, aim, following, gallery
from bench.paper.subjects import CASES, NAMES, PRESETS, Context, Shape, Subject, agreement, pulls_of
from bench.quality.measures import area_fractions
from dfd.common.errors import one_line
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.encoders.known import DEFAULT_ENCODER, KNOWN_ENCODERS
from dfd.geometry.simplify import simplify
from dfd.geometry.topology import face_areas
from dfd.pictures.colors import feature_colors
from dfd.pictures.picture import picture
from dfd.views.render import render

DISTILLED = dict.fromkeys(("koala", "plane_holes", "scorpion", "spot", "quadruped"))
DETAILED = (200_000, 2_000_000)  # number of faces in a quick and in a full run of Fig. 4

COARSE = 200  # number of faces of the coarse copy; each face is much larger than the details of the features
VERTICES_ALONE, ALL_PIXELS = "paper preset, coarse copy, vertices alone", "paper preset, coarse copy, all pixels"
PULLED = pulls_of("koala", "scorpion", "human_neutral", "quadruped")
COARSE_COPY: dict[str, Any] = {"simplify_to": COARSE}
KINDS: dict[str, tuple[Preset, dict[str, Any]]] = {  # for each field of Fig. 13, the preset and the changed settings
    "paper preset, fine mesh, all pixels": ("paper", {}),
    VERTICES_ALONE: ("paper", {**COARSE_COPY, "supervision": "vertex"}),
    ALL_PIXELS: ("paper", COARSE_COPY),
    "dfd default, coarse copy": ("default", COARSE_COPY),
}

Choice = tuple[str, int | None]  # an encoder's name, and the block that gives its tokens; None is its default block
OTHERS = tuple(name for name in KNOWN_ENCODERS if name != DEFAULT_ENCODER)
BLOCKS = (3, 6, 9, 12)
HELD = pulls_of("spot", "scorpion", "human_neutral", "quadruped")

CHAIRS: dict[str, tuple[str, ...]] = {  # parts of each chair that are selected, see `CASES["parts"]`
    "kaykit_chair_A": ("leg", "seat", "back"),
    "chair_2": ("leg", "seat", "back"),
    "kaykit_armchair": ("seat", "back", "arm"),
    "couch_small1": ("leg", "seat", "back", "arm"),
    "chair": ("leg", "seat", "back"),
    "couch_l": ("seat", "back"),
}
DOWN = np.array([0.0, -0.12, 0.0])  # translation, as a fraction of the diagonal


def fig4(context: Context) -> Page:
    """A shape and its copy with 1 % of the faces: their fields and pictures."""
    rows: list[Row] = []
    drawn: list[Pictures] = []
    for given, _ in context.cases(DISTILLED, (1, 2)):
        shape = resampled(given, context.quick_or_full(DETAILED))
        few = simplify(shape.mesh, max(500, len(shape.mesh.faces) // 100))
        where = aim(shape.mesh, np.empty((0, 3)))
        row = [(picture(each, **where), f"{len(each.faces):,} faces") for each in (shape.mesh, few)]
        for preset in PRESETS:
            own = context.field(shape, preset)(few.vertices)
            of_few = context.field(Shape(f"{shape.name} reduced", few), preset)(few.vertices)
            # Colors depend on the main directions of the features, so both fields must be colored together.
            colors = np.split(feature_colors(np.concatenate([own, of_few])), 2)
            for some, what in zip(colors, ("the shape", "the reduced shape"), strict=True):
                row.append((picture(few, colors=some, **where), f"{NAMES[preset]}: field of {what}"))
            start = {"shape": shape.name, "method": NAMES[preset], "faces": len(shape.mesh.faces)}
            off, spread = (float(np.linalg.norm(own - other, axis=1).mean()) for other in (of_few, own.mean(axis=0)))
            rows.append({**start, "mean distance": off, "spread": spread})
        drawn.append((shape.name, row))
    text = (
        "Mean distance: mean distance between the features of both fields at a vertex of the reduced shape. Spread: "
        "mean distance of the features of the shape's field from their mean."
    )
    return Page(text, drawn, rows)


def distilled(context: Context, shape: Shape, preset: Preset) -> tuple[dfd.Field, float, Stages]:
    """Distill without the cache; return the field, the seconds without loading the encoder, and the timed stages."""
    model, stages = context.loaded(preset), Stages(show=False)
    begin = time.perf_counter()
    field = context.field(shape, preset, encoder=model, stages=stages)
    return field, time.perf_counter() - begin, stages


def resampled(shape: Shape, count: int) -> Shape:
    """Return the shape with about `count` faces: it is simplified, or subdivided if it has fewer faces."""
    if len(shape.mesh.faces) >= count:
        return Shape(shape.name, simplify(shape.mesh, count))
    return Shape(shape.name, subdivided(resampled(shape, count // 4).mesh))


def fig13(context: Context) -> Page:
    """Weights on a fine mesh, by fields that were trained on all pixels or only on the vertices of a coarse copy."""

    def variants(subject: Subject) -> dict[str, dfd.Deformer]:
        sessions = {}
        whole = context.field(subject.shape, "paper", **COARSE_COPY).settings
        pictures = render(
            subject.shape.mesh, **DistillSettings(**context.distill_settings("paper", **COARSE_COPY)).of_pictures()
        )
        equal = {"steps": len(whole["losses"]), "batch": round(len(pictures.points) * 2 / len(pictures.images))}
        for name, (preset, changes) in KINDS.items():
            more = equal if name == VERTICES_ALONE else {}
            field = context.field(subject.shape, preset, **changes, **more)
            sessions[name] = replace(subject, preset=preset, field=field).pull()
        return sessions

    def measure(subject: Subject, each: dfd.Deformer, fine: dfd.Deformer) -> Row:
        mesh = subject.shape.mesh
        difference = float(area_fractions(mesh) @ np.abs(each.weights - fine.weights)[:, 0])
        return {"roughness": roughness(mesh, each.weights[:, 0]), "mean difference": difference}

    text = (
        f"The coarse copy has {COARSE} faces. The fits to its pixels and its vertices take equal numbers of steps and "
        "samples. Roughness is the mean of |∇W| for weights W on the fine mesh, in units of 1 / diagonal. Mean "
        "difference is the mean of |W − W₀|, where W₀ are the weights by the field of the fine mesh (paper preset)."
    )
    return gallery(context.subjects(PULLED, (1, 2), presets=("paper",)), variants, measure, text)


def fig11(context: Context) -> Page:
    """One deformation, repeated with the features of several image encoders."""

    def angles(subject: Subject, each: dfd.Deformer, _: dfd.Deformer) -> Row:
        return {"angle °": surface_metrics(subject.shape.mesh, each.vertices)["angle °"]}

    return _encoded(context, "after", angles, "The table has the mean change of the angles of faces over the surface.")


def fig12(context: Context) -> Page:
    """The weights of one handle with the features of several image encoders."""

    def correlation(subject: Subject, each: dfd.Deformer, first: dfd.Deformer) -> Row:
        both = np.concatenate([each.weights, first.weights], axis=1)
        covariance = np.cov(both.T, aweights=area_fractions(subject.shape.mesh))
        found = float(covariance[0, 1] / np.sqrt(np.prod(covariance.diagonal())))
        return {"correlation": None if each is first else found}

    text = (
        "The table has the correlation of the weights with those of the first encoder, over the surface. With dfd's "
        "default, a handle's weights end at its part, which depends on the geometry more than on the encoder. So only "
        "the paper preset is compared. The paper shows DINO, CLIP, SAM 2, Diff3F and others."
    )
    return _encoded(context, "weights", correlation, text)


def _encoded(context: Context, shown: str, measure: Callable[..., Row], text: str) -> Page:
    found, absent = encoders(context)

    def variants(subject: Subject) -> dict[str, dfd.Deformer]:
        models = {name: context.loaded(subject.preset, *each) for name, each in found.items()}
        fields = {name: context.field(subject.shape, subject.preset, encoder=model) for name, model in models.items()}
        return {name: replace(subject, field=field).pull() for name, field in fields.items()}

    def named(subject: Subject, each: dfd.Deformer, first: dfd.Deformer) -> Row:
        return {"encoder": each.field.settings.get("encoder"), **measure(subject, each, first)}

    subjects = context.subjects(HELD, (1, 3), presets=("paper",))
    return gallery(subjects, variants, named, text + absent, shown=[shown])


def encoders(context: Context) -> tuple[dict[str, Choice], str]:
    """Return the available encoders by caption, with the default first, and a text that lists the missing ones."""
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
            absent[name] = one_line(error)
    if len(found) > 1 and all(each[0] == own.name for each in found.values()):
        absent_text = f" ({next(iter(absent.values()))})" if absent else ""
        return found, f"\n\nAll features are from blocks of one encoder: the claim is not decided.{absent_text}"
    return found, f"\n\nNot available here: {', '.join(absent) or 'none'}."


def roughness(mesh: dfd.Mesh, weights: NDArray[np.floating]) -> float:
    """Return the mean of |∇W| over the surface for weights (V,), in units of 1 / diagonal of the bounding box."""
    faces = mesh.faces[(areas := face_areas(mesh.vertices, mesh.faces)) > 0].astype(np.int64)
    slopes = (igl.grad(mesh.vertices, faces) @ weights.astype(np.float64)).reshape(3, -1)
    return float(np.average(np.linalg.norm(slopes, axis=0), weights=areas[areas > 0]) * mesh.diagonal)


def subdivided(mesh: dfd.Mesh) -> dfd.Mesh:
    """Split every face into four, and return the mesh without colors and textures."""
    return dfd.Mesh(*trimesh.remesh.subdivide(mesh.vertices, mesh.faces))


def fig19(context: Context, copies: Sequence[int] = (1000, 5000)) -> Page:
    """Weights by one field, on other tessellations of its shape and on other shapes of the same class."""
    retriangulated: list[dfd.Mesh] = []

    def variants(subject: Subject) -> dict[str, dfd.Deformer]:
        shape, field, others = subject.shape, subject.field, subject.case.others
        meshes = [shape.mesh, *(simplify(shape.mesh, count) for count in copies), subdivided(shape.mesh)]
        named = {f"{len(each.faces):,} faces": each for each in meshes}
        retriangulated.extend(meshes)
        known = [name for name in others if name in context.files or name in context.made]
        named.update({name: in_box_of(turned(context.shape(name), others[name]), shape.mesh) for name in known})
        held, sessions = field(shape.mesh.vertices[[shape.at(subject.case.at)]]), {}
        for name, mesh in named.items():
            features = field(mesh.vertices)
            handle = {"at": int(np.linalg.norm(features - held, axis=1).argmin()), "translation": DOWN * mesh.diagonal}
            sessions[name] = replace(subject, shape=Shape(name, mesh)).session([handle], features=features)
        return sessions

    def measure(subject: Subject, each: dfd.Deformer, first: dfd.Deformer) -> Row:
        alike, area = (agreement(each.mesh, subject.case, each.following[:, 0]), following(each))
        if each is first:
            return {"agreement %": alike, "follows %": area}
        copy = any(each.mesh is mesh for mesh in retriangulated)
        own = following(first)
        areas = {"area, larger / smaller": max(area, own) / max(min(area, own), 1e-9)} if copy else {}
        return {"follows %": area, f"agreement of {'copies' if copy else 'other shapes'} %": alike, **areas}

    text = (
        "Another shape of the class is first rotated to face the same direction, and scaled into the bounding box of "
        "the distilled shape. Its handle is the vertex with the feature most similar to that of the first handle. "
        f"follows: percentage of the area with a weight above {HALF}. area: this percentage on the copy and on the "
        "first mesh, the larger divided by the smaller."
    )
    return gallery(context.subjects(CASES["classes"], (1, 2)), variants, measure, text)


def turned(shape: Shape, degrees: float) -> dfd.Mesh:
    """Return the shape rotated about y, with long edges halved, and without colors and textures."""
    refined = shape.refined().mesh
    return dfd.Mesh(Rotation.from_euler("y", degrees, degrees=True).apply(np.array(refined.vertices)), refined.faces)


def in_box_of(mesh: dfd.Mesh, other: dfd.Mesh) -> dfd.Mesh:
    """Return `mesh`, scaled along each axis to fit the bounding box of `other`."""
    scales = other.extents / np.maximum(mesh.extents, 1e-12)
    return dfd.Mesh(other.bounds[0] + (mesh.vertices - mesh.bounds[0]) * scales, mesh.faces)


def fig20(context: Context) -> Page:
    """Weights of handles on the same parts of different shapes of one class."""

    def selected(subject: Subject, each: dfd.Deformer, _: dfd.Deformer) -> Row:
        [handle] = each.handles
        case = CASES["parts"][handle.name]
        return {"agreement %": agreement(each.mesh, case, each.following[:, 0]), "follows %": following(each)}

    return gallery(
        context.subjects(CHAIRS, (3, 6), refined=True),
        lambda subject: {
            part: subject.session([{"at": subject.shape.at(CASES["parts"][part].at), "name": part}])
            for part in subject.case
        },
        selected,
        f"follows: percentage of the surface area with a weight above {HALF}, for a handle on each part.",
        shown=["weights"],
        azimuth=35.0,
    )
