"""Pages about seconds and about meshes that are large or broken: Fig. 10, 17 and 18, and Table 3."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

import dfd
from bench.paper.comparisons import farthest
from bench.paper.features import subdivided
from bench.paper.page import NAMES, PRESETS, Context, Page, Section, Shape, Table, aim, before_after, pulls_of, session
from bench.paper.peers import PEERS
from bench.paper.peers.peer import Job, PeerError, run
from bench.quality.measures import components_of
from bench.speed.measure import measure
from dfd.common.linear_algebra import Int64
from dfd.common.preset import Preset
from dfd.common.progress import Stages
from dfd.geometry.simplify import simplify
from dfd.geometry.topology import face_components, first_at_place, inspect
from dfd.pictures.picture import picture

PHASES = ("preprocess", "bind", "pose")
TIMED = dict.fromkeys(("koala", "scorpion", "spot", "quadruped", "*"))
FACES = (1_000, 10_000, 100_000, 400_000, 1_600_000)
PATIENCE = (40.0, 600.0)  # seconds for a peer's tetrahedra, and for all else that it does, in a quick and a whole run
PEER_HANDLES = 10  # farthest points: other methods need several

BROKEN = pulls_of("truck_defects", "chair_nonmanifold", "plane_holes", "knight", "robot")
PAPER_DEFECTS = ("the paper's example", 3804, 70, 12)
BOUNDARY, CROWDED, CLAY = (0.85, 0.15, 0.1), (0.1, 0.2, 0.9), (0.82, 0.81, 0.78)

LARGE = {"koala": 2, "plane_holes": 1, "scorpion": 1, "quadruped": 2, "*": 0}  # how often faces are cut into four
RENDERING = ("simplify", "render")  # the stages that the paper's R counts

COUNTS = (1, 10, 100)
SOLID = ("spot", "koala", "fox", "scorpion", "shark", "boat", "quadruped")
REBOUND = dict.fromkeys((*SOLID, "kaykit_chair_A", "table_roundlarge", "chair", "*"))
# The paper's Table 3, on one A40: means over 20 shapes and 1,000 random sets of each.
PAPER_SECONDS = [
    ["paper: DFD", None, 0.004, 0.012, 0.034],
    ["paper: biharmonic by OptCtrlPoints", None, 4.6, 11.35, 21.8],
]


def distilled(context: Context, shape: Shape, preset: Preset) -> tuple[dfd.Field, float, Stages]:
    """A field with nothing taken from the cache, its seconds without loading the encoder, and its stages."""
    model, stages = context.loaded(preset), Stages(show=False)
    begin = time.perf_counter()
    field = context.field(shape, preset, encoder=model, stages=stages)
    return field, time.perf_counter() - begin, stages


def fig10(context: Context) -> Page:
    """Seconds of every method to preprocess, bind and pose over the number of faces."""
    rows: list[list[Any]] = []
    for given, _ in context.cases(TIMED, (1, 3)):
        able = ["ARAP", "biharmonic", "NeuralMLS"]  # those of the paper's plot
        for count in FACES[:3] if context.quick else FACES:
            shape = resampled(given, count)
            start = [shape.name, len(shape.mesh.faces)]
            for preset in PRESETS:
                context.say(f"{shape.name}, {len(shape.mesh.faces):,} faces, {NAMES[preset]}")
                rows.append([*start, NAMES[preset], *_dfd_seconds(context, shape, preset), ""])
            for name in list(able):
                context.say(f"{shape.name}, {len(shape.mesh.faces):,} faces, {name}")
                try:
                    rows.append([*start, name, *_peer_seconds(shape.mesh, name, context.of(PATIENCE)), ""])
                except PeerError as error:
                    able.remove(name)  # it will not do better with more faces
                    rows.append([*start, name, None, None, None, None, str(error)])
    text = (
        "Preprocess: all of `dfd.distill` but loading the encoder; tetrahedra by fTetWild, of all faces, and their "
        "energy for biharmonic coordinates. Bind: the field's forward pass at all vertices and the weights of one "
        f"handle; for other methods {PEER_HANDLES} handles, their systems factored or networks trained. Rebind: the "
        "weights of a further handle of DFD alone. Pose: the moved shape. Medians of repeated calls of DFD, one call "
        f"of the others, which get {context.of(PATIENCE):g} s for their tetrahedra and as many for the rest. A shape "
        "is simplified, or its faces are cut into four, to get near each resolution. The paper's plot has no numbers; "
        "its text says that biharmonic coordinates fail above 10⁵ faces, in the tetrahedra and in binding, that ARAP "
        "and NeuralMLS start higher and grow faster than DFD, and that DFD's preprocessing hardly depends on the "
        "resolution. APAP cannot be had."
    )
    columns = ["shape", "faces", "method", "preprocess s", "bind s", "rebind s", "pose s", "note"]
    series = {
        name: [(row[1], dict(zip(PHASES, (row[3], row[4], row[6]), strict=True))) for row in rows if row[2] == name]
        for name in dict.fromkeys(row[2] for row in rows)
    }
    look_for = "Preprocessing hardly grows with the number of faces; bind and pose grow no faster than it does."
    section = Section("Seconds", text, table=Table(columns, rows), image=plot(series))
    return Page("Fig. 10: method timing", look_for, [section])


def _dfd_seconds(context: Context, shape: Shape, preset: Preset) -> list[float]:
    field, preprocess, _ = distilled(context, shape, preset)
    mesh, vertex = shape.mesh, shape.at((0.5, 1.0, 0.5))
    features = field.features(mesh)
    weights, transform = dfd.bind(features, [vertex]), np.eye(3, 4)[None] + 0.1
    calls: Sequence[Callable[[], object]] = (
        lambda: dfd.bind(field.features(mesh), [vertex]),
        lambda: dfd.bind(features, [vertex]),
        lambda: dfd.pose(mesh.vertices, weights, transform),
    )
    return [preprocess, *(measure(call, seconds=context.of((0.1, 1.0)), least=3).median for call in calls)]


def _peer_seconds(mesh: dfd.Mesh, name: str, patience: float) -> list[float | None]:
    corners = np.unique(mesh.faces)
    handles = corners[farthest(mesh.vertices[corners], PEER_HANDLES)]
    targets = mesh.vertices[handles] + 0.1 * mesh.diagonal * np.eye(PEER_HANDLES, 3)
    job = Job(handles, np.arange(PEER_HANDLES), targets)
    taken = run(PEERS[name], mesh, [job], patience=patience, most_faces=None)[0].seconds
    before = taken["tetrahedra"] + taken["prepare"] if "tetrahedra" in taken else None
    return [before, taken["bind"], None, taken["pose"]]


def resampled(shape: Shape, count: int) -> Shape:
    """The shape with about `count` faces: faces cut into four until there are enough, then simplified."""
    times = 0
    while len(shape.mesh.faces) * 4**times < count:
        times += 1
    return Shape(shape.name, simplify(subdivided(shape.mesh, times), count))


def plot(series: Mapping[str, Sequence[tuple[int, Mapping[str, float | None]]]]) -> Image.Image:
    """Seconds over faces, both logarithmic, a panel for each phase and a line for each method's mean over shapes."""
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4), layout="constrained")
    panels = figure.subplots(1, len(PHASES))
    for panel, phase in zip(panels, PHASES, strict=True):
        shown = []
        for color, (name, points) in zip(matplotlib.colormaps["tab10"].colors, series.items(), strict=False):
            faces = sorted({faces for faces, taken in points if taken[phase] is not None})
            means = [np.mean([taken[phase] for other, taken in points if other == each]) for each in faces]
            panel.plot(faces, means, "o-", color=color, label=name)
            shown += means
        panel.set(xscale="log", yscale="log", title=phase, xlabel="faces", ylabel="seconds")
        if shown:  # whole decades, so that what hardly grows looks it
            panel.set_ylim(10 ** np.floor(np.log10(min(shown)) - 0.1), 10 ** np.ceil(np.log10(max(shown)) + 0.1))
        panel.grid(visible=True, which="both", alpha=0.25)
    panels[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    return Image.open(stream).convert("RGB")


NEAR = 0.005  # of the diagonal: vertices of two components as near as that belong together


@dataclass(frozen=True)
class Defects:
    """What is wrong with a surface, vertices that share a position counted as one."""

    non_manifold: int  # edges of more than two faces, and vertices around which faces do not form one fan
    holes: int  # two that meet in a vertex count as one
    boundary: Int64  # (B, 2) edges of one face
    crowded: Int64  # (N, 2) edges of more than two faces


def defects(mesh: dfd.Mesh) -> Defects:
    """Count what the paper reports under its scans (Fig. 18)."""
    import igl

    faces = first_at_place(mesh)[mesh.faces].astype(np.int64)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    ends, uses = np.unique(ends, axis=0, return_counts=True)
    boundary, crowded = ends[uses == 1], ends[uses > 2]
    split = np.flatnonzero(~np.asarray(igl.is_vertex_manifold(faces)))
    split = np.intersect1d(split, faces)  # whatever it says of vertices without faces
    count = len(crowded) + len(np.setdiff1d(split, crowded))
    used, number = np.unique(boundary, return_inverse=True)
    holes = int(components_of(number.reshape(-1, 2), len(used)).max(initial=-1)) + 1
    return Defects(count, holes, boundary, crowded)


def gap(mesh: dfd.Mesh, moved: NDArray[np.floating]) -> float | None:
    """The mean change of distance, mesh units, between near vertices of different components; None without any."""
    faces = first_at_place(mesh)[mesh.faces]
    component = np.full(len(mesh.vertices), -1)
    component[faces] = face_components(faces.astype(np.int32))[:, None]
    used = np.flatnonzero(component >= 0)
    pairs = used[KDTree(mesh.vertices[used]).query_pairs(NEAR * mesh.diagonal, output_type="ndarray")]
    first, second = pairs[component[pairs[:, 0]] != component[pairs[:, 1]]].T
    if len(first) == 0:
        return None
    before, after = mesh.vertices[first] - mesh.vertices[second], moved[first] - moved[second]
    return float(np.linalg.norm(after - before, axis=1).mean())


def fig17(context: Context) -> Page:
    """Shapes with holes, loose components and non-manifold edges: defects, and one pull."""
    drawn, torn = [], []
    counted = {PAPER_DEFECTS[0]: PAPER_DEFECTS}
    for subject in context.subjects(BROKEN, (2, 4)):
        mesh, handle = subject.shape.mesh, subject.case.on(subject.shape)
        counts, found = inspect(mesh), defects(mesh)
        counted[subject.shape.name] = (
            subject.shape.name,
            counts.boundary_edges,
            counts.components,
            counts.non_manifold_edges,
        )
        colors = np.tile(CLAY, (len(mesh.vertices), 1))
        for ends, color in ((found.boundary, BOUNDARY), (found.crowded, CROWDED)):
            colors[np.isin(first_at_place(mesh), ends)] = color
        deformer = subject.session([handle])
        where = aim(mesh, mesh.vertices[[handle["at"]]], deformer.vertices)
        drawn.append(
            (subject.heading, [(picture(mesh, colors=colors, **where), "defects"), *before_after(deformer, where)])
        )
        opened = gap(mesh, deformer.vertices)
        length = float(np.linalg.norm(deformer.vertices - mesh.vertices, axis=1).max())
        torn.append([*subject.label, None if opened is None else 100 * opened / max(length, 1e-12)])
    first_text = "Red: vertices at edges of one face; blue: at edges of more than two faces."
    columns = ["shape", "boundary edges", "components", "non-manifold edges"]
    second = (
        f"How far vertices of different components that lie within {NEAR:.1%} of the diagonal of each other part, in % "
        "of the farthest way that a vertex goes: the mean over all such pairs."
    )
    look_for = "Weights pass over holes and from component to component, so that what touches stays together."
    sections = [
        Section("Defects, weights and results", first_text, drawn, Table(columns, list(counted.values()))),
        Section("Do parts that touch stay together?", second, (), Table(["shape", "preset", "gap %"], torn)),
    ]
    return Page("Fig. 17: topology robustness", look_for, sections)


def fig18(context: Context) -> Page:
    """Large meshes: defects, holes, and seconds of each stage with nothing taken from the cache."""
    drawn, rows = [], []
    for given, times in context.cases(LARGE, (2, 4)):
        shape = Shape(given.name, subdivided(given.mesh, min(times, 1) if context.quick else times))
        mesh, handle, found = shape.mesh, pulls_of(shape.name)[shape.name].on(shape), defects(shape.mesh)
        size = [len(mesh.vertices), len(mesh.faces), found.non_manifold, found.holes]
        for preset in PRESETS:
            field, seconds, stages = distilled(context, shape, preset)
            start = time.perf_counter()
            weights = dfd.bind(field.features(mesh), [handle["at"]])
            transform = np.concatenate([np.eye(3), handle["translation"][:, None]], axis=1)[None]
            dfd.pose(mesh.vertices, weights, transform)
            inference = time.perf_counter() - start
            rendering = sum(stages.seconds.get(name, 0.0) for name in RENDERING)
            rows.append([shape.name, NAMES[preset], *size, rendering, seconds - rendering, inference])
            deformer = session(mesh, field, preset, [handle])
            where = aim(mesh, mesh.vertices[[handle["at"]]], deformer.vertices)
            counted = "#V {:,}, #F {:,}, #NM {:,}, #H {:,}".format(*size)
            (weighted, _), (moved, _) = before_after(deformer, where)
            taken = "R {:.1f} s, T {:.1f} s, I {:.1f} s".format(*rows[-1][-3:])
            drawn.append((f"{shape.name}, {NAMES[preset]}: {counted}", [(weighted, "weights"), (moved, taken)]))
    text = (
        "#NM: edges of more than two faces, and vertices around which faces form more than one fan; #H: holes. R: "
        "seconds to simplify and render; T: the rest of the distillation; I: features of all vertices, weights of one "
        "handle, and the posed shape. Faces of smaller meshes were cut into four. The paper's own seconds stand in its "
        "pictures alone; its text says that the whole takes less than a minute (NVIDIA A40) at up to 28 million faces, "
        "and that T does not depend on the resolution."
    )
    columns = ["shape", "preset", "#V", "#F", "#NM", "#H", "R s", "T s", "I s"]
    look_for = "T hardly depends on the number of faces, and on scans with holes the result is as smooth as elsewhere."
    title = "Fig. 18: high resolution"
    return Page(title, look_for, [Section("Large meshes", text, drawn, Table(columns, rows))])


def table3(context: Context) -> Page:
    """Seconds to bind 1, 10 and 100 new handles, beside OptCtrlPoints."""
    repeats = context.of((3, 50))
    rows: list[list[Any]] = []
    for shape, _ in context.cases(REBOUND, (2, 20)):
        mesh, start = shape.mesh, [shape.name, len(shape.mesh.faces)]
        draws, corners = np.random.default_rng(0), np.unique(mesh.faces)
        draw = partial(draws.choice, corners, replace=False)
        sets = [[draw(size=min(count, len(corners))) for _ in range(repeats)] for count in COUNTS]
        for preset in PRESETS:
            field, preprocess, _ = distilled(context, shape, preset)
            dfd.bind(field.features(mesh), sets[0][0])
            taken = []
            for some in sets:
                begin = time.perf_counter()
                for handles in some:
                    dfd.bind(field.features(mesh), handles)
                taken.append((time.perf_counter() - begin) / repeats)
            rows.append([*start, NAMES[preset], preprocess, *taken, ""])
        jobs = [Job(handles, np.arange(len(handles)), mesh.vertices[handles]) for some in sets for handles in some]
        try:
            done = [each.seconds for each in run(PEERS["OptCtrlPoints"], mesh, jobs)]
        except PeerError as error:
            rows.append([*start, "OptCtrlPoints", None, None, None, None, str(error)])
        else:
            bound = np.array([each["bind"] for each in done]).reshape(len(COUNTS), repeats).mean(axis=1)
            rows.append([*start, "OptCtrlPoints", done[0]["tetrahedra"] + done[0]["prepare"], *map(float, bound), ""])
    columns = ["method", "preprocess s", *[f"{count} handle{'s' * (count > 1)} s" for count in COUNTS]]
    done_rows = [row for row in rows if row[3] is not None]
    means = [
        [name, *np.mean([row[3:7] for row in done_rows if row[2] == name], axis=0).tolist()]
        for name in dict.fromkeys(row[2] for row in done_rows)
    ]
    text = (
        f"Means of {repeats} random sets a shape. DFD: the field's forward pass at all vertices and the weights, as in "
        "the paper; a session keeps the features, see rebind in Fig. 10. "
        "OptCtrlPoints, written from its paper: the tetrahedra and one factorization before, then a back substitution "
        "for each handle and one small dense system. Shapes are simplified to 6,000 faces for it and have a few "
        "thousand nodes, far fewer than those of the paper, while DFD binds every vertex: the sizes differ."
    )
    look_for = "Binding new handles needs no solve: it costs DFD about the same for 1 and for 100."
    sections = [
        Section("Means", text, table=Table(columns, [*means, *PAPER_SECONDS])),
        Section("Shape by shape", table=Table(["shape", "faces", *columns, "note"], rows)),
    ]
    return Page("Table 3: seconds to rebind", look_for, sections)
