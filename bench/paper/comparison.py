"""What pages that compare methods share: pulls of one handle, layouts of fifty, pictures and numbers of all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.paper.compare import COLUMNS, Row, compare
from bench.paper.context import PRESETS, Context, Shape, named
from bench.paper.drawing import aim, blank, silhouettes
from bench.paper.handles import Case, find
from bench.paper.methods import others
from bench.paper.report import Row as Drawn
from bench.paper.report import Table
from dfd.common.preset import Preset
from dfd.pictures.picture import picture

__all__ = ["affine", "compared", "dense", "farthest", "marked", "methods_of", "pulls", "table"]

Float64 = NDArray[np.float64]
Methods = dict[str, Callable[[], Float64]]
EXPLODED = 3.0  # times the shape's diagonal: beyond, a result has a camera of its own
BLUE, GREEN = (40, 90, 230), (20, 150, 60)


@dataclass(frozen=True)
class Pull:
    """A handle, how far it goes in diagonals of the box, and what other methods hold: from 0 to 1 along the box."""

    handle: tuple[float, float, float]
    offset: tuple[float, float, float]
    fixed: tuple[tuple[float, float, float], ...]


FEET = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
TOP = ((0.1, 1.0, 0.1), (0.9, 1.0, 0.1), (0.5, 1.0, 0.9))
PULLS = {
    "spot": Pull((0.1, 1.0, 0.4), (-0.06, 0.1, 0.0), FEET),
    "kaykit_chair_A": Pull((0.0, 0.0, 1.0), (0.0, -0.15, 0.0), TOP),
    "scorpion": Pull((0.0, 0.2, 1.0), (-0.05, 0.0, 0.1), ((0.5, 0.0, 0.5), (0.5, 0.9, 0.2), *FEET)),
    "koala": Pull((0.0, 0.95, 0.75), (-0.08, 0.08, 0.0), FEET),
    "fox": Pull((0.2, 1.0, 0.7), (0.0, 0.12, 0.0), FEET),
    "table_roundlarge": Pull((0.0, 0.0, 0.5), (0.0, -0.12, 0.0), TOP),
    "shark": Pull((0.0, 0.4, 0.6), (-0.12, 0.0, 0.0), ((0.5, 0.5, 1.0), (0.5, 0.5, 0.0), (0.5, 1.0, 0.5))),
    "stegosaurus": Pull((0.5, 1.0, 0.5), (0.0, 0.12, 0.0), FEET),
    "boat": Pull((0.5, 1.0, 0.5), (0.0, 0.15, 0.0), FEET),
    "plane_holes": Pull((0.0, 0.2, 0.4), (-0.1, 0.1, 0.0), ((0.5, 0.5, 0.5), (1.0, 0.5, 0.5), (0.5, 1.0, 0.0))),
    "chair": Pull((0.0, 0.0, 1.0), (0.0, -0.15, 0.0), TOP),
    "quadruped": Pull((0.2, 1.0, 0.9), (0.0, 0.12, 0.0), FEET),
    "*": Pull((0.5, 1.0, 0.5), (0.0, 0.15, 0.0), FEET),
}

# Shapes of the dense layouts, and by how much of its height each grows downwards: what a network learned on furniture
# would offer. A control point goes down by how far it lies below the height LIFTED.
STRETCHED = {"kaykit_chair_A": 0.25, "table_roundlarge": 0.3, "chair_2": 0.25, "nightstand_1": 0.2, "chair": 0.25}
CONTROL_POINTS, LIFTED = 50, 0.4


def pulls(context: Context, most: int) -> list[tuple[str, Case]]:
    """The cases of a folder in the layout of APAP-Bench 3D, else pulls of our own on the meshes at hand."""
    sets = _sets(context)
    if sets:
        return sets[:most]
    return [(shape.name, _pulled(shape.refined(), pull)) for shape, pull in context.cases(PULLS, most=most)]


def dense(context: Context, most: int) -> list[tuple[str, Case]]:
    """The cases of a folder in the layout of DeepMetaHandles, else fifty control points and a stretch of our own."""
    sets = [(name, case) for name, case in _sets(context) if case.dense]
    if sets:
        return sets[:most]
    found = context.cases({**STRETCHED, "*": 0.25}, most=most)
    return [(shape.name, _stretched(shape.refined(), by)) for shape, by in found]


def farthest(points: Float64, count: int) -> NDArray[np.int64]:
    """Rows of `points` (N, 3) that lie as far apart as can be, one after the other, the first at the far end of x."""
    chosen = [int(points[:, 0].argmin())]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen, np.int64)


def methods_of(context: Context, case: Case, ball: float) -> Methods:
    """Every method by its name, ready to be called on `case`: DFD by its handles alone, in both presets."""
    ours = {named(preset): partial(context.solve, case, preset) for preset in PRESETS}
    return {**ours, **others(case, ball)}


def affine(context: Context, case: Case, preset: Preset) -> Float64:
    """The case with handles that turn and grow too: by what takes each about the center from its place to its target.

    Translations alone are what the paper calls DFD-T, this is its DFD-A; the transforms of its study are not given.
    """
    shape = Shape("", case.mesh)
    center = case.mesh.bounds.mean(axis=0)
    handles = []
    for at, target in zip(case.handles, case.targets, strict=True):
        before, after = case.mesh.vertices[at] - center, target - center
        turn = Rotation.align_vectors(after[None], before[None])[0].as_rotvec(degrees=True)
        factor = float(np.linalg.norm(after) / np.linalg.norm(before))
        handles.append({"at": int(at), "translation": after - before, "rotation": turn, "scale": factor})
    return context.session(shape, context.field(shape, preset), preset, handles).vertices


def compared(context: Context, name: str, case: Case, methods: Methods) -> tuple[Drawn, list[Row]]:
    """A row of pictures, the source and every method's outline over it, and the numbers."""
    context.say(name)
    rows = compare(name, case, methods)
    source = case.mesh.vertices[case.handles]
    sizes = [0.0 if row.vertices is None else _diagonal(row.vertices) / case.mesh.diagonal for row in rows]
    fitting = [row.vertices for row, size in zip(rows, sizes, strict=True) if 0 < size < EXPLODED]
    where = aim(case.mesh, source, case.targets, *fitting)
    fixed = case.mesh.vertices[case.held] if case.dense else case.mesh.vertices[case.fixed]
    drawn = [(marked(case, where, picture(case.mesh, fixed=fixed, **where)), "source")]
    for row, size in zip(rows, sizes, strict=True):
        if row.vertices is None:
            drawn.append((blank(), f"{row.method}: {row.note}"))
        elif size < EXPLODED:
            drawn.append((silhouettes(case.mesh, row.vertices, where), row.method))
        else:  # beside it the others would be dots
            alone = aim(case.mesh, source, row.vertices)
            drawn.append((silhouettes(case.mesh, row.vertices, alone), f"{row.method}: {size:.0f} times as large"))
    return (name, drawn), rows


