"""One case by all methods: DFD by either preset and those of `bench.paper.peers`, in pictures and in numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import dfd
from bench.paper.context import PRESETS, Context, Shape, named, session
from bench.paper.drawing import aim, blank, heat, silhouettes
from bench.paper.handles import Case
from bench.paper.peers import PEERS
from bench.paper.peers.peer import Job, PeerError, run
from bench.paper.report import Row as Drawn
from bench.paper.report import Table
from dfd.common.linear_algebra import Float64, Int64, UInt8
from dfd.common.preset import Preset
from dfd.geometry.metrics import SurfaceMetrics, surface_metrics
from dfd.pictures.picture import picture

Methods = Mapping[str, Callable[[], Float64]]

COMPARED = ("ARAP", "biharmonic", "BBW", "NeuralMLS")  # OptCtrlPoints has the weights of the second one
EXPLODED = 3.0  # times the shape's diagonal: beyond, a result has a camera of its own
BLUE, GREEN = (40, 90, 230), (20, 150, 60)
COLUMNS = ("handle off %", "area %", "angle °", "edge %", "volume %", "flipped faces")
LEGEND = """\
Blue dots are handles, green ones their targets, squares fixed points or control points, which only the
other methods need; the outline before is blue, the one after green.

- **handle off**: the largest distance that a handle is from its target, of the diagonal of the box.
- **area**, **angle**, **edge**: mean changes over the surface, of areas and lengths relative ones.
- **volume**: how much the enclosed volume changed; empty where the surface is open.
- **flipped faces**: folded over against the faces around them, and not so at rest.
- DFD is moved by its handles alone, as in the paper; **fixed points** holds those of the set.
- Other methods are given handles, fixed points and their neighbors. **biharmonic** (coordinates) and **BBW** work
  within tetrahedra of fTetWild, of the shape simplified to 6,000 faces; **NeuralMLS** is written from its paper. Shapes
  of DeepMetaHandles give them all control points, and their own coordinates where the set has them. The networks of
  APAP and DeepMetaHandles cannot be had."""


@dataclass(frozen=True)
class Row:
    """What one method made of one case."""

    shape: str
    method: str
    vertices: Float64 | None = None  # (V, 3) where they went, mesh units; None where `note` says why not
    missing: float | None = None  # the largest distance that a handle is from its target, of the diagonal of the box
    metrics: SurfaceMetrics | None = None
    note: str = ""

    @property
    def values(self) -> list[float | None]:
        """What the columns of the table hold."""
        if self.missing is None or self.metrics is None:
            return [None] * len(COLUMNS)
        volume = None if self.metrics.volume is None else 100 * self.metrics.volume
        relative = [100 * self.missing, 100 * self.metrics.area, self.metrics.angle, 100 * self.metrics.edge_length]
        return [*relative, volume, self.metrics.flipped_faces]


def table(rows: Sequence[Row]) -> Table:
    """The numbers of a page."""
    return Table(
        ["shape", "method", *COLUMNS, "note"], [[row.shape, row.method, *row.values, row.note] for row in rows]
    )


def compare(name: str, case: Case, methods: Methods) -> list[Row]:
    """A row a method, which returns the moved vertices (V, 3); one that fails has a note and stops no other."""
    return [_row(name, method, case, move) for method, move in methods.items()]


def _row(name: str, method: str, case: Case, move: Callable[[], Float64]) -> Row:
    try:
        moved = move()
        metrics = surface_metrics(case.mesh, moved)
    except (PeerError, ValueError, OSError, MemoryError) as error:
        return Row(name, method, note=" ".join(str(error).split()) or type(error).__name__)
    missing = np.linalg.norm(moved[case.handles] - case.targets, axis=1).max() / case.mesh.diagonal
    return Row(name, method, moved, float(missing), metrics)


# --- methods


def methods_of(context: Context, case: Case, ball: float, *, fixed: bool = False) -> dict[str, Callable[[], Float64]]:
    """Every method by its name, ready to be called on `case`: DFD by its handles alone, with `fixed` held as well."""
    methods: dict[str, Callable[[], Float64]] = {}
    for preset in PRESETS:
        methods[named(preset)] = partial(solve, context, case, preset)
        if fixed and len(case.fixed):
            methods[f"{named(preset)}, fixed points"] = partial(solve, context, case, preset, fixed=True)
    return {**methods, **{name: partial(deform, name, case, ball) for name in COMPARED}}


def pulled(
    context: Context, case: Case, preset: Preset, *, fixed: bool = False, affine: bool = False, dense: bool = False
) -> dfd.Deformer:
    """A session in which every handle of a case has moved to its target.

    `fixed` holds the case's fixed points, `dense` makes a handle of every control point. `affine` handles turn and grow
    too, by what takes each about the center from its place to its target: the paper's DFD-A, whose own transforms are
    not given; translations alone are its DFD-T.
    """
    center = case.mesh.bounds.mean(axis=0)
    handles = []
    for at, target in zip(*(case.held, case.held_to) if dense else (case.handles, case.targets), strict=True):
        before, after = case.mesh.vertices[at] - center, target - center
        handle = {"at": int(at), "translation": after - before}
        if affine:
            handle["rotation"] = Rotation.align_vectors(after[None], before[None])[0].as_rotvec(degrees=True)
            handle["scale"] = float(np.linalg.norm(after) / np.linalg.norm(before))
        handles.append(handle)
    held = [int(vertex) for vertex in case.fixed] if fixed else []
    return session(case.mesh, context.field(Shape("", case.mesh), preset), preset, handles, fixed=held)


def solve(context: Context, case: Case, preset: Preset, **how: bool) -> Float64:
    """Where the vertices go (V, 3), see `pulled`."""
    return pulled(context, case, preset, **how).vertices


def deform(name: str, case: Case, ball: float) -> Float64:
    """A case by the peer called `name`; biharmonic coordinates of the set's own are taken where it has them.

    Raises PeerError as `bench.paper.peers.peer.run`.
    """
    if name == "biharmonic" and case.coordinates is not None:
        return case.mesh.vertices + case.coordinates @ (case.held_to - case.mesh.vertices[case.held])
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


def drawn(context: Context, case: Case, rows: Sequence[Row], *, weights: bool = False) -> Drawn:
    """The source and every method's outline over it; with `weights`, those that DFD's handle has before its outline."""
    mesh = case.mesh
    moved = [row.vertices for row in rows if row.vertices is not None]
    where, cameras = cameras_of(case, moved)
    held = mesh.vertices[case.held if case.dense else case.fixed]
    found = [(marked(case, where, picture(mesh, fixed=held, **where)), "source")]
    presets = {named(preset): preset for preset in PRESETS} if weights else {}
    views = iter(cameras)
    for row in rows:
        if row.vertices is None:
            found.append((blank(), f"{row.method}: {row.note}"))
            continue
        if row.method in presets:
            follows = pulled(context, case, presets[row.method]).following.max(axis=1)
            found.append((heat(mesh, follows, case.handles, **where), f"{row.method}: weights"))
        camera = next(views)
        caption = row.method if camera is where else f"{row.method}: {_size(case, row.vertices):.3g} times as large"
        found.append((silhouettes(mesh, row.vertices, camera), caption))
    return rows[0].shape, found


def cameras_of(case: Case, moved: Sequence[Float64]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The options of `picture` for a case, and for each result (V, 3): its own camera where it has exploded.

    Beside such a one the others would be dots.
    """
    source = case.mesh.vertices[case.handles]
    fits = [_size(case, vertices) < EXPLODED for vertices in moved]
    where = aim(case.mesh, source, case.targets, *(each for each, fit in zip(moved, fits, strict=True) if fit))
    return where, [where if fit else aim(case.mesh, source, each) for each, fit in zip(moved, fits, strict=True)]


def marked(case: Case, where: Mapping[str, object], image: UInt8) -> UInt8:
    """The picture with the handles' places in blue and their targets in green, whatever lies before them."""
    bare = picture(case.mesh, **where).astype(int)
    image = image.copy()
    for points, color in ((case.mesh.vertices[case.handles], BLUE), (case.targets, GREEN)):
        dots = picture(case.mesh, handles=points, **where).astype(int)
        image[np.abs(dots - bare).max(axis=2) > 4] = color
    return image


def _size(case: Case, vertices: Float64) -> float:
    """The diagonal of the moved shape (V, 3), of that of the shape at rest."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0))) / case.mesh.diagonal
