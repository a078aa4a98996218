"""Pages that compare methods: Fig. 8, 9, 14 to 16, 21 and 22; and the user study (Table 2)."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import KDTree

import dfd
from bench.paper.distortion import surface_metrics
from bench.paper.page import (
    BALL,
    NAMES,
    PRESETS,
    PULLS,
    BoxHandle,
    Context,
    Pictures,
    Section,
    Sections,
    Shape,
    Table,
    aim,
    session,
    silhouettes,
)
from bench.paper.peers import PEERS
from bench.paper.peers.peer import Job, PeerError, run
from dfd.common.linear_algebra import Float64, Int64, UInt8
from dfd.common.preset import Preset
from dfd.pictures.picture import picture

# What other methods hold, by whether the handle goes up or down.
FEET = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
TOP = ((0.1, 1.0, 0.1), (0.9, 1.0, 0.1), (0.5, 1.0, 0.9))

# Shapes of the dense layouts grow downwards by a part of their height: what a network learned on furniture would offer.
# A control point goes down by how far it lies below the height LIFTED.
STRETCHED = dict.fromkeys(("kaykit_chair_A", "table_roundlarge", "chair_2", "nightstand_1", "chair", "*"), 0.25)
CONTROL_POINTS, LIFTED = 50, 0.4
DENSE_TEXT = (
    "The network of DeepMetaHandles cannot be had: the control points are fifty farthest points, and their offsets "
    "lengthen the legs, as we chose."
)

# How often the paper's users chose a method, per cent: two of six per example (Table 2).
CHOSEN = {"DFD-T": 82, "DFD-A": 79, "ARAP": 19, "biharmonic": 3, "APAP": 4, "NeuralMLS": 11}

COMPARED = ("ARAP", "biharmonic", "BBW", "NeuralMLS")  # OptCtrlPoints has the weights of the second one
EXPLODED = 3.0  # times the shape's diagonal: a larger result is not drawn
BLUE, GREEN = (40, 90, 230), (20, 150, 60)
COLUMNS = ("handle off %", "area %", "angle °", "edge %", "volume %", "flipped faces", "size")
HEADER = ("shape", "method", *COLUMNS, "note")
LEGEND = """\
Blue dots are handles, green ones their targets, squares fixed or control points of the other methods; the outline
before is blue, the one after green. **handle off**: the largest distance from a target, of the diagonal. **area**,
**angle**, **edge**: mean changes over the surface. **volume**: the change of the enclosed one; empty for open
surfaces. **flipped faces**: folded over against those around them. **size**: of the result, over the shape's.
**biharmonic** and **BBW** work within tetrahedra of the shape with at most 6,000 faces. The networks of APAP and
DeepMetaHandles cannot be had."""


@dataclass(frozen=True)
class Case:
    """One shape and what is to be done to it."""

    name: str
    mesh: dfd.Mesh
    handles: Int64  # (H,) vertices
    targets: Float64  # (H, 3) where they are to be, mesh units
    fixed: Int64  # (K,) vertices that stay
    held: Int64  # (C,) vertices that methods with constraints are given
    held_to: Float64  # (C, 3) where those are to be, mesh units
    dense: bool = False  # whether `held` is enough as it is, without the neighbors of its points


def pulls(context: Context, most: tuple[int, int]) -> list[Case]:
    """Return pulls of our own on the meshes at hand."""
    return [case_of(shape.refined(), pull) for shape, pull in context.cases(PULLS, most)]


def dense(context: Context, most: tuple[int, int]) -> list[Case]:
    """Return shapes with fifty control points and a stretch of our own."""
    return [_stretched(shape.refined(), by) for shape, by in context.cases(STRETCHED, most)]


def case_of(shape: Shape, pull: BoxHandle) -> Case:
    """Return the case of a pull: other methods hold the top or the feet besides."""
    vertices, handle = shape.mesh.vertices, pull.on(shape)
    staying = dict.fromkeys(map(shape.at, TOP if pull.offset[1] < 0 else FEET))
    fixed = np.array([each for each in staying if each != handle["at"]], np.int64)
    target = vertices[[handle["at"]]] + handle["translation"]
    held = np.concatenate([[handle["at"]], fixed])
    return Case(shape.name, shape.mesh, held[:1], target, fixed, held, np.concatenate([target, vertices[fixed]]))


def _stretched(shape: Shape, by: float) -> Case:
    mesh = shape.mesh
    corners = np.unique(mesh.faces)
    held = corners[farthest(mesh.vertices[corners], CONTROL_POINTS)].astype(np.int64)
    low, height = mesh.bounds[0][1], mesh.extents[1]
    below = np.maximum(LIFTED - (mesh.vertices[held, 1] - low) / height, 0) / LIFTED
    held_to = mesh.vertices[held] - below[:, None] * np.array([0, by * height, 0])
    handle = int(below.argmax())
    return Case(shape.name, mesh, held[[handle]], held_to[[handle]], np.empty(0, np.int64), held, held_to, dense=True)


def farthest(points: Float64, count: int) -> Int64:
    """Rows of `points` (N, 3) that lie as far apart as can be, one after the other, the first at the far end of x."""
    chosen = [int(points[:, 0].argmin())]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen, np.int64)


# --- methods


def pulled(context: Context, case: Case, preset: Preset, *, dense: bool = False) -> dfd.Deformer:
    """Return a session in which every handle of a case, with `dense` every control point, is at its target."""
    points = (case.held, case.held_to) if dense else (case.handles, case.targets)
    handles = [
        {"at": int(at), "translation": target - case.mesh.vertices[at]} for at, target in zip(*points, strict=True)
    ]
    return session(case.mesh, context.field(Shape(case.name, case.mesh), preset), preset, handles)


def deform(name: str, case: Case, ball: float) -> Float64:
    """Move a case by the peer called `name`; raise PeerError as `bench.paper.peers.peer.run` does."""
    return run(PEERS[name], case.mesh, [constraints(case, ball)])[0].vertices


def constraints(case: Case, ball: float) -> Job:
    """Vertices, distinct, and where they are to be: those that are held, and their neighbors.

    Every corner of a face within `ball`, a part of the longest side, goes as the nearest held vertex does. A handle and
    its neighbors are one group, fixed points none.
    """
    offsets = case.held_to - case.mesh.vertices[case.held]
    corners: Int64 = np.unique(case.mesh.faces).astype(np.int64)
    radius = 0.0 if case.dense else ball * float(case.mesh.extents.max())
    distance, nearest = KDTree(case.mesh.vertices[case.held]).query(case.mesh.vertices[corners])
    near = distance <= radius
    held, group = corners[near], nearest[near]
    group = np.where(np.isin(case.held[group], case.fixed), -1, group)
    return Job(held, group, case.mesh.vertices[held] + offsets[nearest[near]])


# --- pictures


def drawn(context: Context, case: Case, results: Mapping[str, Float64 | str], *, weights: bool = False) -> Pictures:
    """The source and every method's outline over it; with `weights`, those that DFD's handle has before its outline."""
    mesh, source = case.mesh, case.mesh.vertices[case.handles]
    where = aim(mesh, source, case.targets, *(each for each in results.values() if not isinstance(each, str)))
    held = mesh.vertices[case.held if case.dense else case.fixed]
    found = [(marked(case, where, picture(mesh, fixed=held, **where)), "source")]
    presets = {NAMES[preset]: preset for preset in PRESETS} if weights else {}
    for method, moved in results.items():
        if isinstance(moved, str):
            found.append((np.full_like(found[0][0], 255), f"{method}: {moved}"))
            continue
        if method in presets:
            follows = pulled(context, case, presets[method]).following.max(axis=1)
            found.append((picture(mesh, weights=follows, handles=source, **where), f"{method}: weights"))
        found.append((silhouettes(mesh, moved, where), method))
    return case.name, found


def marked(case: Case, where: Mapping[str, object], image: UInt8) -> UInt8:
    """The picture with the handles' places in blue and their targets in green, whatever lies before them."""
    bare = picture(case.mesh, **where).astype(int)
    image = image.copy()
    for points, color in ((case.mesh.vertices[case.handles], BLUE), (case.targets, GREEN)):
        dots = picture(case.mesh, handles=points, **where).astype(int)
        image[np.abs(dots - bare).max(axis=2) > 4] = color
    return image