def marked(case: Case, where: dict[str, object], image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture with the handles' places in blue and their targets in green, whatever lies before them."""
    bare = picture(case.mesh, **where).astype(int)
    image = image.copy()
    for points, color in ((case.mesh.vertices[case.handles], BLUE), (case.targets, GREEN)):
        dots = picture(case.mesh, handles=points, **where).astype(int)
        image[np.abs(dots - bare).max(axis=2) > 4] = color
    return image


def table(rows: Sequence[Row]) -> Table:
    """The numbers of a page."""
    return Table(
        ["shape", "method", *COLUMNS, "note"], [[row.shape, row.method, *row.values, row.note] for row in rows]
    )


def _diagonal(vertices: Float64) -> float:
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def _sets(context: Context) -> list[tuple[str, Case]]:
    if context.folder is None:
        return []
    try:
        return [(found.name, found.read()) for found in find(context.folder)]
    except ValueError as error:
        context.say(f"No sets of handles: {error}")
        return []


def _pulled(shape: Shape, pull: Pull) -> Case:
    vertices = shape.mesh.vertices
    handle = shape.at(pull.handle)
    fixed = np.array([each for each in dict.fromkeys(map(shape.at, pull.fixed)) if each != handle], np.int64)
    target = vertices[[handle]] + np.array([pull.offset]) * shape.mesh.diagonal
    held = np.concatenate([[handle], fixed])
    return Case(shape.mesh, np.array([handle]), target, fixed, held, np.concatenate([target, vertices[fixed]]))


def _stretched(shape: Shape, by: float) -> Case:
    mesh = shape.mesh
    corners = np.unique(mesh.faces)
    held = corners[farthest(mesh.vertices[corners], CONTROL_POINTS)].astype(np.int64)
    low, height = mesh.bounds[0][1], mesh.extents[1]
    below = np.maximum(LIFTED - (mesh.vertices[held, 1] - low) / height, 0) / LIFTED
    held_to = mesh.vertices[held] - below[:, None] * np.array([0, by * height, 0])
    handle = int(below.argmax())
    return Case(mesh, held[[handle]], held_to[[handle]], np.empty(0, np.int64), held, held_to, dense=True)
