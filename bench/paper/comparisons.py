"""Pages that compare methods: Fig. 8, 9, 14 to 16, 21 and 22."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

import dfd
from bench.paper.distortion import surface_metrics
from bench.paper.page import Page, Pictures, Row, aim
from bench.paper.peers import PEERS
from bench.paper.peers.peer import Job, PeerError, run
from bench.paper.subjects import NAMES, PRESETS, PULLS, BoxHandle, Context, Shape, Subject
from dfd.common.errors import one_line
from dfd.common.linear_algebra import Float64, Int64, UInt8
from dfd.common.preset import Preset
from dfd.pictures.picture import picture

# Fixed points of the other methods, for a handle that goes up or down.
FEET = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
TOP = ((0.1, 1.0, 0.1), (0.9, 1.0, 0.1), (0.5, 1.0, 0.9))

# Shapes of the dense layouts, whose control points below the height LIFTED go down by up to STRETCH of the height.
STRETCHED = dict.fromkeys(("kaykit_chair_A", "table_roundlarge", "chair_2", "nightstand_1", "chair"))
CONTROL_POINTS, LIFTED, STRETCH = 50, 0.4, 0.25
DENSE_TEXT = (
    "The network of DeepMetaHandles is not available. Fifty farthest points are the control points, and offsets of our "
    "choice lengthen the legs."
)

PRESET_OF: dict[str, Preset] = {NAMES[preset]: preset for preset in PRESETS}
BALL = 0.01  # of the longest side, the radius around a point in which the paper constrains other methods
COMPARED = ("ARAP", "biharmonic", "BBW", "NeuralMLS")  # OptCtrlPoints has the weights of biharmonic coordinates
EXPLODED = 3.0  # times the shape's diagonal, above which a result is not drawn
BEFORE, AFTER = np.array([64, 112, 216]), np.array([52, 168, 83])  # colors of the paper
LEGEND = """\
The dot is the handle, and its target after the deformation. Squares are the fixed or control points of the other
methods. The shape before is blue, the one after green. **handle off**: the distance from the target, of the diagonal.
**area**, **angle**, **edge**: mean changes over the surface. **volume**: the change of the enclosed volume; empty for
open surfaces. **flipped faces**: folded over against those around them. **size**: of the result, over the shape's.
**biharmonic** and **BBW** work within tetrahedra of the shape with at most 6,000 faces. The networks of APAP and
DeepMetaHandles are not available."""


@dataclass(frozen=True)
class Case:
    """A shape and its deformation; methods with constraints have all held vertices, DFD has the handle alone."""

    shape: Shape
    held: Int64  # (C,) vertices
    held_to: Float64  # (C, 3) their targets, mesh units
    handle: int = 0  # the row of DFD's handle in `held`
    dense: bool = False  # whether all held vertices move, without neighbors; else all but the handle are fixed

    @property
    def fixed(self) -> Int64:
        """Return the vertices that stay."""
        return self.held[:0] if self.dense else self.held[1:]

    @property
    def target(self) -> Float64:
        """Return the target (1, 3) of DFD's handle."""
        return self.held_to[[self.handle]]


def pulls(context: Context, most: tuple[int, int]) -> Iterator[Case]:
    """Yield the available meshes, each with a pull of our choice."""
    return (case_of(shape.refined(), pull) for shape, pull in context.cases(PULLS, most))


def case_of(shape: Shape, pull: BoxHandle) -> Case:
    """Return the case of a pull, in which the other methods hold the top or the feet."""
    vertices, handle = shape.mesh.vertices, pull.on(shape)
    staying = map(shape.at, TOP if pull.offset[1] < 0 else FEET)
    held = np.array(list(dict.fromkeys([handle["at"], *staying])), np.int64)
    held_to = vertices[held]
    held_to[0] += handle["translation"]
    return Case(shape, held, held_to)


def stretched(context: Context, most: tuple[int, int]) -> Iterator[Case]:
    """Yield the available meshes, each with fifty control points and a stretch of our choice."""
    for shape in (given.refined() for given, _ in context.cases(STRETCHED, most)):
        mesh = shape.mesh
        corners = np.unique(mesh.faces)
        held = corners[farthest(mesh.vertices[corners], CONTROL_POINTS)].astype(np.int64)
        low, height = mesh.bounds[0][1], mesh.extents[1]
        below = np.maximum(LIFTED - (mesh.vertices[held, 1] - low) / height, 0) / LIFTED
        held_to = mesh.vertices[held] - below[:, None] * np.array([0, STRETCH * height, 0])
        yield Case(shape, held, held_to, int(below.argmax()), dense=True)


def farthest(points: Float64, count: int) -> Int64:
    """Return rows of `points` (N, 3), each as far as possible from those before; the first has the smallest x."""
    chosen, distance = [points[:, 0].argmin()], np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(distance.argmax())
    return np.array(chosen, np.int64)


def pulled(context: Context, case: Case, preset: Preset, *, all_handles: bool = False) -> dfd.Deformer:
    """Return a session in which the handle, with `all_handles` every held vertex, is at its target."""
    rows = slice(None) if all_handles else [case.handle]
    held, offsets = case.held[rows], (case.held_to - case.shape.mesh.vertices[case.held])[rows]
    subject = Subject(case.shape, None, preset, context.field(case.shape, preset))
    return subject.session({"at": int(at), "translation": by} for at, by in zip(held, offsets, strict=True))


def deform(name: str, case: Case, ball: float) -> Float64:
    """Move a case by the peer called `name`; raise PeerError as `bench.paper.peers.peer.run` does."""
    return run(PEERS[name], case.shape.mesh, [constraints(case, ball)])[0].vertices


