"""An edit of a shape as one immutable value: handles, fixed points, symmetry, default transform and preset.

`History` keeps one edit for each step, for undo and redo. `dfd.editing.edit_file` writes edits to files and reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np

from dfd.common import check
from dfd.common.described import About, Brief, Written, check_fields
from dfd.common.errors import ArgumentError, within
from dfd.common.linear_algebra import Float64
from dfd.common.preset import Preset
from dfd.common.read_only import ReadOnlyArrays
from dfd.editing.controls import Controls
from dfd.editing.key_pose import KeyPose
from dfd.editing.points import Place, place_on
from dfd.editing.presets import PRESETS, Rules, SymmetryCandidates
from dfd.editing.regions import members
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import Blend
from dfd.posing.transforms import Transform, Vector, vector
from dfd.symmetry.plane import SymmetryPlane, plane_from_text
from dfd.symmetry.search import symmetry_planes


@dataclass(frozen=True, repr=False)
class Handle(ReadOnlyArrays, Brief):
    """A handle: its place on the shape, its transform, and the controls of its weights.

    Raises ValueError if `id` is below 1, `name` is no text, or the values of `transform` give no finite matrix.
    """

    id: Annotated[int, About("Identifier, never reused in a session; if a file omits it, the smallest free one.", 1.0)]
    place: Place  # on the resting shape
    transform: Transform = field(default_factory=Transform)
    controls: Controls = field(default_factory=Controls)
    name: str | None = None  # name for display, or None

    def __post_init__(self) -> None:
        check_fields(self)
        if any("\ud800" <= letter <= "\udfff" for letter in self.name or ""):
            raise ArgumentError("name", f"must be text that can be written to a file, got {self.name!r}", "Handle")
        if self.place.known:
            _ = self.matrix

    @property
    def pivot(self) -> Vector:
        """Return the center (3,) of the handle's rotation and scale, mesh units."""
        return self.place.position if self.transform.pivot is None else self.transform.pivot

    @cached_property
    def matrix(self) -> Float64:
        """Return the handle's transform as a (3, 4) affine matrix in mesh units, read-only."""
        return self.transform.matrix(self.place.position)


@dataclass(frozen=True, repr=False)
class Fixed(Brief):
    """A point or region that stays in place, together with all surface that looks like it (Eq. 6)."""

    place: Place
    strength: Annotated[float, About("Factor of the subtracted weights; with 1, Eq. 6 is unchanged.", 0.0, 1.0)] = 1.0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, repr=False)
class Edit(Brief):
    """The state of a session: handles, fixed points, plane of symmetry, default transform, preset and key poses.

    Raises ValueError if two handles share an id, two handles or fixed points share a place, or the preset is unknown.
    Raises ValueError if a key pose has a handle that is not among `handles`.
    """

    # handles, fixed: in the order in which they were added
    handles: tuple[Handle, ...] = ()
    fixed: tuple[Fixed, ...] = ()
    # symmetry: files may have "x", "y" or "z", the plane perpendicular to this axis at the bounding box's center
    symmetry: Annotated[SymmetryPlane | None, Written(SymmetryPlane | Literal["x", "y", "z"] | None)] = None
    default: Transform | None = None  # D₀ of Eq. 1, the transform of vertices without weights; None is the identity
    preset: Annotated[Preset, About("Defaults of new handles, and rules that combine handles.")] = "default"
    poses: tuple[KeyPose, ...] = ()  # key poses of the timeline, which do not change the present pose

    def __post_init__(self) -> None:
        check_fields(self)
        ids: set[int] = set()
        taken: dict[Hashable, str] = {}
        for handle in self.handles:
            place, named = handle.place, f"handle {handle.id}"
            if handle.id in ids:
                raise ArgumentError("handles", f"must have distinct ids, got {handle.id} twice", "Edit")
            ids.add(handle.id)
            if place.key in taken:
                both = f"{taken[place.key]} and {named}"
                raise ArgumentError("handles", f"must lie at distinct places, got two at {place}: {both}", "Edit")
            taken[place.key] = named
        for fixed in self.fixed:
            if fixed.place.key in taken:
                used = f"{fixed.place} is already used by {taken[fixed.place.key]}"
                raise ArgumentError("fixed", f"must be at unused places, but the place {used}", "Edit")
            taken[fixed.place.key] = "a fixed point"
        for i, pose in enumerate(self.poses):
            if not isinstance(pose, KeyPose):
                raise ArgumentError("poses", f"must be key poses, got {type(pose).__name__}", "Edit")
            if unknown := sorted(set(pose.transforms) - ids):
                known = ", ".join(map(str, sorted(ids))) or "none"
                must = f"must use handles of the edit ({known}), got handle {unknown[0]}"
                raise ArgumentError(f"poses[{i}].transforms", must, "Edit")

    @property
    def rules(self) -> Rules:
        """Return the settings of the preset."""
        return PRESETS[self.preset]

    @property
    def blending(self) -> Blend:
        """Return the argument `blend` of `dfd.pose`. Dual quaternions keep parts thick under rotations.

        Without rotations, both blends give the same result, so nothing jumps where the blend changes.
        """
        moves = [handle.transform for handle in self.handles] + [self.default or Transform()]
        turns = self.rules.blend == "auto" and any(any(each.rotation) for each in moves)
        return "dual_quaternion" if turns else "linear"

    @property
    def sharing(self) -> tuple[int, ...]:
        """Return the indices of the moving handles, which share components; () for fewer than two, or with "paper"."""
        moving = tuple(i for i, handle in enumerate(self.handles) if not handle.transform.rests)
        return moving if len(moving) > 1 and self.rules.overlap == "add" else ()

    def handle(self, id: int) -> Handle:  # noqa: A002  # same name as in `Handle`
        """Return the handle with an id. Raises ValueError if there is none."""
        for handle in self.handles:
            if handle.id == id:
                return handle
        known = ", ".join(str(handle.id) for handle in self.handles) or "none"
        raise ArgumentError("handle", f"must be the id of a handle ({known}), got {id!r}", "Edit")

    def number(self, handle: Handle) -> int:
        """Return the index of the handle with the id of `handle`."""
        return [each.id for each in self.handles].index(handle.id)

    def released(self, place: Place) -> Edit:
        """Return the edit without the fixed point or region at `place`. Raises ValueError if there is none."""
        kept = tuple(fixed for fixed in self.fixed if fixed.place.key != place.key)
        if len(kept) == len(self.fixed):
            raise ArgumentError("at", f"must be a fixed point, got {place}", "Edit")
        return replace(self, fixed=kept)

    def removed(self, handle: int) -> Edit:
        """Return the edit and its key poses without the handle `handle`. Raises ValueError if there is none."""
        removed = self.handle(handle)
        poses = tuple(pose.without(handle) for pose in self.poses)
        return replace(self, handles=tuple(other for other in self.handles if other is not removed), poses=poses)

    def changed(self, handle: Handle, **values: Any) -> Edit:
        """Return the edit in which `handle`, one of its handles, has other values."""
        new = replace(handle, **values)
        return replace(self, handles=tuple(new if each.id == new.id else each for each in self.handles))


