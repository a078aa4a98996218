"""Pages that show features: distillation (Fig. 4, 13), encoders (Fig. 11, 12), and other shapes (Fig. 19, 20)."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import dfd
from bench.paper.distortion import surface_metrics
from bench.paper.page import Page, Pictures, Row, aim, following, gallery
from bench.paper.subjects import NAMES, PRESETS, Context, Shape, Subject, pulls_of
from bench.quality.measures import area_fractions
from dfd.common.errors import one_line
from dfd.common.linear_algebra import Float64
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.distillation.settings import DistillSettings
from dfd.encoders.known import DEFAULT_ENCODER, KNOWN_ENCODERS
from dfd.geometry.simplify import simplify
from dfd.geometry.topology import face_areas
from dfd.pictures.colors import feature_colors
from dfd.pictures.picture import picture
from dfd.views.render import Supervision, Views, render

DISTILLED = dict.fromkeys(("koala", "plane_holes", "scorpion", "spot", "quadruped"))
LUCY = (200_000, 28_000_000)  # number of faces in a quick and in a full run; the paper's scan Lucy has 28 million
CHUNK = 500_000  # largest number of vertices whose features are computed in one call, to limit the memory
SUPERVISION: dict[str, Supervision] = {"pixels of vertices": "vertex", "pixels of triangles": "barycentric"}

COARSE = 200  # number of faces of the coarse copy; each face is much larger than the details of the features
VERTICES_ALONE = "paper preset, coarse copy, vertices alone"
PULLED = pulls_of("koala", "scorpion", "human_neutral", "quadruped")
COARSE_COPY: dict[str, Any] = {"simplify_to": COARSE}
KINDS: dict[str, tuple[Preset, dict[str, Any]]] = {  # for each field of Fig. 13, the preset and the changed settings
    "paper preset, fine mesh, all pixels": ("paper", {}),
    VERTICES_ALONE: ("paper", {**COARSE_COPY, "supervision": "vertex"}),
    "paper preset, coarse copy, all pixels": ("paper", COARSE_COPY),
    "dfd default, coarse copy": ("default", COARSE_COPY),
}

Choice = tuple[str, int | None]  # an encoder's name, and the block that gives its tokens; None is its default block
OTHERS = tuple(name for name in KNOWN_ENCODERS if name != DEFAULT_ENCODER)
BLOCKS = (3, 6, 9, 12)
HELD = pulls_of("spot", "scorpion", "human_neutral", "quadruped")

# For each distilled shape: the handle's position, as fractions of the bounding box, and other shapes of its class, each
# with an angle in degrees. Rotated about y by this angle, the other shape faces the same way as the distilled shape.
CLASSES = {
    "spot": ((0.2, 0.0, 0.2), {"quadruped": 180, "horse": 180, "alpaca": 180}),
    "fox": ((0.2, 0.0, 0.8), {"wolf": 0, "horse": 0}),
    "quadruped": ((0.2, 0.0, 0.85), {}),
}
DOWN = np.array([0.0, -0.12, 0.0])  # translation, as a fraction of the diagonal

# For each chair: the handle's position on each part, as fractions of the bounding box.
LEG, SEAT, BACK = (0.0, 0.0, 1.0), (0.5, 0.5, 0.7), (0.5, 1.0, 0.15)
CHAIR = {"leg": LEG, "seat": SEAT, "back": BACK}
CHAIRS = {
    "kaykit_chair_A": CHAIR,
    "chair_2": CHAIR,
    "kaykit_armchair": {"seat": (0.5, 0.45, 0.8), "back": BACK, "arm": (0.08, 0.75, 0.75)},  # it has no legs
    "couch_small1": {**CHAIR, "arm": (0.05, 0.85, 0.8)},
    "chair": CHAIR,
    "bench_1": {**CHAIR, "seat": (0.5, 0.45, 0.7), "arm": (0.0, 0.65, 0.7)},
}
FOLLOWS = 0.5  # A vertex follows the handle if its weight is above this.


def fig4(context: Context) -> Page:
    """A shape and its copy with 1 % of the faces: their fields, the number of training pixels, and computing times."""
    rows: list[Row] = []
    drawn: list[Pictures] = []
    for given, _ in context.cases(DISTILLED, (1, 2)):
        shape = resampled(given, context.quick_or_full(LUCY))
        mesh = shape.mesh
        few = simplify(mesh, max(500, len(mesh.faces) // 100))
        pixels = {"vertices": len(few.vertices)} | {
            name: _distinct_pixels(render(few, views=8, resolution=252, framing="paper", supervision=kind))
            for name, kind in SUPERVISION.items()
        }
        where = aim(mesh, np.empty((0, 3)))
        row = [(picture(each, **where), f"{len(each.faces):,} faces") for each in (mesh, few)]
        for preset in PRESETS:
            begin = time.perf_counter()
            field, distill_seconds, _ = distilled(context, shape, preset)
            handle = field(mesh.vertices[[shape.at((0.5, 1.0, 0.5))]])
            for some in np.array_split(mesh.vertices, len(mesh.vertices) // CHUNK + 1):
                dfd.bind(field(some), handle)
            seconds = {"distill s": distill_seconds, "weights s": time.perf_counter() - begin}
            of_few = context.field(Shape(f"{shape.name} reduced", few), preset)(few.vertices)
            own = field(few.vertices)
            # Colors depend on the main directions of the features, so both fields must be colored together.
            colors = np.split(feature_colors(np.concatenate([own, of_few])), 2)
            for some, what in zip(colors, ("the shape", "the reduced shape"), strict=True):
                row.append((picture(few, colors=some, **where), f"{NAMES[preset]}: field of {what}"))
            start = {"shape": shape.name, "preset": NAMES[preset], "faces": len(mesh.faces)}
            off, spread = (float(np.linalg.norm(own - other, axis=1).mean()) for other in (of_few, own.mean(axis=0)))
            rows.append({**start, **pixels, **seconds, "mean distance": off, "spread": spread})
        drawn.append((shape.name, row))
    text = (
        "The reduced shape has 1 % of the faces. The table counts its vertices. It also counts the pixels, in eight "
        "pictures of 252² pixels, that contain a vertex or that triangles cover. The time of the weights includes the "
        "distillation. Mean distance is the mean distance between the features of both fields at a vertex. Spread is "
        "the mean distance of the features of the shape's field from their mean. In the paper, rendering one picture "
        "of the scan Lucy takes 5.7 min. Simplifying Lucy to 1 % of its faces and rendering one picture takes 3.7 s."
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


def _distinct_pixels(views: Views) -> int:
    """Return the number of pixels that contain at least one training point, summed over all pictures."""
    return len(np.unique(np.stack([views.view, np.rint(views.row), np.rint(views.column)]), axis=1).T)


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
            if name == VERTICES_ALONE:
                changes = {**changes, **equal}
            field = context.field(subject.shape, preset, **changes)
            sessions[name] = replace(subject, preset=preset, field=field).pull()
        return sessions

    def measure(subject: Subject, each: dfd.Deformer, fine: dfd.Deformer) -> Row:
        mesh = subject.shape.mesh
        difference = float(area_fractions(mesh) @ np.abs(each.weights - fine.weights)[:, 0])
        compared = {"mean difference": difference if each.preset == "paper" else None}
        return {"roughness": roughness(mesh, each.weights[:, 0]), **compared}

    text = (
        f"The coarse copy has {COARSE} faces, which are larger than the details of the features. The fit to all its "
        "pixels and the fit to its vertices take the same number of steps, each with the same number of samples. "
        "Roughness is the mean of |∇W| for weights "
        "W on the fine mesh, in units of 1 / diagonal. Mean difference is the mean of |W − W₀|, where W₀ are the "
        "weights by the field of the fine mesh (paper preset)."
    )
    return gallery(context.subjects(PULLED, (1, 2), presets=("paper",)), variants, measure, text)


def fig11(context: Context) -> Page:
    """One deformation, repeated with the features of several image encoders."""

    def angles(subject: Subject, each: dfd.Deformer, _: dfd.Deformer) -> Row:
        return {"angle °": surface_metrics(subject.shape.mesh, each.vertices)["angle °"]}

    text = "The table has the mean change of the angles of faces over the surface."
    return _encoded(context, "after", angles, text)


def fig12(context: Context) -> Page:
    """The weights of one handle with the features of several image encoders."""

    def correlation(subject: Subject, each: dfd.Deformer, first: dfd.Deformer) -> Row:
        both = np.concatenate([each.weights, first.weights], axis=1)
        covariance = np.cov(both.T, aweights=area_fractions(subject.shape.mesh))
        found = float(covariance[0, 1] / np.sqrt(np.prod(covariance.diagonal())))
        return {"correlation": None if each is first else found}

    text = (
        "The table has the correlation of the weights with those of the first encoder, over the surface. Only the "
        "paper preset is compared: with dfd's default, a handle's weights end at its part, for which the geometry "
        "also counts, so that all encoders give nearly the same weights. The paper shows DINO, CLIP, SAM 2, Diff3F "
        "and others."
    )
    return _encoded(context, "weights", correlation, text)


def _encoded(context: Context, shown: str, measure: Callable[..., Row], text: str) -> Page:
    found, absent = encoders(context)

    def variants(subject: Subject) -> dict[str, dfd.Deformer]:
        models = {name: context.loaded(subject.preset, *each) for name, each in found.items()}
        fields = {name: context.field(subject.shape, subject.preset, encoder=model) for name, model in models.items()}
        return {name: replace(subject, field=field).pull() for name, field in fields.items()}

    subjects = context.subjects(HELD, (1, 3), presets=("paper",))
    return gallery(subjects, variants, measure, text + absent, shown=[shown])


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
    if not absent:
        return found, ""
    return found, f"\n\nNot available here: {', '.join(absent)}. The first error: {next(iter(absent.values()))}"


def roughness(mesh: dfd.Mesh, weights: NDArray[np.floating]) -> float:
    """Return the mean of |∇W| over the surface for weights (V,), in units of 1 / diagonal of the bounding box."""
    faces = mesh.faces[(areas := face_areas(mesh.vertices, mesh.faces)) > 0].astype(np.int64)
    slopes = (igl.grad(mesh.vertices, faces) @ weights.astype(np.float64)).reshape(3, -1)
    return float(np.average(np.linalg.norm(slopes, axis=0), weights=areas[areas > 0]) * mesh.diagonal)


def subdivided(mesh: dfd.Mesh) -> dfd.Mesh:
    """Split every face into four, and return the mesh without colors and textures."""
    return dfd.Mesh(*trimesh.remesh.subdivide(mesh.vertices, mesh.faces))


def fig19(context: Context) -> Page:
    """Weights by one field, on other tessellations of its shape and on other shapes of the same class."""

    def variants(subject: Subject) -> dict[str, dfd.Deformer]:
        shape, field, (place, others) = subject.shape, subject.field, subject.case
        copies = [shape.mesh, *(simplify(shape.mesh, count) for count in (1000, 5000)), subdivided(shape.mesh)]
        known = [name for name in others if name in context.files or name == "quadruped"]
        meshes = {f"{len(each.faces):,} faces": each for each in copies}
        meshes.update({name: turned(context.shape(name), others[name]) for name in known})
        held, sessions = field(shape.mesh.vertices[[shape.at(place)]]), {}
        for name, mesh in meshes.items():
            features = field(in_box_of(mesh, shape.mesh) if name in known else mesh.vertices)
            handle = {"at": int(np.linalg.norm(features - held, axis=1).argmin()), "translation": DOWN * mesh.diagonal}
            sessions[name] = replace(subject, shape=Shape(name, mesh)).session([handle], features=features)
        return sessions

    def measure(subject: Subject, each: dfd.Deformer, first: dfd.Deformer) -> Row:
        mesh, weights, difference = each.mesh, each.weights[:, 0], None
        distance, nearest = KDTree(mesh.vertices).query(first.mesh.vertices)
        if each is not first and distance.max() < 0.1 * mesh.diagonal:  # another tessellation of the same shape
            difference = float(np.abs(weights[nearest] - first.weights[:, 0]).mean())
        follows = 100 * float(area_fractions(mesh)[weights > FOLLOWS].sum())
        return {"faces": len(mesh.faces), "follows %": follows, "mean difference": difference}

    text = (
        "For another tessellation, the field is evaluated at its vertices. Another shape of the class is first rotated "
        "to face the same direction, and scaled into the bounding box of the distilled shape. Its handle is the vertex "
        "with the feature most similar to the feature of the first handle. The table has the percentage of the surface "
        f"area with a weight above {FOLLOWS}, and the mean difference from the weights on the first mesh."
    )
    return gallery(context.subjects(CLASSES, (1, 2)), variants, measure, text)


def turned(shape: Shape, degrees: float) -> dfd.Mesh:
    """Return the shape rotated about y, with long edges halved, and without colors and textures."""
    refined = shape.refined().mesh
    return dfd.Mesh(Rotation.from_euler("y", degrees, degrees=True).apply(np.array(refined.vertices)), refined.faces)


def in_box_of(mesh: dfd.Mesh, other: dfd.Mesh) -> Float64:
    """Return the vertices of `mesh`, scaled along each axis to fit the bounding box of `other`."""
    return other.bounds[0] + (mesh.vertices - mesh.bounds[0]) / np.maximum(mesh.extents, 1e-12) * other.extents


def fig20(context: Context) -> Page:
    """Weights of handles on the same parts of different shapes of one class."""
    return gallery(
        context.subjects(CHAIRS, (3, 6), refined=True),
        lambda subject: {
            part: subject.session([{"at": subject.shape.at(place)}]) for part, place in subject.case.items()
        },
        lambda _, each, __: {"follows %": following(each, FOLLOWS)},
        f"The table has the percentage of the surface area with a weight above {FOLLOWS}, for a handle on each part.",
        shown=["weights"],
        azimuth=35.0,
    )
