"""Pages that compare DFD with other methods: Fig. 8, 9, 14 to 16, 21 and 22. `JOBS` lists them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import KDTree

import dfd
from bench.paper.distortion import asymmetry, contact_gap, surface_metrics
from bench.paper.page import Page, Pictures, Row, aim
from bench.paper.subjects import CASES, NAMES, PRESETS, BoxHandle, Context, Shape, Subject, agreement, pulls_of
from bench.peers import PEERS
from bench.peers.peer import Job, PeerError, run
from bench.tables import to_markdown
from dfd.common.errors import one_line
from dfd.common.linear_algebra import Float64, Int64, UInt8
from dfd.common.preset import Preset
from dfd.pictures.picture import picture

# Fixed points of the other methods, as fractions of the bounding box. TOP is used if the handle moves down, else FEET.
FEET = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
TOP = ((0.1, 1.0, 0.1), (0.9, 1.0, 0.1), (0.5, 1.0, 0.9))

# Shapes of Fig. 9, 16, 21. Control points below LIFTED × the shape's height move down by at most STRETCH × this height.
CONTROL_POINTS, LIFTED, STRETCH = 50, 0.4, 0.25
# Fig. 22: connected shapes, and two sets of constraints. With many fixed points, there are at most MOST_FIXED, each at
# least AWAY × the diagonal from the handle.
CONNECTED = pulls_of("spot", "chair", "quadruped", "horse", "fox", "dog", "alpaca", "koala")
FEW, MANY = "3 or 4 fixed points", "26 to 30 fixed points"
MOST_FIXED, AWAY = 30, 0.25
DENSE_TEXT = (
    "The network of DeepMetaHandles is not available. Instead, farthest point sampling selects fifty control points. "
    "Those near the ground move down, which lengthens the legs."
)

PRESET_OF: dict[str, Preset] = {NAMES[preset]: preset for preset in PRESETS}
BALL = 0.01  # vertices up to this distance from a held vertex are constrained too; a fraction of the box's longest side
WITH_BALL, WITHOUT_BALL = "with a ball", "points only"
COMPARED = ("ARAP", "biharmonic", "NeuralMLS")  # OptCtrlPoints gives the same weights as "biharmonic"
EXPLODED = 3.0  # a result is not drawn if its diagonal is more than this times the shape's diagonal
BEFORE, AFTER = np.array([64, 112, 216]), np.array([52, 168, 83])  # RGB colors of the shape at rest and deformed
LEGEND = """\
In pictures of the shape at rest, the dot is the handle. In the other pictures, the dot is the handle's target. Squares
are fixed points or control points of the other methods. The shape is blue before the deformation and green after it.
docs/reference/your_method.md explains the columns. **biharmonic** uses tetrahedra in a copy of the shape, simplified to
6,000 faces. Networks of APAP and DeepMetaHandles are not available."""


@dataclass(frozen=True)
class Case:
    """A shape and its held vertices. The other methods constrain all held vertices. DFD moves only one, the handle."""

    shape: Shape
    held: Int64  # (C,) vertex indices
    targets: Float64  # (C, 3) target positions of the held vertices, in mesh units
    handle: int = 0  # index of DFD's handle in `held`
    dense: bool = False  # True: all held vertices move. False: all held vertices except the handle are fixed.
    marks: BoxHandle | None = None  # has the marked places of the shape

    @property
    def fixed(self) -> Int64:
        """Return the indices of the fixed vertices."""
        return self.held[:0] if self.dense else self.held[1:]

    @property
    def handle_target(self) -> Float64:
        """Return the target position (1, 3) of DFD's handle."""
        return self.targets[[self.handle]]


def pulls(context: Context, most: tuple[int, int], shapes: Mapping[str, BoxHandle] | None = None) -> Iterator[Case]:
    """Yield a case for each available mesh of `shapes`, or of all pulls: the translation of one handle."""
    return (case_of(shape.refined(), pull) for shape, pull in context.cases(shapes or CASES["pulls"], most))


def case_of(shape: Shape, pull: BoxHandle) -> Case:
    """Return the case in which one handle is translated, and the other methods fix the feet or the top."""
    vertices, handle = shape.mesh.vertices, pull.on(shape)
    staying = map(shape.at, TOP if pull.offset[1] < 0 else FEET)
    held = np.array(list(dict.fromkeys([handle["at"], *staying])), np.int64)
    targets = vertices[held]
    targets[0] += handle["translation"]
    return Case(shape, held, targets, marks=pull)


def stretched(context: Context, most: tuple[int, int]) -> Iterator[Case]:
    """Yield a case for each available mesh: fifty control points, of which the lower ones move down."""
    for given, marks in context.cases(CASES["stretched"], most):
        shape = given.refined()
        mesh = shape.mesh
        corners = np.unique(mesh.faces)
        held = corners[farthest(mesh.vertices[corners], CONTROL_POINTS)].astype(np.int64)
        low, height = mesh.bounds[0][1], mesh.extents[1]
        below = np.maximum(LIFTED - (mesh.vertices[held, 1] - low) / height, 0) / LIFTED
        targets = mesh.vertices[held] - below[:, None] * np.array([0, STRETCH * height, 0])
        yield Case(shape, held, targets, int(below.argmax()), dense=True, marks=marks)