# --- figures


def fig8(context: Context) -> Sections:
    """One handle translated, with its weights, beside methods that need fixed points."""
    return _compared(context, pulls(context, (1, 6)), weights=True)


def fig9(context: Context, most: tuple[int, int] = (1, 3)) -> Sections:
    """Layouts like those of DeepMetaHandles by every method; DFD has the control point that goes farthest."""
    return _compared(context, dense(context, most), DENSE_TEXT, ball=0.0)


def fig16(context: Context) -> Sections:
    """Fig. 9 on every shape."""
    return fig9(context, (2, 12))


def fig14(context: Context, ball: float = BALL) -> Sections:
    """One handle by every method, others with the neighbors of their constraints."""
    return _compared(context, pulls(context, (2, 10)), ball=ball)


def fig15(context: Context) -> Sections:
    """One handle by every method, others without neighbors."""
    return fig14(context, 0.0)


def fig22(context: Context) -> Sections:
    """What every method does to the surface, in numbers: area, angle, edge and volume are Implicit-ARAP's."""
    return _compared(context, pulls(context, (2, 2)))


def fig21(context: Context) -> Sections:
    """DFD with fifty handles."""
    text = f"{DENSE_TEXT} Where weights sum to more than 1, Eq. 1 as it is written scales the shape by the sum."
    return _compared(context, dense(context, (1, 6)), text, all_handles=True)