class History:
    """All states of an edit, without limit, and the index of the present one. Unchanged values are shared."""

    __slots__ = ("_floor", "_now", "_states", "_topic")

    def __init__(self, start: Edit) -> None:
        self._states: tuple[Edit, ...] = (start,)  # a tuple, so that `copy.copy` gives an independent history
        self._now = 0
        self._floor = 0  # index of the oldest state that `undo` can reach: 0, or the first state of a `step` block
        self._topic: Hashable = None  # what the newest step changed, such as ("handle", 1); None if no step may join it

    @property
    def edit(self) -> Edit:
        """Return the present state, an immutable value."""
        return self._states[self._now]

    def _record(self, state: Edit, topic: Hashable = None, merge: bool = False) -> None:
        """Make `state` the present state, and discard undone steps. A state that equals the present one adds no step.

        With `merge`, `state` replaces the result of the newest step if that step has the same `topic`.
        """
        joins = merge and topic is not None and topic == self._topic
        if state != self.edit:
            self._now += 0 if joins else 1
            self._states = (*self._states[: self._now], state)
            self._topic = topic
        elif not joins:
            self._topic = None

    @property
    def states(self) -> tuple[tuple[Edit, ...], int]:
        """Return all states, the oldest first, and the index of the present state."""
        return self._states, self._now

    @property
    def can_undo(self) -> bool:
        """Return whether there is a step to take back."""
        return self._now > self._floor

    @property
    def can_redo(self) -> bool:
        """Return whether there is a step that was taken back."""
        return self._now + 1 < len(self._states)

    def undo(self) -> bool:
        """Take back the newest step; return False if there is none."""
        return self._go(-1) if self.can_undo else False

    def redo(self) -> bool:
        """Repeat the step that was taken back last; return False if there is none."""
        return self._go(+1) if self.can_redo else False

    def _go(self, steps: int) -> bool:
        self._now += steps
        self._topic = None
        return True

    @contextmanager
    def step(self, topic: Hashable = None, *, merge: bool = False) -> Iterator[None]:
        """Record all changes in the block `with deformer.step():` as one step. If the block raises, undo them all.

        With `merge`, this step joins the previous step if both have the same `topic`, which must not be None.
        """
        start, floor, before, about = self._now, self._floor, self._states, self._topic
        self._floor, self._topic = start, None
        try:
            yield
        except BaseException:
            self._states, self._now = before, start
            raise
        finally:
            self._floor, self._topic = floor, about
        made = self.edit
        if self._now > start:
            self._states, self._now = self._states[: start + 1], start
        self._record(made, topic, merge)


