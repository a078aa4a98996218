"""Pages about features: distillation (Fig. 4, 13), encoders (Fig. 11, 12), and other shapes (Fig. 19, 20)."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree

import dfd
from bench.paper.page import (
    NAMES,
    PRESETS,
    Context,
    Page,
    Section,
    Shape,
    Table,
    aim,
    before_after,
    blank,
    heat,
    pulls_of,
    session,
)
from bench.quality.measures import area_fractions
from dfd.common.linear_algebra import Float64
from dfd.common.preset import Preset
from dfd.encoders.known import DEFAULT_ENCODER, KNOWN_ENCODERS
from dfd.geometry.metrics import surface_metrics
from dfd.geometry.simplify import simplify
from dfd.geometry.topology import face_areas
from dfd.pictures.colors import feature_colors
from dfd.pictures.picture import picture
from dfd.pictures.viewpoint import azimuth_towards
from dfd.views.render import Supervision, Views, render

DISTILLED = dict.fromkeys(("koala", "plane_holes", "scorpion", "spot", "quadruped", "*"))
REDUCED = 0.99
SUPERVISION: tuple[Supervision, ...] = ("vertex", "barycentric")

COARSE = 1000  # faces, 1 % of the fine shapes': the paper reduces by 99 %
PULLED = pulls_of("koala", "scorpion", "human_neutral", "quadruped")
COARSE_COPY: dict[str, Any] = {"simplify_to": COARSE}
KINDS: dict[str, tuple[Preset, dict[str, Any]]] = {  # columns: the preset, and what is changed of it
    "paper preset, fine copy, all pixels": ("paper", {}),
    "paper preset, coarse copy, vertices alone": ("paper", {**COARSE_COPY, "supervision": "vertex"}),
    "paper preset, coarse copy, all pixels": ("paper", COARSE_COPY),
    "dfd default, coarse copy": ("default", COARSE_COPY),
}

Choice = tuple[str, int | None]  # an encoder's name, and the block whose tokens are taken; None is its own choice
OTHERS = tuple(name for name in KNOWN_ENCODERS if name != DEFAULT_ENCODER)
BLOCKS = (3, 6, 9, 12)
HELD = pulls_of("spot", "scorpion", "human_neutral", "quadruped")

# The shape that is distilled, where it is taken hold of, and others of its class with the angle, in degrees about y,
# that turns them to look the same way.
CLASSES = {
    "spot": ((0.2, 0.0, 0.2), {"quadruped": 180, "horse": 180, "alpaca": 180}),
    "fox": ((0.2, 0.0, 0.8), {"wolf": 0, "horse": 0}),
    "quadruped": ((0.2, 0.0, 0.85), {}),
    "*": ((0.0, 0.0, 1.0), {}),
}
DOWN = np.array([0.0, -0.12, 0.0])  # of the diagonal

LEG, SEAT, BACK = (0.0, 0.0, 1.0), (0.5, 0.5, 0.7), (0.5, 1.0, 0.15)
CHAIR = {"leg": LEG, "seat": SEAT, "back": BACK}
CHAIRS = {
    "kaykit_chair_A": CHAIR,
    "chair_2": CHAIR,
    "kaykit_armchair": {**CHAIR, "seat": (0.5, 0.45, 0.8), "arm": (0.08, 0.75, 0.75)},
    "couch_small1": {**CHAIR, "arm": (0.05, 0.85, 0.8)},
    "chair": CHAIR,
    "bench_1": {**CHAIR, "seat": (0.5, 0.45, 0.7), "arm": (0.0, 0.65, 0.7)},
    "*": CHAIR,
}
PARTS = ("leg", "seat", "back", "arm")
FOLLOWS = 0.5


def fig4(context: Context) -> Page:
    """Pixels that teach a field, and fields of the shape and of a hundredth of its faces."""
    pixels: list[list[Any]] = []
    reduced: list[list[Any]] = []
    drawn = []
    for shape, _ in context.cases(DISTILLED, (1, 4)):
        mesh = shape.mesh
        counts = [
            _distinct_pixels(render(mesh, views=8, resolution=252, framing="paper", supervision=kind))
            for kind in SUPERVISION
        ]
        pixels.append([shape.name, len(mesh.vertices), *counts])
        begin = time.perf_counter()
        few = simplify(mesh, max(500, round((1 - REDUCED) * len(mesh.faces))))
        seconds = time.perf_counter() - begin
        where = aim(mesh, np.empty((0, 3)))
        row = [(picture(each, **where), f"{len(each.faces):,} faces") for each in (mesh, few)]
        for preset in PRESETS:
            own = context.field(shape, preset).features(mesh)
            of_few = context.field(Shape(f"{shape.name} reduced", few), preset).features(mesh)
            # Colors of both by the same directions; fields of two fits have their own turn of feature space.
            colors = feature_colors(np.concatenate([own, of_few]))
            row += [
                (picture(mesh, colors=some, **where), f"{NAMES[preset]}: field of {what}")
                for some, what in zip(np.split(colors, 2), ("the shape", "the reduced one"), strict=True)
            ]
            off = np.linalg.norm(own - of_few, axis=1).mean()
            spread = np.linalg.norm(own - own.mean(axis=0), axis=1).mean()
            reduced.append([shape.name, NAMES[preset], len(few.faces), seconds, float(off), float(spread)])
        drawn.append((shape.name, row))
    first = (
        "Eight pictures of 252². Other methods learn from the pixels that a vertex falls into, barycentric "
        "distillation from every pixel that a triangle covers."
    )
    second = (
        "Fields distilled from the shape and from the reduced one, both evaluated at the shape's vertices; the "
        "distance of the two beside the spread of the features. The paper: Lucy, 28 million faces, takes 5.7 minutes "
        "to render and 3.7 s to reduce by 99 % and render."
    )
    look_for = "All pixels of the shape teach, not one a vertex; the reduced shape looks like the whole one."
    columns = ["shape", "vertices", "pixels of vertices", "pixels of triangles"]
    of_reduced = ["shape", "preset", "faces", "seconds to reduce", "mean distance", "spread"]
    sections = [
        Section("Pixels", first, table=Table(columns, pixels)),
        Section("Reduced by 99 %", second, drawn, Table(of_reduced, reduced)),
    ]
    return Page("Fig. 4: barycentric feature distillation", look_for, sections)


def _distinct_pixels(views: Views) -> int:
    """How many pixels of all pictures show a point, each counted once however many vertices fall into it."""
    return len(np.unique(np.stack([views.view, np.rint(views.row), np.rint(views.column)]), axis=1).T)


def fig13(context: Context) -> Page:
    """Barycentric distillation against vertices alone, from coarse to fine."""
    drawn, rows, lengths = [], [], []
    for shape, case in context.cases(PULLED, (1, 2)):
        mesh, handle = shape.mesh, case.on(shape)
        sessions: dict[str, dfd.Deformer] = {}
        steps = len(context.field(shape, "paper", **COARSE_COPY).settings["losses"])
        lengths.append(f"{shape.name} {steps:,}")
        for name, (preset, changes) in KINDS.items():
            length = {"steps": steps} if "supervision" in changes else {}
            sessions[name] = session(mesh, context.field(shape, preset, **changes, **length), preset, [handle])
        where = aim(mesh, mesh.vertices[[handle["at"]]], *(each.vertices for each in sessions.values()))
        pairs = {name: before_after(each, where) for name, each in sessions.items()}
        copy = simplify(mesh, COARSE)
        first = {
            "weights": (picture(copy, **where), f"the coarse copy, {len(copy.faces):,} faces"),
            "moved": (picture(mesh, handles=[handle["at"]], **where), f"the fine mesh, {len(mesh.faces):,} faces"),
        }
        for column, (what, image) in enumerate(first.items()):
            found = [(pair[column][0], name) for name, pair in pairs.items()]
            drawn.append((f"{shape.name}: {what}", [image, *found]))
        areas, fine = area_fractions(mesh), next(iter(sessions.values())).weights[:, 0]
        for name, each in sessions.items():
            weights = each.weights[:, 0]
            off = float(areas @ np.abs(weights - fine)) if KINDS[name][0] == "paper" else None
            rows.append([shape.name, name, roughness(mesh, weights), off])
    text = (
        f"Fits of the {NAMES['paper']} to the coarse copy take the same number of steps, as many as its epochs over "
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


def fig11(context: Context) -> Page:
    """One deformation with the features of several image encoders."""
    drawn, rows = [], []
    found, absent = encoders(context)
    for shape, case in context.cases(HELD, (1, 3)):
        handle = case.on(shape)
        source = shape.mesh.vertices[[handle["at"]]]
        target = source + handle["translation"]
        for preset in PRESETS:
            moved = {name: _pulled(context, shape, handle, preset, each).vertices for name, each in found.items()}
            where = aim(shape.mesh, source, *moved.values())
            images = [(picture(shape.mesh, handles=source, **where), "source")]
            for name, vertices in moved.items():
                images.append((picture(shape.mesh, vertices=vertices, handles=target, **where), name))
                metrics = surface_metrics(shape.mesh, vertices)
                change = [100 * metrics.area, metrics.angle, metrics.flipped_faces]
                rows.append([shape.name, NAMES[preset], name, *change])
            drawn.append((f"{shape.name}, {NAMES[preset]}", images))
    text = "No fixed point, no regularization. In the table: mean changes over the surface." + absent
    table = Table(["shape", "preset", "encoder", "area %", "angle °", "flipped faces"], rows)
    look_for = "With every encoder what looks like the pulled part comes along, and the surface stays smooth."
    title = "Fig. 11: deformations with other image models"
    return Page(title, look_for, [Section("One pull", text, drawn, table)])


def fig12(context: Context) -> Page:
    """The weights of one handle with the features of several image encoders."""
    drawn, rows = [], []
    found, absent = encoders(context)
    for shape, case in context.cases(HELD, (1, 3)):
        at, areas = shape.at(case.at), area_fractions(shape.mesh)
        for preset in PRESETS:
            weights = {
                name: _pulled(context, shape, {"at": at}, preset, encoder).weights[:, 0]
                for name, encoder in found.items()
            }
            where = aim(shape.mesh, shape.mesh.vertices[[at]])
            images = [(heat(shape.mesh, values, [at], **where), name) for name, values in weights.items()]
            drawn.append((f"{shape.name}, {NAMES[preset]}", images))
            reference = next(iter(weights.values()))
            for name, values in weights.items():
                rows.append([shape.name, NAMES[preset], name, correlation(values, reference, areas)])
    text = (
        "In the table: the correlation over the surface with the weights of the first encoder. The paper shows DINO, "
        "CLIP, SAM 2, Diff3F and others." + absent
    )
    table = Table(["shape", "preset", "encoder", "correlation"], rows)
    look_for = "All encoders light up the same parts; some tell a part from its surroundings more sharply than others."
    return Page("Fig. 12: different encoders", look_for, [Section("Weights of one handle", text, drawn, table)])


def _pulled(context: Context, shape: Shape, handle: dict[str, Any], preset: Preset, encoder: Choice) -> dfd.Deformer:
    field = context.field(shape, preset, encoder=context.loaded(preset, *encoder))
    return session(shape.mesh, field, preset, [handle])


def encoders(context: Context) -> tuple[dict[str, Choice], str]:
    """Return encoders by what a page calls them, the default first; and a sentence about those that are missing."""
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
    if not absent:
        return found, ""
    return found, f"\n\nNot available here: {', '.join(absent)}. The first one: {next(iter(absent.values()))}"


def correlation(first: NDArray[np.floating], second: NDArray[np.floating], areas: Float64) -> float:
    """Pearson's correlation of weights (V,) over a surface whose vertices have `areas` (V,) that sum to 1."""
    a, b = (values - areas @ values for values in (first.astype(float), second.astype(float)))
    return float(areas @ (a * b) / max(np.sqrt((areas @ a**2) * (areas @ b**2)), 1e-12))


