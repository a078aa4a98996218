"""Report the effect of an edit on a shape, in numbers and in one sentence."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int32
from dfd.editing.edit import Edit, Handle
from dfd.editing.shape import blend_of, carried, resting
from dfd.editing.weights.axis_motions import bendable_parts, level_with_axis
from dfd.editing.weights.fill import Column
from dfd.editing.weights.session_weights import SessionWeights, is_split
from dfd.geometry.gaps import TOUCHING, Gaps
from dfd.geometry.topology import face_sides
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Vector, vector

# Smallest visible distance, as a fraction of the bounding-box diagonal. A vertex counts as moved if it moves further.
# A handle counts as arrived if its distance from its target is at most this.
VISIBLE = 1e-3
LEAST_STRETCH = 1.05  # smaller stretches of edges are not mentioned
LEAST_COUNTED = 0.35  # a counterpart counts if its largest weight is at least this fraction of the handle's largest


@dataclass(frozen=True)
class HandleReport:
    """The result of one handle."""

    id: int
    name: str | None
    vertex: int  # the handle's vertex, or the vertex nearest to its point or to the center of its region
    target: Vector  # (3,) position to which the handle's transform should move `vertex`, mesh units
    landed: Vector  # (3,) posed position of `vertex`, mesh units
    missing: float  # the distance between `target` and `landed`, mesh units
    arrived: bool  # whether `missing` is at most 0.1 % of the bounding-box diagonal, which is too small to see
    mirrored: Vector | None  # (3,) mirror image of the handle, at which the handle also acts, or None
    counterparts: int  # number of counterparts with pivots of their own, without weak ones; 1 if all share one pivot
    along_with: tuple[int, ...] = ()  # ids of handles that also move this handle, because their parts contain its part
    share: float | None = None  # area that the handle's part moves, as a fraction of the surface; None without a part
    level: int | None = None  # level of the part; None without a part
    levels: tuple[int, int] = (0, 0)  # the lowest and the highest level of the parts at the handle
    left_out: tuple[int, ...] = ()  # a vertex of each part that looks similar, but is not likely enough to follow
    note: str | None = None  # what differs from what was asked, such as a level that does not exist

    @property
    def step(self) -> str:
        """The size of the part in the words of the app: its step from the smallest part, and its share."""
        if self.level is None or self.share is None:
            return ""
        low, high = self.levels
        return f"step {self.level - low + 1} of {high - low + 1}: {percent(self.share)}"

    def __str__(self) -> str:
        """Return the result in a few words."""
        named = f"handle {self.id}" + (f" ({self.name})" if self.name else "")
        words = f"{named} arrived" if self.arrived else f"{named} is {self.missing:.3g} from its target"
        if self.counterparts > 1:
            others = "1 other" if self.counterparts == 2 else f"{self.counterparts - 1} others"
            words += f", with {others}, each about its own pivot"
        if self.along_with:
            words += f", along with handle {' and '.join(map(str, self.along_with))}"
        if self.mirrored is not None:
            words += f", mirrored at {','.join(f'{x:.3g}' for x in self.mirrored)}"
        if self.share is not None:
            words += f", with {self.step} of the surface (level {self.level})"
        if self.note is not None:
            words += f", {self.note}"
        if self.left_out:
            look, them = (
                ("1 more part looks", "it")
                if len(self.left_out) == 1
                else (f"{len(self.left_out)} more parts look", "them")
            )
            at = " and ".join(map(str, self.left_out[:3]))
            words += f" ({look} similar: to include {them}, add a handle with the same motion at vertex {at})"
        return words


@dataclass(frozen=True)
class Report:
    """The result of an edit."""

    moved: float  # fraction of vertices that moved by more than 0.1 % of the bounding-box diagonal
    farthest: float  # largest distance that a vertex moved, mesh units
    stretch: float  # largest factor by which an edge became longer; at least 1
    handles: tuple[HandleReport, ...]  # result of each handle
    warning: str | None  # the reason why nothing moved, or None if a vertex moved
    advice: str | None = None  # a sentence about handles whose scale flattens or mirrors; None if no scale does
    gap: float = 0.0  # largest gap that opened between two pieces of the mesh that touch at rest, mesh units
    loose: int = 0  # number of pairs of such pieces that touch no longer

    def __repr__(self) -> str:
        """Return the class name with the sentence of `__str__`."""
        return f"Report({str(self)!r})"

    def __str__(self) -> str:
        """Return the result in one sentence."""
        if self.warning is not None:
            return self.warning
        told = [f"moved {percent(self.moved)} of the vertices, up to {self.farthest:.3g}"]
        if self.stretch >= LEAST_STRETCH:
            told[0] += f", and stretched edges up to {self.stretch:.1f} times"
        if len(self.handles) > 1 and all(
            each.arrived and each.mirrored is None and each.note is None for each in self.handles
        ):
            told.append(f"all {len(self.handles)} handles arrived")
        else:
            told += map(str, self.handles)
        if self.loose:
            pairs = "a pair of touching pieces" if self.loose == 1 else f"{self.loose} pairs of touching pieces"
            told.append(f"{pairs} came apart by up to {self.gap:.3g}")
        if self.advice is not None:
            told.append(self.advice)
        return "; ".join(told)


def percent(share: float, digits: int = 0) -> str:
    """Return a share in percent, with some `digits` after the point: "12 %", or "less than 1 %" if it is smaller."""
    least = 10.0**-digits
    return f"less than {least:.{digits}f} %" if 0 < 100 * share < least else f"{100 * share:.{digits}f} %"


def report(mesh: Mesh, edit: Edit, weights: SessionWeights, posed: Float64) -> Report:
    """Return the report of `edit` on `mesh`. `posed` (V, 3) are the vertices after the edit."""
    distances = np.linalg.norm(posed - mesh.vertices, axis=1)
    visible = VISIBLE * mesh.diagonal
    moved = float(np.mean(distances > visible))
    followed, columns = weights.columns(edit)
    counts = _counterpart_counts(edit, followed, columns)
    own = {column.handle: number for number, column in reversed(list(enumerate(columns)))}  # each handle's first column
    bent, handles = resting(weights, edit), []
    blend = blend_of(mesh, edit, followed, columns, bent)
    for i, handle in enumerate(edit.handles):
        vertex = weights.rows.anchor(handle.place)
        first = columns[own[i]]
        target = first.matrix(edit) @ np.append(bent[vertex], 1.0)
        if first.carriers:
            target += carried(bent[vertex], followed[vertex], own[i], blend) - bent[vertex]
        missing = float(np.linalg.norm(posed[vertex] - target))
        place = handle.place.position
        image = place if edit.symmetry is None else vector("mirrored", edit.symmetry.reflect([place])[0])
        handles.append(
            HandleReport(
                id=handle.id,
                name=handle.name,
                vertex=vertex,
                target=vector("target", target),
                landed=vector("landed", posed[vertex]),
                missing=missing,
                arrived=missing <= visible,
                mirrored=image if np.linalg.norm(np.subtract(image, place)) > visible else None,
                counterparts=counts[i],
                along_with=tuple(sorted({edit.handles[columns[number].handle].id for number in first.carriers})),
                **_part(edit, handle, weights),
            )
        )
    stretch = largest_stretch(mesh.vertices, posed, mesh.faces)
    gaps = weights.rows.kept.get("gaps", None, lambda: Gaps(mesh)).opened(posed) if moved else np.zeros(0)
    return Report(
        moved,
        float(distances.max()),
        stretch,
        tuple(handles),
        None if moved else _warning(edit),
        _advice(edit),
        float(gaps.max(initial=0.0)),
        int((gaps > TOUCHING * mesh.diagonal).sum()),
    )


def _part(edit: Edit, handle: Handle, weights: SessionWeights) -> dict[str, Any]:
    """Return the fields of `HandleReport` that describe the part of a handle; none if it moves no part."""
    if handle.controls.reach != "part":
        return {}
    held = weights.held(edit, handle)
    all_parts, vertex = weights.parts_with(edit.symmetry), weights.rows.anchor(handle.place)
    lowest, highest = all_parts.levels(vertex)
    if held is None:
        return {"levels": (lowest, highest), "note": "with weights by features, because it lies on no part"}
    asked, notes = handle.controls.level, []
    level = min(max(asked, lowest), highest)
    if not lowest <= asked <= highest:
        notes.append(f"because level {asked} does not exist")
    if handle.transform.bends and (parts := bendable_parts(weights, edit, handle)) and not parts[0].slender:
        other = level_with_axis(weights, edit, handle)
        instead = "" if other is None else f" (level {other} has one)"
        notes.append(f"turned as a whole, because its part has no axis along which it could bend{instead}")
    on = [moves for _, moves in weights.counterparts(handle, held)]
    share = sum(held.area(number) for number, moves in enumerate(on) if moves)
    note = " and ".join(notes) or None
    left_out = tuple(all_parts.left_out(vertex, level)) if handle.controls.follow == "all" else ()
    return {"share": share, "level": level, "levels": (lowest, highest), "left_out": left_out, "note": note}


def _counterpart_counts(edit: Edit, weights: Float32, columns: Sequence[Column]) -> list[int]:
    """Return the number of counterparts of each handle, (H,), without those below `LEAST_COUNTED`."""
    peaks: list[list[float]] = [[] for _ in edit.handles]
    for column, peak in zip(columns, weights.max(axis=0, initial=0.0).tolist(), strict=True):
        if is_split(edit.handles[column.handle]):
            peaks[column.handle].append(peak)
    return [max(sum(peak >= LEAST_COUNTED * max(own) for peak in own), 1) if own else 1 for own in peaks]


def largest_stretch(rest: Float64, posed: Float64, faces: Int32) -> float:
    """Return the largest factor by which a side of `faces` (F, 3) became longer, at least 1.

    Sides of moved faces count if they are longer than a millionth of the longest side.
    """
    moved = (posed != rest).any(axis=1)
    sides = face_sides(faces[moved[faces].any(axis=1)])
    before, after = (np.linalg.norm(points[sides[:, 0]] - points[sides[:, 1]], axis=1) for points in (rest, posed))
    long = before > 1e-6 * before.max(initial=0.0)
    return float((after[long] / before[long]).max(initial=1.0))


def _advice(edit: Edit) -> str | None:
    """Return a sentence about handles whose scale flattens or mirrors parts; None if no scale does."""
    scales = {f"handle {handle.id}": handle.transform.scale for handle in edit.handles}
    flat = [name for name, scale in scales.items() if 0.0 in scale]
    mirrored = [name for name, scale in scales.items() if np.prod(scale) < 0]
    for names, verb, result in (
        (flat, "flatten", ": a factor of scale is 0"),
        (mirrored, "mirror", ", so its faces look inward: a factor of scale is negative"),
    ):
        if names:
            return f"{' and '.join(names)} {verb}{'s' if len(names) == 1 else ''} the held part{result}"
    return None


def _warning(edit: Edit) -> str:
    """Return the reason why nothing moved."""
    if not edit.handles and edit.default is None:
        return "nothing moved: there is no handle"
    if all(handle.transform.rests for handle in edit.handles):
        return "nothing moved: no handle is moved, turned or scaled"
    if all(handle.controls.strength == 0 for handle in edit.handles):
        return "nothing moved: the strength of every handle is 0"
    return "nothing moved: all weights are 0, or the motions are too small to see"