def farthest(points: Float64, count: int) -> Int64:
    """Return the indices of `count` points (N, 3), by farthest point sampling from the point with the smallest x."""
    chosen, distance = [points[:, 0].argmin()], np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(distance.argmax())
    return np.array(chosen, np.int64)


def pulled(context: Context, case: Case, preset: Preset, *, all_handles: bool = False) -> dfd.Deformer:
    """Return a session that moves the handle to its target; `all_handles` makes every held vertex such a handle."""
    rows = slice(None) if all_handles else [case.handle]
    held, offsets = case.held[rows], (case.targets - case.shape.mesh.vertices[case.held])[rows]
    subject = Subject(case.shape, None, preset, context.field(case.shape, preset))
    return subject.session({"at": int(at), "translation": by} for at, by in zip(held, offsets, strict=True))


def deform(context: Context, name: str, case: Case, ball: float) -> Float64:
    """Deform a case by the peer or given method `name`; return the vertices (V, 3). `ball` is as in `constraints`."""
    return run({**PEERS, **context.methods}[name], case.shape.mesh, [constraints(case, ball)])[0].vertices


def constraints(case: Case, ball: float) -> Job:
    """Return the constraints of the other methods: the targets of the held vertices and of the vertices near them.

    Near means within `ball`, a fraction of the box's longest side. Such vertices move like the nearest held vertex. A
    handle and the vertices near it form one group. Fixed vertices, and vertices near them, have the group −1.
    """
    mesh = case.shape.mesh
    corners: Int64 = np.unique(mesh.faces).astype(np.int64)
    distance, group = KDTree(mesh.vertices[case.held]).query(mesh.vertices[corners])
    near = distance <= (0.0 if case.dense else ball * float(mesh.extents.max()))
    held, group = corners[near], group[near]
    offsets = (case.targets - mesh.vertices[case.held])[group]
    return Job(held, np.where(np.isin(case.held[group], case.fixed), -1, group), mesh.vertices[held] + offsets)


def drawn(context: Context, case: Case, results: Mapping[str, Float64 | str], *, weights: bool = False) -> Pictures:
    """Draw the shape at rest and the result of every method; with `weights`, also the weights of DFD's handle."""
    mesh, source = case.shape.mesh, case.shape.mesh.vertices[case.held[[case.handle]]]
    where = aim(mesh, source, case.handle_target, *(each for each in results.values() if not isinstance(each, str)))
    held = mesh.vertices[case.held if case.dense else case.fixed]
    found = [(picture(mesh, fixed=held, handles=source, **where), "source")]
    for method, moved in results.items():
        if isinstance(moved, str):
            found.append((np.full_like(found[0][0], 255), f"{method}: {moved}"))
            continue
        if weights and method in PRESET_OF:
            follows = pulled(context, case, PRESET_OF[method]).following.max(axis=1)
            found.append((picture(mesh, weights=follows, handles=source, **where), f"{method}: weights"))
        found.append((silhouettes(mesh, moved, case.handle_target, where), method))
    return case.shape.name, found


def silhouettes(mesh: dfd.Mesh, moved: Float64, target: Float64, where: dict[str, Any]) -> UInt8:
    """Draw the shape at rest in blue, the moved shape in green, and a dot at the target on top, as in Fig. 8."""
    shown = ({}, {"vertices": moved}, {"vertices": moved, "handles": target})
    old, new, marked = (picture(mesh, **options, **where).astype(float) for options in shown)
    in_old, in_new = ((image < 250).any(axis=2, keepdims=True) for image in (old, new))
    page = np.where(in_new, 0.55 * new + 0.45 * AFTER, new)
    page = np.where(in_old, 0.6 * page + 0.4 * BEFORE, page)
    page = np.where((marked != new).any(axis=2, keepdims=True), marked, page)
    return page.clip(0, 255).astype(np.uint8)


def held_by_many(case: Case) -> Case:
    """Return a case with more fixed points: 30 by farthest point sampling, without those near the handle."""
    vertices, own = case.shape.mesh.vertices, case.held[case.handle]
    corners = np.unique(case.shape.mesh.faces)
    spread = corners[farthest(vertices[corners], MOST_FIXED)]
    apart = np.linalg.norm(vertices[spread] - vertices[own], axis=1) / case.shape.mesh.diagonal
    fixed = spread[apart > AWAY].astype(np.int64)
    targets = np.concatenate([case.handle_target, vertices[fixed]])
    return Case(case.shape, np.append(own, fixed), targets, marks=case.marks)


LABELS = ("shape", "method", "variant", "note")
Variants = Mapping[str, tuple[Callable[[Case], Case], float]]  # for each name: a change of the case, and the ball


def same(case: Case) -> Case:
    """Return the case itself."""
    return case


