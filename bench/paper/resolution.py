"""Pages that show running times, and large or broken meshes: Fig. 10, 17 and 18, and Tables 1 and 3."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import trimesh

import dfd
from bench.paper.comparisons import BALL, COMPARED, PRESET_OF, Case, case_of, deform, farthest, measured, pulled
from bench.paper.distortion import contact_gap
from bench.paper.features import distilled, resampled
from bench.paper.page import ALIKE, Page, Pictures, Row, aim, gallery
from bench.paper.subjects import CASES, NAMES, PRESETS, Context, Shape, Subject, pulls_of
from bench.peers import PEERS
from bench.peers.peer import Job, PeerError, run, tetrahedra
from bench.speed.measure import Timing, together
from dfd.common.linear_algebra import Bool, Float32, Float64
from dfd.common.preset import Preset
from dfd.geometry.topology import inspect
from dfd.pictures.picture import picture

PHASES = ("preprocess s", "bind s", "pose s")
TIMED = dict.fromkeys(("koala", "scorpion", "spot", "quadruped"))
FACES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
PATIENCE = (40.0, 600.0)  # seconds, in a quick and a full run: limit for tetrahedra, and again for the other steps
PEER_HANDLES = 10  # handles when a peer is timed; some peers need several

BROKEN = pulls_of("chair_nonmanifold", "truck_defects", "plane_holes", "kaykit_chair_A", "robot")

LARGE = pulls_of("plane_holes", "koala", "truck_defects", "spot", "quadruped")
LUCY = 28_000_000  # number of faces of the paper's scan Lucy
LARGE_FACES = ((20_000, 200_000), (50_000, 1_000_000, LUCY))
AT_ONCE = 1_000_000  # vertices whose features are in memory at a time; at 28 million faces, all take 21 GB
RENDERING = ("simplify", "render")  # stages of `dfd.distill` that `fig18` counts as R

COUNTS = (1, 10, 100)  # numbers of handles per set in Table 3
SOLID = ("spot", "koala", "fox", "scorpion", "shark", "boat", "quadruped")
REBOUND = dict.fromkeys((*SOLID, "kaykit_chair_A", "table_roundlarge", "chair"))
# Seconds in the paper's Table 3 for each of COUNTS, on one A40 GPU: means over 20 shapes with 1,000 random sets each.
PAPER_SECONDS = {"DFD, forward pass": (0.004, 0.012, 0.034), "OptCtrlPoints": (4.6, 11.35, 21.8)}
FORWARD, KEPT = "forward pass", "features kept"
EDGES = (0.05, 0.03, 0.02, 0.014, 0.01, 0.007, 0.005)  # edge lengths of tetrahedra, as fractions of the diagonal

MORE, FOLLOWED, FRAME = 8, 0.3, 1 / 30  # thresholds at which `table1` gives a method a ✓; see its text
TICKED_FACES = ((1_000, 8_000), (4_000, 32_000))
PROPERTIES = ("global semantics", "local control", "size robust", "new handle")
TICKS = {"ARAP": "-x--", "biharmonic": "-x--", "NeuralMLS": "-xx-", **dict.fromkeys(PRESET_OF, "xxxx")}  # x: a tick


def fig10(context: Context) -> Page:
    """Time that every method needs to preprocess, bind and pose meshes of increasing size."""
    rows: list[Row] = []
    for given, _ in context.cases(TIMED, (1, 3)):
        able = list(COMPARED)
        for count in FACES[:3] if context.quick else FACES:
            shape = resampled(given, count)
            start = {"shape": shape.name, "faces": len(shape.mesh.faces)}
            rows += [{**start, "method": NAMES[each], **_dfd_seconds(context, shape, each)} for each in PRESETS]
            for name in list(able):
                context.say(f"{shape.name}, {len(shape.mesh.faces):,} faces, {name}")
                row: dict[str, Any] = {**start, "method": name}
                try:
                    row |= _peer_seconds(shape.mesh, name, context.quick_or_full(PATIENCE))
                except PeerError as error:
                    able.remove(name)  # larger meshes would fail, too
                    row["note"] = str(error)
                rows.append(row)
    text = (
        "Preprocess: DFD runs `dfd.distill`, with a loaded encoder. For biharmonic coordinates, fTetWild makes "
        "tetrahedra, and the energy matrix is computed. Bind: DFD evaluates the field and computes the weights of one "
        f"handle. The other methods factor a matrix or train a network, for {PEER_HANDLES} handles. Rebind: DFD "
        "computes the weights of another handle. Seconds of DFD are medians. Other methods run once, with a limit of "
        f"{context.quick_or_full(PATIENCE):g} s for tetrahedra, and the same for all other steps."
    )
    return Page(text, rows=rows)


def _dfd_seconds(context: Context, shape: Shape, preset: Preset) -> dict[str, float]:
    field, preprocess, _ = distilled(context, shape, preset)
    mesh, vertex = shape.mesh, shape.at((0.5, 1.0, 0.5))
    features = field.features(mesh)
    weights, transform = dfd.bind(features, [vertex]), np.eye(3, 4)[None] + 0.1
    calls: dict[str, Callable[[], object]] = {
        "bind s": lambda: dfd.bind(field.features(mesh), [vertex]),
        "rebind s": lambda: dfd.bind(features, [vertex]),
        "pose s": lambda: dfd.pose(mesh.vertices, weights, transform),
    }
    taken = together(calls, seconds=context.quick_or_full((0.1, 1.0)), least=3)
    return {"preprocess s": preprocess, **{name: each.median for name, each in taken.items()}}


def _peer_seconds(mesh: dfd.Mesh, name: str, patience: float) -> dict[str, float]:
    corners = np.unique(mesh.faces)
    handles = corners[farthest(mesh.vertices[corners], PEER_HANDLES)]
    targets = mesh.vertices[handles] + 0.1 * mesh.diagonal * np.eye(PEER_HANDLES, 3)
    job = Job(handles, np.arange(PEER_HANDLES), targets)
    taken = run(PEERS[name], mesh, [job], patience=patience, most_faces=None)[0].seconds
    found = {"bind s": taken["bind"], "pose s": taken["pose"]}
    return found | ({"preprocess s": taken["tetrahedra"] + taken["prepare"]} if "tetrahedra" in taken else {})


def fig17(context: Context) -> Page:
    """Shapes with holes, loose components and non-manifold edges, and a translation of one handle."""

    def torn(subject: Subject, each: dfd.Deformer, _: dfd.Deformer) -> Row:
        counts = inspect(context.shape(subject.shape.name).mesh)
        return {
            "boundary edges": counts.boundary_edges,
            "components": counts.components,
            "non-manifold edges": counts.non_manifold_edges,
            "gap %": contact_gap(subject.shape.mesh, each.vertices),
        }

    text = (
        "gap: largest gap that opens between touching components or along cuts, in % of the largest motion. Long edges "
        "are halved, because a gap also opens where a long edge touches short ones. The counts are those of the file. "
        "The paper's shape has 3,804 boundary edges, 70 components and 12 non-manifold edges."
    )
    subjects = context.subjects(BROKEN, (2, 4), refined=True)
    return gallery(subjects, lambda subject: {"pull": subject.pull()}, torn, text)


def fig18(context: Context) -> Page:
    """Large meshes: their defects, and the time of each stage without the cache."""
    rows: list[Row] = []
    drawn: list[Pictures] = []
    for given, case in context.cases(LARGE, (1, 2)):
        for count in context.quick_or_full(LARGE_FACES):
            shape = resampled(given, count)
            mesh, handle, counts = shape.mesh, case.on(shape), inspect(shape.mesh)
            size = {"faces": len(mesh.faces), "boundary edges": counts.boundary_edges}
            for preset in PRESETS:
                field, seconds, stages = distilled(context, shape, preset)
                rendering = sum(stages.seconds.get(name, 0.0) for name in RENDERING)
                begin = time.perf_counter()
                moved = translated(field, mesh, handle["at"], handle["translation"])
                times = {"R s": rendering, "T s": seconds - rendering, "R + T s": seconds}
                times["I s"] = time.perf_counter() - begin
                start = {"shape": shape.name, "method": NAMES[preset], **size, "NM edges": counts.non_manifold_edges}
                rows.append({**start, **times})
                where = aim(mesh, mesh.vertices[[handle["at"]]], moved)
                pictures = [(picture(mesh, **where), "before"), (picture(mesh, vertices=moved, **where), "after")]
                drawn.append((f"{shape.name}, {len(mesh.faces):,} faces, {NAMES[preset]}", pictures))
    text = (
        "NM: non-manifold. R: seconds to simplify and render. T: seconds of the rest of the distillation. I: seconds "
        "for the features of all vertices, the weights of one handle (Eq. 5), and the posed shape. Each mesh is "
        f"simplified or subdivided. A full run reaches {LUCY:,} faces, the size of the paper's scan Lucy."
    )
    return Page(text, drawn, rows)


def translated(field: dfd.Field, mesh: dfd.Mesh, vertex: int, by: Float64) -> Float64:
    """Return the vertices (V, 3) of a mesh if a handle at `vertex` is translated `by` (3,), in mesh units.

    The features of at most `AT_ONCE` vertices are in memory at a time.
    """
    held = field(mesh.vertices[[vertex]])
    blocks = np.array_split(mesh.vertices, -(-len(mesh.vertices) // AT_ONCE))
    weights = np.concatenate([dfd.bind(field(each), held) for each in blocks])
    return dfd.pose(mesh.vertices, weights, np.c_[np.eye(3), by][None])


def table1(context: Context) -> Page:
    """Measured properties of every method: global semantics, local control, robustness to size, new handles."""
    rows: list[Row] = []
    for shape, pull in context.cases(CASES["ticked"], (1, 2)):
        sizes = [resampled(shape, count) for count in context.quick_or_full(TICKED_FACES)]
        case = case_of(shape.refined(), pull)
        for name, paper in TICKS.items():
            context.say(f"{shape.name}, {name}")
            row: dict[str, Any] = {"shape": shape.name, "method": name}
            try:
                ticks = _ticks(context, case, name, sizes)
                row |= {each: "✓" if tick else "✗" for each, tick in zip(PROPERTIES, ticks, strict=True)}
                row["as in the paper, %"] = 100 * float(np.mean(ticks == (np.array([*paper]) == "x")))
            except PeerError as error:
                row["note"] = str(error)
            rows.append(row)
    text = (
        f"One foot is pulled. Global semantics: agreement with marked places of at least {ALIKE:g} %. Local control: "
        f"marked places move less than {FOLLOWED / 2:g} times as far as the foot, with λ = 8 for DFD. Size robust: "
        f"{MORE} times the faces take less than {MORE / 2:g} times as long. New handle: computing its weights takes "
        f"less than {FRAME * 1000:.0f} ms on the larger mesh."
    )
    return Page(text, rows=rows)


def _ticks(context: Context, case: Case, name: str, sizes: Sequence[Shape]) -> Bool:
    mesh, preset = case.shape.mesh, PRESET_OF.get(name)
    if preset:
        session = pulled(context, case, preset)
        moved = [session.vertices]
        session.change(session.handles[0].id, locality=8)
        moved.append(session.vertices)
    else:
        moved = [deform(context, name, case, BALL)] * 2
    length = np.linalg.norm(case.handle_target - mesh.vertices[case.held[0]])
    marks = [case.shape.at(place) for place in (*case.marks.like, *case.marks.unlike)] if case.marks else []
    local = float(np.linalg.norm(moved[1] - mesh.vertices, axis=1)[marks].max() / length)
    taken = [
        _dfd_seconds(context, size, preset)
        if preset
        else _peer_seconds(size.mesh, name, context.quick_or_full(PATIENCE))
        for size in sizes
    ]
    # For a new handle, DFD binds only this handle; the other methods bind all handles again.
    new = [each.get("rebind s", each["bind s"]) for each in taken]
    coarse, fine = (each.get("preprocess s", 0.0) + seconds for each, seconds in zip(taken, new, strict=True))
    alike = measured(case, moved[0])["agreement %"] >= ALIKE
    return np.array([alike, local < FOLLOWED / 2, fine < MORE / 2 * coarse, new[1] < FRAME])


def table3(context: Context) -> Page:
    """Time to bind 1, 10 and 100 new handles to the nodes of tetrahedra, by DFD and by OptCtrlPoints."""
    repeats, patience = context.quick_or_full((5, 50)), context.quick_or_full(PATIENCE)
    rows: list[Row] = []
    for given, _ in context.cases(REBOUND, (1, 20)):
        welded = trimesh.Trimesh(given.mesh.vertices, given.mesh.faces)  # no duplicate vertices
        shape = Shape(given.name, dfd.Mesh(welded.vertices, welded.faces))
        mesh, faces = shape.mesh, shape.mesh.faces.astype(np.int64)
        draw = partial(np.random.default_rng(0).choice, len(mesh.vertices), replace=False)
        sets = [[draw(size=min(count, len(mesh.vertices))) for _ in range(repeats)] for count in COUNTS]
        jobs = [Job(handles, np.arange(len(handles)), mesh.vertices[handles]) for some in sets for handles in some]
        for edge in EDGES[:3] if context.quick else EDGES:
            context.say(f"{shape.name}, edges of {edge:g}")
            start: dict[str, Any] = {"shape": shape.name, "edge": edge}
            try:
                within = tetrahedra(mesh.vertices, faces, patience, edge=edge)
                done = run(PEERS["OptCtrlPoints"], mesh, jobs, patience=patience, most_faces=None, edge=edge)
            except PeerError as error:
                rows.append({**start, "method": "OptCtrlPoints", "note": str(error)})
                break
            start["nodes"] = len(within.nodes)
            of_nodes = [[np.unique(within.nearest(mesh.vertices[handles])) for handles in some] for some in sets]
            for preset in PRESETS:
                field = context.field(shape, preset)
                kept = partial(np.asarray, field(within.nodes))
                for how, features in ((FORWARD, partial(field, within.nodes)), (KEPT, kept)):
                    calls = {
                        str(count): partial(_each, features, some) for count, some in zip(COUNTS, of_nodes, strict=True)
                    }
                    timings = together(calls, seconds=context.quick_or_full((0.2, 1.0)))
                    cells = _cells([timings[str(count)] for count in COUNTS], repeats)
                    rows.append({**start, "method": NAMES[preset], "variant": how, **cells})
            bound = np.reshape([each.seconds["bind"] for each in done], (len(COUNTS), repeats))
            low, middle, high = np.quantile(bound, [0.25, 0.5, 0.75], axis=1)
            times = [Timing(*each) for each in zip(bound.min(axis=1), middle, high - low, strict=True)]
            rows.append({**start, "method": "OptCtrlPoints", **_cells(times, 1)})
    for name, seconds in PAPER_SECONDS.items():
        rows.append({"shape": "paper", "method": name, **dict(zip(map(of_count, COUNTS), seconds, strict=True))})
    text = (
        f"Seconds are medians, and spread is the interquartile range divided by the median, over {repeats} random sets "
        "of handles. Both methods bind the same nodes of fTetWild's tetrahedra. Their edges, in fractions of the "
        "diagonal, become shorter until OptCtrlPoints fails. The seconds of OptCtrlPoints do not include the "
        "factorization. The paper used an NVIDIA A40, and does not state the number of nodes."
    )
    return Page(text, rows=rows)


def of_count(count: int) -> str:
    """Return the column of the seconds for `count` handles."""
    return f"{count} handle{'s' * (count > 1)} s"


def _cells(timings: Sequence[Timing], calls: int) -> dict[str, float]:
    """Return the seconds of one of `calls` calls, and their spread, for each of `COUNTS`."""
    cells = {of_count(count): each.median / calls for count, each in zip(COUNTS, timings, strict=True)}
    return cells | {"spread": max(each.spread / max(each.median, 1e-12) for each in timings)}


def _each(features: Callable[[], Float32], sets: Sequence[Any]) -> None:
    for handles in sets:
        dfd.bind(features(), handles)
