"""What an edit does to a shape, in numbers and in one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float64
from dfd.posing.transforms import Vector, vector

if TYPE_CHECKING:
    from dfd.editing.edit import Edit, Handle
    from dfd.editing.influence.handle_weights import HandleWeights
    from dfd.mesh.mesh import Mesh

# What nobody sees, as a part of the diagonal of the box: a vertex that moved less stayed, a handle that misses less
# arrived.
UNSEEN = 1e-3
# A handle whose place follows another one by this much is pushed by it.
PUSHED = 0.1


@dataclass(frozen=True)
class HandleReport:
    """What became of one handle."""

    # id, name: those of the handle
    id: int
    name: str | None
    vertex: int  # the vertex by which it is judged: its own, or the one nearest to it
    target: Vector  # (3,) where the handle's transform sends that vertex, mesh units
    landed: Vector  # (3,) where the vertex is
    missing: float  # the distance between the two
    arrived: bool  # whether `missing` is too small to see: below 0.1 % of the diagonal of the box
    mirrored: Vector | None  # (3,) where the handle acts mirrored as well, or None
    instances: int  # how many instances it moves, each about its own pivot; 1 where it moves all together

    def __str__(self) -> str:
        """Say it in a few words."""
        named = f"handle {self.id}" + (f" ({self.name})" if self.name else "")
        words = f"{named} arrived" if self.arrived else f"{named} is {self.missing:.3g} from where it was sent"
        if self.instances > 1:
            words += f", each of {self.instances} instances about its own pivot"
        if self.mirrored is not None:
            words += f", mirrored at {','.join(f'{x:.3g}' for x in self.mirrored)}"
        return words


@dataclass(frozen=True)
class Report:
    """What an edit does to a shape."""

    moved: float  # the part of the vertices, in [0, 1], that moved by more than 0.1 % of the diagonal of the box
    farthest: float  # how far the vertex moved that moved farthest, mesh units
    handles: tuple[HandleReport, ...]  # what became of each handle
    warning: str | None  # why nothing moved, where nothing did; None otherwise
    # advice: which scales flatten or mirror, or what would help handles that did not arrive; None where neither is so
    advice: str | None = None

    def __repr__(self) -> str:
        """Show the sentence."""
        return f"Report({str(self)!r})"

    def __str__(self) -> str:
        """The sentence."""
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
    """What `edit` does to `mesh`, whose vertices (V, 3) are at `posed`."""
    distances = np.linalg.norm(posed - mesh.vertices, axis=1)
    farthest = float(distances.max())
    moved = float(np.mean(distances > UNSEEN * mesh.diagonal))
    counts = weights.instance_counts(edit)
    own = {
        column.handle: column for column in reversed(weights.columns(edit)[1])
    }  # a handle's own instance is its first
    bent = weights.bent(edit)
    handles = tuple(
        _handle_report(mesh, edit, handle, own[i].matrix(handle), weights.anchor(handle), counts[i], bent, posed)
        for i, handle in enumerate(edit.handles)
    )
    warning = _warning(edit) if moved == 0 else None
    return Report(moved, farthest, handles, warning, _advice(edit, weights, handles))


def _handle_report(
    mesh: Mesh, edit: Edit, handle: Handle, matrix: Float64, vertex: int, instances: int, bent: Float64, posed: Float64
) -> HandleReport:
    target = matrix[:, :3] @ bent[vertex] + matrix[:, 3]
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
        instances,
    )


def _advice(edit: Edit, weights: HandleWeights, handles: Sequence[HandleReport]) -> str | None:
    """What makes a shape flat or mirrors it, or else would help handles that others which look alike push."""
    flat = [f"handle {handle.id}" for handle in edit.handles if 0.0 in handle.transform.scale]
    if flat:
        return (
            f"{' and '.join(flat)} {'flattens' if len(flat) == 1 else 'flatten'} what follows: a factor of scale is 0"
        )
    mirrored = [f"handle {handle.id}" for handle in edit.handles if np.prod(handle.transform.scale) < 0]
    if mirrored:
        what = f"{' and '.join(mirrored)} {'mirrors' if len(mirrored) == 1 else 'mirror'} what follows"
        return f"{what}, whose faces then look inward: a factor of scale is negative"
    missed = np.array([not handle.arrived for handle in handles], bool)
    if edit.overlap == "interpolate" or len(handles) < 2 or not missed.any():
        return None
    among = weights.among(edit, weights.following(edit))
    np.fill_diagonal(among, 0.0)
    among[:, [handle.transform.rests for handle in edit.handles]] = 0.0  # what rests pushes nobody
    if among[missed].max() < PUSHED:
        return None
    return 'handles that look alike push one another: with overlap "interpolate" each arrives'


def _warning(edit: Edit) -> str:
    """Why nothing moved."""
    if not edit.handles and edit.default is None:
        return "nothing moved: nothing is held"
    if all(handle.transform.rests for handle in edit.handles):
        return "nothing moved: no handle is moved, turned or scaled"
    if all(handle.controls.strength == 0 for handle in edit.handles):
        return "nothing moved: the strength of every handle is 0"
    return "nothing moved: no weight is left, or the moves are too small to see"