def edit_on(mesh: Mesh, edit: Edit, place: Callable[[str, Place], Place] | None = None) -> Edit:
    """Return `edit` with all places converted to places on `mesh`, and check its masks and its plane of symmetry.

    The function `place` converts one place. Its first argument is the key of this place in an edit file, such as
    "fixed[0]". The default is `place_on`. Raises ValueError if `mesh` has no vertex for a place or a mask, a point lies
    farther from the shape than the diagonal of its bounding box, or the plane of symmetry does not cut the shape.
    """
    if edit.symmetry is not None:
        _check_cuts("symmetry", mesh, edit.symmetry)

    def on_mesh(path: str, said: Place) -> Place:
        with within(path):
            return place_on(mesh, said)

    place, handles = place or on_mesh, []
    for i, handle in enumerate(edit.handles):
        path, controls = f"handles[{i}]", handle.controls
        if controls.mask is not None:
            with within(f"{path}.mask"):
                members(mesh, controls.mask)
        off = enumerate(controls.excluded_counterparts)
        placed = tuple(place(f"{path}.excluded_counterparts[{j}]", one) for j, one in off)
        found = place(path, handle.place)
        with within(path):
            controls = replace(controls, excluded_counterparts=placed) if placed else controls
            handles.append(replace(handle, place=found, controls=controls))
    fixed = tuple(replace(one, place=place(f"fixed[{i}]", one.place)) for i, one in enumerate(edit.fixed))
    return replace(edit, handles=tuple(handles), fixed=fixed)


def with_preset(edit: Edit, preset: Preset, mesh: Mesh) -> Edit:
    """Return `edit` with another `preset`, which also sets the reach, falloff and counterparts of every handle.

    The plane of symmetry gets the preset's band width (see `band_on`). Raises ValueError if the preset is unknown.
    """
    controls = PRESETS[check.choice("Edit", "preset", preset, Preset)].handle
    handles = (replace(handle, controls=replace(handle.controls, **controls)) for handle in edit.handles)
    plane = edit.symmetry and replace(edit.symmetry, band=band_on(mesh, preset))
    return replace(edit, preset=preset, handles=tuple(handles), symmetry=plane)


def band_on(mesh: Mesh, preset: Preset) -> float:
    """Return the preset's half width, in mesh units, of the band in which both sides of a mirror plane are blended."""
    return PRESETS[preset].band * float(np.max(mesh.extents))


def symmetry_on(
    mesh: Mesh,
    plane: SymmetryPlane | str | None,
    band: float | None = None,
    *,
    preset: Preset = "default",
    field: Field | None = None,
    candidates: SymmetryCandidates | None = None,
    threshold: float | Literal["relative"] | None = None,
) -> SymmetryPlane:
    """Return `plane` itself, or the plane for a text that `dfd.symmetry.plane.plane_from_text` reads.

    With a `field`, the text "auto" gives the plane with the most similar sides. `candidates` and `threshold` are
    arguments of `symmetry_planes`; if left out, they are those of the preset. `band`, in mesh units, replaces the
    plane's own band. If `band` is left out, a plane from a text has the preset's band.

    Raises ValueError if `plane` is neither a plane nor such a text, "auto" finds no plane, or the plane does not cut
    the shape. Raises ValueError if `band` is negative or not finite.
    """
    defaults = PRESETS[preset]
    if plane != "auto" and not (candidates is None and threshold is None):
        raise ArgumentError("candidates", f"and `threshold` can only be given if `plane` is 'auto', got {plane!r}")
    if band is None and isinstance(plane, str):
        band = band_on(mesh, preset)
    if plane == "auto" and field is not None:
        threshold = defaults.threshold if threshold is None else threshold
        found = symmetry_planes(mesh, field, candidates=candidates or defaults.candidates, threshold=threshold)
        if not found:
            advice = "; distill with preset='paper', mirrored=True for lower scores"
            known = preset == "paper" and field.settings.get("mirrored") is False
            reason = f"cannot be 'auto': no plane has two sides that look alike{advice if known else ''}"
            raise ArgumentError("plane", reason)
        plane = found[0]
    elif isinstance(plane, str):
        try:
            plane = plane_from_text(plane, mesh)
        except ArgumentError as error:
            raise ArgumentError("plane", error.reason) from None
    elif not isinstance(plane, SymmetryPlane):
        raise ArgumentError(
            "plane", f"must be a text such as x or x=0.1, or a SymmetryPlane, got {type(plane).__name__}"
        )
    if band is not None:
        plane = replace(plane, band=check.number(None, "band", band, minimum=0.0))
    _check_cuts("plane", mesh, plane)
    return plane


def _check_cuts(name: str, mesh: Mesh, plane: SymmetryPlane) -> None:
    """Raise ValueError, which calls the plane `name`, if all vertices lie on one side of its band."""
    heights = plane.signed_distance(mesh.vertices)
    low, high = float(heights.min()), float(heights.max())
    if low > plane.band or high < -plane.band:
        raise ArgumentError(
            name, f"must cut the shape, but all vertices lie {low:.3g} to {high:.3g} from it (signed distance)"
        )


def box_center(mesh: Mesh) -> Vector:
    """Return the center (3,) of the bounding box, in mesh units: the pivot of D₀ (`Edit.default`) if none is set."""
    return vector("mesh", np.asarray(mesh.bounds, np.float64).mean(axis=0))