def roughness(mesh: dfd.Mesh, weights: NDArray[np.floating]) -> float:
    """Return the mean of |∇W| over the surface for weights (V,), in weight per diagonal of the box."""
    import igl

    faces = mesh.faces[(areas := face_areas(mesh.vertices, mesh.faces)) > 0].astype(np.int64)
    slopes = (igl.grad(mesh.vertices, faces) @ weights.astype(np.float64)).reshape(3, -1)
    return float(np.average(np.linalg.norm(slopes, axis=0), weights=areas[areas > 0]) * mesh.diagonal)


def subdivided(mesh: dfd.Mesh, times: int) -> dfd.Mesh:
    """Return the mesh with every face cut into four, `times` times over; holes stay, appearance goes."""
    vertices, faces = mesh.vertices, mesh.faces
    for _ in range(times):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return mesh if times == 0 else dfd.Mesh(vertices, faces)


def fig19(context: Context) -> Page:
    """One field on other tessellations of a shape, and on other shapes of its class."""
    drawn, rows = [], []
    for subject in context.subjects(CLASSES, (1, 2)):
        shape, field, (place, others) = subject.shape, subject.field, subject.case
        at = shape.at(place)
        azimuth = azimuth_towards(shape.mesh, shape.mesh.vertices[[at]])
        own = subject.session([{"at": at}]).weights[:, 0]
        tessellations = [simplify(shape.mesh, count) for count in (1000, 5000)]
        copies = {f"{len(each.faces):,} faces": each for each in (*tessellations, subdivided(shape.mesh, 1))}
        copies = {f"{len(shape.mesh.faces):,} faces, its own": shape.mesh, **copies}
        known = [name for name in others if name in context.files or name == "quadruped"]
        novel = {name: turned(context.shape(name), others[name]) for name in known}
        weights_row, moved_row = [], []
        for name, mesh in {**copies, **novel}.items():
            features = field(mesh.vertices if name in copies else in_box_of(mesh, shape.mesh))
            same = np.linalg.norm(features - field(shape.mesh.vertices[[at]]), axis=1).argmin()
            handle = {"at": int(same), "translation": DOWN * mesh.diagonal}
            deformer = session(mesh, field, subject.preset, [handle], features=features)
            (weighted, _), (moved, _) = before_after(deformer, aim(mesh, (), deformer.vertices, azimuth=azimuth))
            weights_row.append((weighted, name))
            moved_row.append((moved, name))
            weights = deformer.weights[:, 0]
            off = np.abs(weights[KDTree(mesh.vertices).query(shape.mesh.vertices)[1]] - own).mean()
            follows = 100 * float(area_fractions(mesh)[weights > FOLLOWS].sum())
            rows.append([*subject.label, name, len(mesh.faces), follows, float(off) if name in copies else None])
        drawn.append((f"field of {', '.join(subject.label)}: weights", weights_row))
        drawn.append(("moved", moved_row))
    text = (
        "Other tessellations ask the field at their own vertices. Another shape of the class is turned to look the "
        "same way and scaled to the box; its handle is the vertex whose feature is nearest to that of the handle. In "
        f"the table: how much of the surface has a weight above {FOLLOWS}, and the mean difference between the weight "
        "at each vertex of the shape's own mesh and that at the nearest vertex of the other."
    )
    columns = ["field of", "preset", "mesh", "faces", "follows, % of the area", "mean difference"]
    look_for = "All legs come along with the one that is pulled, on every tessellation and on the other animals too."
    return Page("Fig. 19: weight generalization", look_for, [Section("One field", text, drawn, Table(columns, rows))])