@dataclass(frozen=True)
class Comparison:
    """The jobs of one page, on which every method deforms every case. If a method fails, the page shows the reason."""

    title: str
    cases: Callable[[Context, tuple[int, int]], Iterator[Case]]
    most: tuple[int, int]  # largest number of cases in a quick and in a full run
    variants: Variants = field(default_factory=lambda: {"": (same, BALL)})
    text: str = ""
    weights: bool = False  # whether DFD's weights are drawn
    all_handles: bool = False  # whether DFD is the only method, and all held vertices are handles

    def __call__(self, context: Context) -> Page:
        """Deform all cases, draw the results, and fill the table."""
        pictures: list[Pictures] = []
        rows: list[Row] = []
        for base in self.cases(context, self.most):
            for variant, (change, ball) in self.variants.items():
                case = change(base)
                context.say(f"{case.shape.name} {variant}")
                results: dict[str, Float64 | str] = {}  # for each method, the moved vertices (V, 3), or why it failed
                for method in (*PRESET_OF, *(() if self.all_handles else (*COMPARED, *context.methods))):
                    row = {"shape": case.shape.name, "method": method, **({"variant": variant} if variant else {})}
                    try:
                        if preset := PRESET_OF.get(method):
                            moved = pulled(context, case, preset, all_handles=self.all_handles).vertices
                        else:
                            moved = deform(context, method, case, ball)
                        row |= measured(case, moved)
                    except (PeerError, ValueError, OSError, MemoryError) as error:
                        row["note"] = one_line(error) or type(error).__name__
                    results[method] = row["note"] or moved
                    rows.append(row)
                name, found = drawn(context, case, results, weights=self.weights)
                pictures.append((f"{name}, {variant}" if variant else name, found))
        return Page(f"{self.text}\n\n{LEGEND}\n\n{medians(rows)}".lstrip(), pictures, rows)


def medians(rows: Sequence[Row]) -> str:
    """Return a table: the median magnitude of each measure over shapes, for each method and variant."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["method"], row.get("variant", "")), []).append(row)
    measures, cells = list(dict.fromkeys(key for row in rows for key in row if key not in LABELS)), []
    for group, own in groups.items():
        drawn = [row for row in own if not row["note"]]
        found = ([abs(row[each]) for row in drawn if row.get(each) is not None] for each in measures)
        cells.append(
            [", ".join(filter(None, group)), len(drawn), *(float(np.median(each)) if each else None for each in found)]
        )
    table = to_markdown(["method", "shapes", *measures], cells)
    return f"Median magnitudes over the shapes on which a method gives a result:\n\n{table}"


def measured(case: Case, moved: Float64) -> dict[str, Any]:
    """Return the columns of a row for `moved` vertices (V, 3), and a note if the result is too large."""
    mesh, handle = case.shape.mesh, case.held[case.handle]
    length = float(np.linalg.norm(case.handle_target - mesh.vertices[handle]))
    follows = np.linalg.norm(moved - mesh.vertices, axis=1) / length
    size = float(np.linalg.norm(np.ptp(moved, axis=0))) / mesh.diagonal
    unlike = [case.shape.at(place) for place in case.marks.unlike] if case.marks else []
    return {
        "handle error %": 100 * float(np.linalg.norm(moved[handle] - case.handle_target)) / mesh.diagonal,
        "agreement %": agreement(mesh, case.marks, follows),
        "unrelated places move %": 100 * float(follows[unlike].mean()) if unlike else None,
        "fixed points move %": 100 * float(follows[case.fixed].mean()) if len(case.fixed) else None,
        "gap %": contact_gap(mesh, moved),
        "asymmetry %": asymmetry(mesh, moved),
        **surface_metrics(mesh, moved),
        "size": size,
        "note": f"too large: {size:.3g} times the shape's diagonal" if size > EXPLODED else "",
    }


JOBS = {
    "fig8": Comparison(
        "Translation of one handle by DFD, with its weights, and by methods that need fixed points.",
        pulls,
        (2, 6),
        weights=True,
    ),
    "fig9": Comparison(
        "Deformation by fifty control points, as in DeepMetaHandles; DFD uses only the one that moves farthest.",
        stretched,
        (1, 3),
        text=DENSE_TEXT,
    ),
    "fig14": Comparison(
        "Translation of one handle by DFD and by other methods, which also constrain vertices near their handles.",
        pulls,
        (2, 10),
    ),
    "fig15": Comparison(
        "Translation of one handle; the other methods constrain points with and without the vertices near them.",
        pulls,
        (2, 10),
        {WITH_BALL: (same, BALL), WITHOUT_BALL: (same, 0.0)},
    ),
    "fig16": Comparison("The deformations of fig9, on more shapes.", stretched, (2, 12), text=DENSE_TEXT),
    "fig21": Comparison(
        "DFD with the fifty control points of fig9 as handles.",
        stretched,
        (1, 6),
        text=f"{DENSE_TEXT} If the weights of a vertex sum to more than 1, Eq. 1 multiplies its position by the sum.",
        all_handles=True,
    ),
    "fig22": Comparison(
        "Distortion of the surface by every method: change of area, angles, edges and volume, as in Implicit-ARAP.",
        lambda context, most: pulls(context, most, CONNECTED),
        (6, 8),
        {FEW: (same, BALL), MANY: (held_by_many, BALL)},
    ),
}
