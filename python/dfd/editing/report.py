"""A report of the effect of an edit on a shape, in numbers and in one sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.posing.transforms import Vector, vector

if TYPE_CHECKING:
    from dfd.editing.edit import Edit, Handle
    from dfd.editing.influence.handle_weights import HandleWeights
    from dfd.mesh.mesh import Mesh

# Fraction of the diagonal of the box that nobody sees: a vertex that moved less counts as unmoved, and a handle that
# misses its target by less counts as arrived.
UNSEEN = 1e-3


@dataclass(frozen=True)
class HandleReport:
    """The result of one handle."""

    # id, name: id and name of the handle
    id: int
    name: str | None
    vertex: int  # the vertex that is measured: the handle's own, or the one nearest to it
    target: Vector  # (3,) position of that vertex under the handle's transform, mesh units
    landed: Vector  # (3,) posed position of that vertex, mesh units
    missing: float  # the distance between the two positions, mesh units
    arrived: bool  # whether `missing` is below 0.1 % of the diagonal of the box, too small to see
    mirrored: Vector | None  # (3,) mirrored position where the handle also acts, or None
    counterparts: int  # number of counterparts that move about their own pivots; 1 if all move together
    along_with: tuple[int, ...] = ()  # ids of handles that also move it, because its part lies in theirs

    def __str__(self) -> str:
        """Return the result in a few words."""
        named = f"handle {self.id}" + (f" ({self.name})" if self.name else "")
        words = f"{named} arrived" if self.arrived else f"{named} is {self.missing:.3g} from where it was sent"
        if self.counterparts > 1:
            words += f", each of {self.counterparts} counterparts about its own pivot"
        if self.along_with:
            words += f", along with handle {' and '.join(map(str, self.along_with))}"
        if self.mirrored is not None:
            words += f", mirrored at {','.join(f'{x:.3g}' for x in self.mirrored)}"
        return words


@dataclass(frozen=True)
class Report:
    """The result of an edit."""

    moved: float  # fraction of vertices that moved by more than 0.1 % of the diagonal of the box
    farthest: float  # largest distance that a vertex moved, mesh units
    handles: tuple[HandleReport, ...]  # result of each handle
    warning: str | None  # reason if nothing moved, else None
    advice: str | None = None  # sentence about scales that flatten or mirror; None without any

    def __repr__(self) -> str:
        """Return the sentence."""
        return f"Report({str(self)!r})"

    def __str__(self) -> str:
        """Return the result in one sentence."""
        if self.warning is not None:
            return self.warning
        share = "less than 1" if 0 < self.moved < 0.01 else f"{100 * self.moved:.0f}"
        told = [f"moved {share} % of the vertices, up to {self.farthest:.3g}"]
        if len(self.handles) > 1 and all(handle.arrived and handle.mirrored is None for handle in self.handles):
            told.append(f"all {len(self.handles)} handles arrived")
        else:
            told += map(str, self.handles)
        if self.advice is not None:
            told.append(self.advice)
        return "; ".join(told)


def report(mesh: Mesh, edit: Edit, weights: HandleWeights, posed: Float64) -> Report:
    """Return the report of `edit` on `mesh`, whose vertices (V, 3) are at `posed`."""
    distances = np.linalg.norm(posed - mesh.vertices, axis=1)
    farthest = float(distances.max())
    moved = float(np.mean(distances > UNSEEN * mesh.diagonal))
    counts = weights.counterpart_counts(edit)
    following, columns = weights.columns(edit)
    own = {column.handle: column for column in reversed(columns)}  # a handle's own counterpart is its first
    bent = weights.bent(edit)
    handles = []
    for i, handle in enumerate(edit.handles):
        vertex = weights.rows.anchor(handle.place)
        target = _sent(own[i].matrix(handle), bent[vertex])
        for number in own[i].carriers:
            moved_by = columns[number].matrix(edit.handles[columns[number].handle])
            target += following[vertex, number] * (_sent(moved_by, bent[vertex]) - bent[vertex])
        along = tuple(sorted({edit.handles[columns[number].handle].id for number in own[i].carriers}))
        handles.append(_handle_report(mesh, edit, handle, target, vertex, counts[i], along, posed))
    warning = _warning(edit) if moved == 0 else None
    return Report(moved, farthest, tuple(handles), warning, _advice(edit))


def _handle_report(
    mesh: Mesh,
    edit: Edit,
    handle: Handle,
    target: Float64,
    vertex: int,
    counterparts: int,
    along_with: tuple[int, ...],
    posed: Float64,
) -> HandleReport:
    missing = float(np.linalg.norm(posed[vertex] - target))
    mirrored = None
    if edit.symmetry is not None:
        image = edit.symmetry.reflect([handle.place.position])[0]
        if np.linalg.norm(image - np.asarray(handle.place.position)) > UNSEEN * mesh.diagonal:
            mirrored = vector("mirrored", image)
    return HandleReport(
        handle.id,
        handle.name,
        vertex,
        vector("target", target),
        vector("landed", posed[vertex]),
        missing,
        missing <= UNSEEN * mesh.diagonal,
        mirrored,
        counterparts,
        along_with,
    )


def _sent(matrix: Float64, point: Float64) -> Float64:
    """Return the image of a point (3,) under an affine `matrix` (3, 4)."""
    return np.asarray(matrix[:, :3] @ point + matrix[:, 3])


def _advice(edit: Edit) -> str | None:
    """Return a sentence about scales that flatten or mirror the shape; None without any."""
    flat = [f"handle {handle.id}" for handle in edit.handles if 0.0 in handle.transform.scale]
    if flat:
        return (
            f"{' and '.join(flat)} {'flattens' if len(flat) == 1 else 'flatten'} what follows: a factor of scale is 0"
        )
    mirrored = [f"handle {handle.id}" for handle in edit.handles if np.prod(handle.transform.scale) < 0]
    if mirrored:
        what = f"{' and '.join(mirrored)} {'mirrors' if len(mirrored) == 1 else 'mirror'} what follows"
        return f"{what}, whose faces then look inward: a factor of scale is negative"
    return None


def _warning(edit: Edit) -> str:
    """Return the reason why nothing moved."""
    if not edit.handles and edit.default is None:
        return "nothing moved: nothing is held"
    if all(handle.transform.rests for handle in edit.handles):
        return "nothing moved: no handle is moved, turned or scaled"
    if all(handle.controls.strength == 0 for handle in edit.handles):
        return "nothing moved: the strength of every handle is 0"
    return "nothing moved: no weight is left, or the moves are too small to see"