def turned(shape: Shape, degrees: float) -> dfd.Mesh:
    """The shape turned about y, its long edges halved, without its appearance."""
    angle = np.radians(degrees)
    rotation = np.array([(np.cos(angle), 0, np.sin(angle)), (0, 1, 0), (-np.sin(angle), 0, np.cos(angle))])
    refined = shape.refined().mesh
    return dfd.Mesh(refined.vertices @ rotation.T, refined.faces)


def in_box_of(mesh: dfd.Mesh, other: dfd.Mesh) -> Float64:
    """The vertices of `mesh` scaled, side by side, into the box of `other`."""
    low, high = mesh.bounds
    begin, end = other.bounds
    return begin + (mesh.vertices - low) / np.maximum(high - low, 1e-12) * (end - begin)


def fig20(context: Context) -> Page:
    """Weights of the same parts on different shapes of one class."""
    drawn: dict[str, list[Any]] = {NAMES[preset]: [] for preset in PRESETS}
    rows: dict[str, list[Any]] = {NAMES[preset]: [] for preset in PRESETS}
    for subject in context.subjects(CHAIRS, (3, 6), refined=True):
        shape, preset = subject.shape, NAMES[subject.preset]
        areas = area_fractions(shape.mesh)
        images, numbers = [(blank(), "")] * len(PARTS), [None] * len(PARTS)
        for part, place in subject.case.items():
            at, column = shape.at(place), PARTS.index(part)
            weights = subject.session([{"at": at}]).following[:, 0]
            images[column] = (heat(shape.mesh, weights, [at], **aim(shape.mesh, [], azimuth=35.0)), part)
            numbers[column] = 100 * float(areas[weights > FOLLOWS].sum())
        drawn[preset].append((shape.name, images))
        rows[preset].append([shape.name, *numbers])
    text = f"In the table: how much of the surface, in % of its area, has a weight above {FOLLOWS} for each part."
    sections = [Section(name, text, drawn[name], Table(["shape", *PARTS], rows[name])) for name in drawn]
    look_for = "In a column the same part lights up on every chair: all legs, the seat, the back, both arms."
    return Page("Fig. 20: consistent weights within a class", look_for, sections)
