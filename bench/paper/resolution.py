"""Pages that show running times, and large or broken meshes: Fig. 10, 17 and 18, and Tables 1 and 3."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import KDTree
from trimesh.graph import connected_component_labels

import dfd
from bench.paper.comparisons import BALL, FEET, Case, case_of, deform, farthest, pulled
from bench.paper.features import distilled, resampled
from bench.paper.page import Page, Row, gallery
from bench.paper.peers import PEERS
from bench.paper.peers.peer import Job, PeerError, run, tetrahedra
from bench.paper.subjects import NAMES, PRESETS, BoxHandle, Context, Shape, Subject, pulls_of
from bench.speed.measure import together
from dfd.common.linear_algebra import Bool, Float32, Int64
from dfd.common.preset import Preset
from dfd.geometry.topology import face_components, face_sides, first_at_place, inspect

PHASES = ("preprocess s", "bind s", "pose s")
TIMED = dict.fromkeys(("koala", "scorpion", "spot", "quadruped"))
FACES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
PATIENCE = (40.0, 600.0)  # seconds, in a quick and a full run: limit for tetrahedra, and again for the other steps
TIMED_PEERS = ("ARAP", "biharmonic", "NeuralMLS")  # peers in the paper's plot
PEER_HANDLES = 10  # handles when a peer is timed; some peers need several

BROKEN = pulls_of("truck_defects", "chair_nonmanifold", "plane_holes", "knight", "robot")
BOUNDARY, CLAY = (0.85, 0.15, 0.1), (0.82, 0.81, 0.78)
NEAR = 0.005  # vertices of two components are neighbors if they are closer than this fraction of the diagonal

LARGE = pulls_of("plane_holes", "koala", "truck_defects", "spot", "quadruped")
DIVISORS = (1, 2, 8)  # after remeshing, no edge is longer than the mean edge length divided by this
RENDERING = ("simplify", "render")  # stages of `dfd.distill` that `fig18` counts as R

COUNTS = (1, 10, 100)  # numbers of handles per set in Table 3
SOLID = ("spot", "koala", "fox", "scorpion", "shark", "boat", "quadruped")
REBOUND = dict.fromkeys((*SOLID, "kaykit_chair_A", "table_roundlarge", "chair"))
# Seconds in the paper's Table 3 for each of COUNTS, on one A40 GPU: means over 20 shapes with 1,000 random sets each.
PAPER_SECONDS = {"DFD, forward pass": (0.004, 0.012, 0.034), "OptCtrlPoints": (4.6, 11.35, 21.8)}
EDGES = (0.05, 0.03, 0.02, 0.014, 0.01, 0.007, 0.005)  # edge lengths of tetrahedra, as fractions of the diagonal

TICKED = dict.fromkeys(("spot", "quadruped"))
TICKED_FACES = ((1_000, 8_000), (4_000, 32_000))
MORE, FOLLOWED, FRAME = 8, 0.3, 1 / 30  # thresholds at which `table1` gives a method a ✓; see its text
FOOT = BoxHandle((0.2, 0.0, 0.2), (0.0, -0.15, 0.0))
PROPERTIES = ("global semantics", "local control", "size robust", "new handle")
TICKS = {"ARAP": "-x--", "biharmonic": "-x--", "NeuralMLS": "-xx-", "DFD": "xxxx"}  # x: the paper ticks this property


def fig10(context: Context) -> Page:
    """Time that every method needs to preprocess, bind and pose meshes of increasing size."""
    rows: list[Row] = []
    for given, _ in context.cases(TIMED, (1, 3)):
        able = list(TIMED_PEERS)
        for count in FACES[:3] if context.quick else FACES:
            shape = resampled(given, count)
            start = {"shape": shape.name, "faces": len(shape.mesh.faces)}
            for preset in PRESETS:
                rows.append({**start, "method": NAMES[preset], **_dfd_seconds(context, shape, preset)})
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
        f"{context.quick_or_full(PATIENCE):g} s for tetrahedra, and the same for all other steps. The paper's plot has "
        "no numbers. Its text says that biharmonic coordinates fail above 10⁵ faces. APAP is not available."
    )
    return Page(text, rows=rows, plot=plot(rows))


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


def plot(rows: Sequence[Row]) -> Any:
    """Plot seconds against faces on logarithmic axes: a panel for each phase, a line of means for each method."""
    from matplotlib.figure import Figure  # needed by this page alone

    figure = Figure(figsize=(13, 4), layout="constrained")
    for panel, phase in zip(figure.subplots(1, len(PHASES)), PHASES, strict=True):
        for method in dict.fromkeys(row["method"] for row in rows):
            own = [row for row in rows if row["method"] == method and phase in row]
            faces = sorted({row["faces"] for row in own})
            means = [np.mean([row[phase] for row in own if row["faces"] == count]) for count in faces]
            panel.loglog(faces, means, "o-", label=method)
        panel.set(title=phase, xlabel="faces", ylabel="seconds")
        panel.grid(visible=True, which="both", alpha=0.25)
    panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def defects(mesh: dfd.Mesh) -> tuple[int, int, Int64]:
    """Return the numbers of non-manifold elements and of holes, as in Fig. 18, and the boundary edges (B, 2).

    Vertices at the same position are merged first. Edges with more than two faces are non-manifold elements.
    Vertices without such an edge also count if their faces do not form one fan. Holes that share a vertex count as one.
    """
    faces = first_at_place(mesh)[mesh.faces].astype(np.int64)
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    ends, uses = np.unique(np.sort(face_sides(faces), axis=1), axis=0, return_counts=True)
    boundary, crowded = ends[uses == 1], ends[uses > 2]
    split = np.intersect1d(np.flatnonzero(~np.asarray(igl.is_vertex_manifold(faces))), faces)
    used, number = np.unique(boundary, return_inverse=True)
    holes = len(np.unique(connected_component_labels(number.reshape(-1, 2), node_count=len(used))))
    return len(crowded) + len(np.setdiff1d(split, crowded)), holes, boundary


def gap(mesh: dfd.Mesh, moved: NDArray[np.floating]) -> float | None:
    """Return the mean distance between the displacements of neighbors (see `NEAR`); None if there are no neighbors."""
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
    """Shapes with holes, loose components and non-manifold edges, and a translation of one handle."""

    def torn(subject: Subject, each: dfd.Deformer, _: dfd.Deformer) -> Row:
        mesh, counts = subject.shape.mesh, inspect(subject.shape.mesh)
        opened, length = gap(mesh, each.vertices), float(np.linalg.norm(each.vertices - mesh.vertices, axis=1).max())
        return {
            "boundary edges": counts.boundary_edges,
            "components": counts.components,
            "non-manifold edges": counts.non_manifold_edges,
            "gap %": None if opened is None else 100 * opened / max(length, 1e-12),
        }

    def marked(subject: Subject) -> dict[str, Any]:
        mesh = subject.shape.mesh
        at_boundary = np.isin(first_at_place(mesh), defects(mesh)[2])
        return {"colors": np.where(at_boundary[:, None], BOUNDARY, CLAY)}

    text = (
        "Boundary vertices are red. Two vertices of different components are neighbors if their distance at rest is "
        f"below {NEAR:.1%} of the diagonal. The gap is the mean distance between the displacements of two neighbors, "
        "in % of the largest motion. The paper has 3,804 boundary edges, 70 components and 12 non-manifold edges."
    )
    subjects = context.subjects(BROKEN, (2, 4))
    return gallery(subjects, lambda subject: {"pull": subject.pull()}, torn, text, source=marked)


def remeshed(shape: Shape, divisor: int) -> Shape:
    """Remesh a shape until no edge exceeds the mean edge length divided by `divisor`; 1 changes nothing."""
    if divisor == 1:
        return shape
    surface = trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces, process=False)
    finer = surface.subdivide_to_size(surface.edges_unique_length.mean() / divisor, max_iter=30)
    return Shape(f"{shape.name}, edges / {divisor}", dfd.Mesh(finer.vertices, finer.faces))


def fig18(context: Context) -> Page:
    """Large meshes: their defects and holes, and the time of each stage without the cache."""
    taken: dict[tuple[str, str], Row] = {}

    def subjects() -> Iterator[Subject]:
        for given, case in context.cases(LARGE, (1, 4)):
            finer = [remeshed(given, divisor) for divisor in DIVISORS[: context.quick_or_full((2, 3))]]
            for shape, preset in product(finer, PRESETS):
                field, seconds, stages = distilled(context, shape, preset)
                rendering = sum(stages.seconds.get(name, 0.0) for name in RENDERING)
                taken[shape.name, preset] = {"R s": rendering, "T s": seconds - rendering}
                yield Subject(shape, case, preset, field)

    def measure(subject: Subject, each: dfd.Deformer, _: dfd.Deformer) -> Row:
        mesh, handle = subject.shape.mesh, subject.case.on(subject.shape)
        start = time.perf_counter()
        weights = dfd.bind(subject.field.features(mesh), [handle["at"]])
        dfd.pose(mesh.vertices, weights, np.concatenate([np.eye(3), handle["translation"][:, None]], axis=1)[None])
        inference = time.perf_counter() - start
        size = dict(zip(("#V", "#F", "#NM", "#H"), (len(mesh.vertices), len(mesh.faces), *defects(mesh)), strict=False))
        return {**size, **taken[subject.shape.name, subject.preset], "I s": inference}

    text = (
        "#NM: number of edges with more than two faces, plus vertices whose faces form more than one fan. #H: number "
        "of holes. R: seconds to simplify and render. T: seconds of the rest of the distillation. I: seconds for the "
        "features of all vertices, the weights of one handle, and the posed shape. Each mesh is shown as it is, and "
        "remeshed by trimesh to shorter edges. The paper distills Lucy, 28 million faces, within a minute (NVIDIA A40)."
    )
    return gallery(subjects(), lambda subject: {"pull": subject.pull()}, measure, text)


def table1(context: Context) -> Page:
    """Measured properties of every method: global semantics, local control, robustness to size, new handles."""
    rows: list[Row] = []
    for shape, _ in context.cases(TICKED, (1, 2)):
        sizes = [resampled(shape, count) for count in context.quick_or_full(TICKED_FACES)]
        case = case_of(shape.refined(), FOOT)
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
        f"One foot is pulled by a distance d. Global semantics: every other foot moves at least {FOLLOWED:g} d, and "
        "the flank moves less than half as far as any foot. Local control: the flank moves less than "
        f"{FOLLOWED / 2:g} d, with λ = 8 for DFD. Size robust: {MORE} times the faces take less than {MORE / 2:g} "
        f"times as long. New handle: computing its weights takes less than {FRAME * 1000:.0f} ms on the larger mesh."
    )
    return Page(text, rows=rows)


def _ticks(context: Context, case: Case, name: str, sizes: Sequence[Shape]) -> Bool:
    shape, at, own = case.shape, int(case.held[0]), name == "DFD"
    feet, flank = [each for each in map(shape.at, FEET) if each != at], shape.at((0.5, 0.5, 1.0))
    if own:
        session = pulled(context, case, "paper")
        moved = [session.vertices]
        session.change(session.handles[0].id, locality=8)
        moved.append(session.vertices)
    else:
        moved = [deform(name, case, BALL)] * 2
    length = np.linalg.norm(case.handle_target - shape.mesh.vertices[at])
    wide, local = (np.linalg.norm(each - shape.mesh.vertices, axis=1) / length for each in moved)
    taken = [
        _dfd_seconds(context, size, "paper") if own else _peer_seconds(size.mesh, name, context.quick_or_full(PATIENCE))
        for size in sizes
    ]
    # For a new handle, DFD binds only this handle; the other methods bind all handles again.
    new = [each.get("rebind s", each["bind s"]) for each in taken]
    coarse, fine = (each.get("preprocess s", 0.0) + seconds for each, seconds in zip(taken, new, strict=True))
    semantic = wide[feet].min() >= FOLLOWED and wide[flank] < wide[feet].min() / 2
    return np.array([semantic, local[flank] < FOLLOWED / 2, fine < MORE / 2 * coarse, new[1] < FRAME])


def table3(context: Context) -> Page:
    """Time to bind 1, 10 and 100 new handles to the nodes of tetrahedra, by DFD and by OptCtrlPoints."""
    repeats, patience = context.quick_or_full((3, 50)), context.quick_or_full(PATIENCE)
    rows: list[Row] = []

    def add(method: str, seconds: Iterable[float], **start: Any) -> None:
        names = (f"{count} handle{'s' * (count > 1)} s" for count in COUNTS)
        rows.append({**start, "method": method, **dict(zip(names, map(float, seconds), strict=True))})

    for given, _ in context.cases(REBOUND, (1, 20)):
        welded = trimesh.Trimesh(given.mesh.vertices, given.mesh.faces)  # no duplicate vertices
        shape = Shape(given.name, dfd.Mesh(welded.vertices, welded.faces))
        mesh, faces = shape.mesh, shape.mesh.faces.astype(np.int64)
        draw = partial(np.random.default_rng(0).choice, len(mesh.vertices), replace=False)
        sets = [[draw(size=min(count, len(mesh.vertices))) for _ in range(repeats)] for count in COUNTS]
        jobs = [Job(handles, np.arange(len(handles)), mesh.vertices[handles]) for some in sets for handles in some]
        for edge in EDGES[:2] if context.quick else EDGES:
            context.say(f"{shape.name}, edges of {edge:g}")
            start: dict[str, Any] = {"shape": shape.name, "edge": edge}
            try:
                within = tetrahedra(mesh.vertices, faces, patience, edge=edge)
                done = run(PEERS["OptCtrlPoints"], mesh, jobs, patience=patience, most_faces=None, edge=edge)
            except PeerError as error:
                rows.append({**start, "method": "OptCtrlPoints", "note": str(error)})
                break
            start["nodes"], field = len(within.nodes), context.field(shape, "paper")
            of_nodes = [[np.unique(within.nearest(mesh.vertices[handles])) for handles in some] for some in sets]
            calls = {
                "DFD, forward pass": partial(field, within.nodes),
                "DFD, features kept": partial(np.asarray, field(within.nodes)),
            }
            for name, features in calls.items():
                add(name, [_seconds(features, some) / repeats for some in of_nodes], **start)
            bound = np.reshape([each.seconds["bind"] for each in done], (len(COUNTS), repeats))
            add("OptCtrlPoints", bound.mean(axis=1), **start)
    for name, seconds in PAPER_SECONDS.items():
        add(name, seconds, shape="paper")
    text = (
        f"Seconds are means over {repeats} random sets of handles. Both methods bind the same nodes of fTetWild's "
        "tetrahedra. Their edge length, a fraction of the diagonal, decreases until OptCtrlPoints fails. The seconds "
        "of OptCtrlPoints do not include the factorization. The paper used an NVIDIA A40."
    )
    return Page(text, rows=rows)


def _seconds(features: Callable[[], Float32], sets: Sequence[Int64]) -> float:
    dfd.bind(features(), [0])
    begin = time.perf_counter()
    for handles in sets:
        dfd.bind(features(), handles)
    return time.perf_counter() - begin


def speedup(count: int, how: str) -> Callable[[Sequence[Row]], float]:
    """Return a rule: the time of OptCtrlPoints divided by that of DFD, for `count` handles on the most nodes.

    `how` is "forward pass" or "features kept", as in `table3`.
    """
    name = f"{count} handle{'s' * (count > 1)} s"

    def number(rows: Sequence[Row]) -> float:
        own = [row for row in rows if row.get("nodes")]
        most = max((row["nodes"] for row in own), default=0)
        seconds = {row["method"]: row[name] for row in own if row["nodes"] == most}
        return float(seconds["OptCtrlPoints"] / seconds[f"DFD, {how}"]) if seconds else float("nan")

    return number