def constraints(case: Case, ball: float) -> Job:
    """Return the held vertices and their neighbors, with their targets.

    Every corner of a face within `ball`, a part of the longest side, moves like the nearest held vertex. A handle and
    its neighbors are one group; fixed points stay.
    """
    mesh = case.shape.mesh
    corners: Int64 = np.unique(mesh.faces).astype(np.int64)
    distance, group = KDTree(mesh.vertices[case.held]).query(mesh.vertices[corners])
    near = distance <= (0.0 if case.dense else ball * float(mesh.extents.max()))
    held, group = corners[near], group[near]
    offsets = (case.held_to - mesh.vertices[case.held])[group]
    return Job(held, np.where(np.isin(case.held[group], case.fixed), -1, group), mesh.vertices[held] + offsets)


def drawn(context: Context, case: Case, results: Mapping[str, Float64 | str], *, weights: bool = False) -> Pictures:
    """Draw the source and the result of every method; with `weights`, also those of DFD's handle."""
    mesh, source = case.shape.mesh, case.shape.mesh.vertices[case.held[[case.handle]]]
    where = aim(mesh, source, case.target, *(each for each in results.values() if not isinstance(each, str)))
    held = mesh.vertices[case.held if case.dense else case.fixed]
    found = [(picture(mesh, fixed=held, handles=source, **where), "source")]
    for method, moved in results.items():
        if isinstance(moved, str):
            found.append((np.full_like(found[0][0], 255), f"{method}: {moved}"))
            continue
        if weights and method in PRESET_OF:
            follows = pulled(context, case, PRESET_OF[method]).following.max(axis=1)
            found.append((picture(mesh, weights=follows, handles=source, **where), f"{method}: weights"))
        found.append((silhouettes(mesh, moved, case.target, where), method))
    return case.shape.name, found


def silhouettes(mesh: dfd.Mesh, moved: Float64, target: Float64, where: dict[str, Any]) -> UInt8:
    """Draw the moved shape in green, with the target, over the resting one in blue, as in the paper's Fig. 8."""
    shown = ({}, {"vertices": moved}, {"vertices": moved, "handles": target})
    old, new, marked = (picture(mesh, **options, **where).astype(float) for options in shown)
    in_old, in_new = ((image < 250).any(axis=2, keepdims=True) for image in (old, new))
    page = np.where(in_new, 0.55 * new + 0.45 * AFTER, new)
    page = np.where(in_old, 0.6 * page + 0.4 * BEFORE, page)
    page = np.where((marked != new).any(axis=2, keepdims=True), marked, page)
    return page.clip(0, 255).astype(np.uint8)


def fig8(context: Context) -> Page:
    """One handle translated, with its weights, beside methods that need fixed points."""
    return _compared(context, pulls(context, (1, 6)), weights=True)


def fig9(context: Context, most: tuple[int, int] = (1, 3)) -> Page:
    """Layouts like those of DeepMetaHandles by every method; DFD uses only the control point that moves farthest."""
    return _compared(context, stretched(context, most), DENSE_TEXT, ball=0.0)


def fig16(context: Context) -> Page:
    """Fig. 9 on every shape."""
    return fig9(context, (2, 12))


def fig14(context: Context, ball: float = BALL) -> Page:
    """One handle by every method; the other methods also constrain the neighbors of their handles."""
    return _compared(context, pulls(context, (2, 10)), ball=ball)


def fig15(context: Context) -> Page:
    """One handle by every method; the others constrain no neighbors."""
    return fig14(context, 0.0)


def fig22(context: Context) -> Page:
    """Distortion of the surface by every method; area, angle, edge and volume are measures of Implicit-ARAP."""
    return _compared(context, pulls(context, (2, 2)))


def fig21(context: Context) -> Page:
    """DFD with fifty handles."""
    text = f"{DENSE_TEXT} If weights sum to more than 1, Eq. 1 as written scales the shape by the sum."
    return _compared(context, stretched(context, (1, 6)), text, all_handles=True)


def _compared(
    context: Context,
    cases: Iterable[Case],
    text: str = "",
    *,
    ball: float = BALL,
    weights: bool = False,
    all_handles: bool = False,
) -> Page:
    """Draw and measure every case by every method; with `all_handles` by DFD alone, whose handles are all points.

    The page shows why a method fails and goes on with the others.
    """
    pictures: list[Pictures] = []
    rows: list[Row] = []
    for case in cases:
        context.say(case.shape.name)
        results: dict[str, Float64 | str] = {}  # the moved vertices (V, 3), or the reason of the failure
        for method in (*PRESET_OF, *(() if all_handles else COMPARED)):
            row = {"shape": case.shape.name, "method": method}
            try:
                if preset := PRESET_OF.get(method):
                    moved = pulled(context, case, preset, all_handles=all_handles).vertices
                else:
                    moved = deform(method, case, ball)
                row |= measured(case, moved)
            except (PeerError, ValueError, OSError, MemoryError) as error:
                row["note"] = one_line(error) or type(error).__name__
            results[method] = row["note"] or moved
            rows.append(row)
        pictures.append(drawn(context, case, results, weights=weights))
    return Page(f"{text}\n\n{LEGEND}".lstrip(), pictures, rows)


def measured(case: Case, moved: Float64) -> dict[str, Any]:
    """Return the columns of `LEGEND` for moved vertices (V, 3), and a note, which is empty unless they explode."""
    diagonal = case.shape.mesh.diagonal
    size = float(np.linalg.norm(np.ptp(moved, axis=0))) / diagonal
    return {
        "handle off %": 100 * float(np.linalg.norm(moved[case.held[case.handle]] - case.target)) / diagonal,
        **surface_metrics(case.shape.mesh, moved),
        "size": size,
        "note": f"explodes: {size:.3g} times as large" if size > EXPLODED else "",
    }