def _compared(
    context: Context,
    cases: Sequence[Case],
    text: str = "",
    *,
    ball: float = BALL,
    weights: bool = False,
    all_handles: bool = False,
) -> Sections:
    """Draw and measure every case by DFD and by the others; with `all_handles` by DFD alone, every point its handle.

    A method that fails stops no other.
    """
    pictures, rows = [], []
    for case in cases:
        context.say(case.name)
        methods: dict[str, Callable[[], Float64]] = {
            NAMES[preset]: lambda preset=preset, case=case: pulled(context, case, preset, dense=all_handles).vertices
            for preset in PRESETS
        }
        if not all_handles:
            methods |= {peer: partial(deform, peer, case, ball) for peer in COMPARED}
        results: dict[str, Float64 | str] = {}  # where the vertices (V, 3) went, or why they did not
        for method, move in methods.items():
            try:
                results[method] = moved = move()
                changes, note = measured(case, moved)
            except (PeerError, ValueError, OSError, MemoryError) as error:
                changes, note = [None] * len(COLUMNS), " ".join(str(error).split()) or type(error).__name__
            if note:
                results[method] = note
            rows.append([case.name, method, *changes, note])
        pictures.append(drawn(context, case, results, weights=weights))
    return [Section("Results", f"{text}\n\n{LEGEND}".lstrip(), pictures, Table(HEADER, rows))]


def measured(case: Case, moved: Float64) -> tuple[list[Any], str]:
    """Return the numbers of `COLUMNS` for moved vertices (V, 3), and a note if they explode."""
    found, diagonal = surface_metrics(case.mesh, moved), case.mesh.diagonal
    size = float(np.linalg.norm(np.ptp(moved, axis=0))) / diagonal
    missing = float(np.linalg.norm(moved[case.handles] - case.targets, axis=1).max()) / diagonal
    volume = None if found.volume is None else 100 * found.volume
    changes = [100 * missing, 100 * found.area, found.angle, 100 * found.edge_length, volume, found.flipped_faces, size]
    return changes, f"explodes: {size:.3g} times as large" if size > EXPLODED else ""


def table2(context: Context) -> Sections:
    """Tally the answers of a user study: how often each method was chosen, of all questions."""
    if context.answers is None:
        raise ValueError("table2 tallies people's answers: --answers FILE, a CSV of user, example, method")
    with context.answers.open(encoding="utf-8", newline="") as file:
        answers = list(csv.DictReader(file))
    if not answers or not {"user", "example", "method"} <= set(answers[0]):
        raise ValueError(f"{context.answers}: needs the columns user, example, method, and a row a choice")
    questions = len({(row["user"], row["example"]) for row in answers})
    counts = Counter(row["method"] for row in answers)
    names = dict.fromkeys((*CHOSEN, *counts))
    rows = [[name, CHOSEN.get(name), 100 * counts[name] / questions] for name in names]
    text = f"{questions:,} questions; a method's share is that of the questions in which it was chosen."
    return [Section("Answers", text, table=Table(["method", "paper %", "chosen %"], rows))]
