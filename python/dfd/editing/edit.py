"""An edit of a shape as one immutable value: handles, fixed points, symmetry, default transform and preset.

`Deformer` keeps one edit for each step, and pydantic converts an edit to a file (`dfd.editing.edit_file`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from dfd.common import check
from dfd.common.described import About, Brief, Written, check_fields
from dfd.common.errors import ArgumentError, within
from dfd.common.linear_algebra import Float64
from dfd.common.preset import Preset
from dfd.editing.controls import Controls
from dfd.editing.influence.regions import members
from dfd.editing.points import Place, place_on
from dfd.editing.presets import PRESETS, Rules, SymmetryCandidates
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh
from dfd.posing.pose import Blend
from dfd.posing.transforms import Transform, Vector, vector
from dfd.symmetry.plane import SymmetryPlane, plane_from_text
from dfd.symmetry.search import symmetry_planes

MOST_LINEAR = 30.0  # degrees: for larger rotations a linear blend is thinner by more than 3 % halfway


@dataclass(frozen=True, repr=False)
class Handle(Brief):
    """A place on the shape, the transform of that place, and the controls of what follows it.

    Raises ValueError if `id` is below 1, `name` is no text, or the numbers are so large that the matrix is not finite.
    """

    # id: never changes, and is never given to another handle
    id: Annotated[int, About("Once each; given in order where it is missing.", 1.0)]
    place: Place  # its place on the resting shape
    transform: Transform = field(default_factory=Transform)  # its transform, about its own pivot
    controls: Controls = field(default_factory=Controls)  # controls of what follows it
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
    """A point or a region that stays in place with all its counterparts (Eq. 6)."""

    place: Place
    strength: Annotated[float, About("How much of the weight there it takes away; 1 is Eq. 6.", 0.0, 1.0)] = 1.0

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def position(self) -> Vector:
        """Return the position (3,), mesh units."""
        return self.place.position

    @property
    def vertex(self) -> int | None:
        """Return the vertex at the position, or None."""
        return self.place.vertex


@dataclass(frozen=True, repr=False)
class Edit(Brief):
    """All changes that a session made to a shape.

    Raises ValueError if two handles share an id, two handles or fixed points share a place, or a name is unknown.
    """

    # handles, fixed: in the order in which they were added
    handles: tuple[Handle, ...] = ()
    fixed: tuple[Fixed, ...] = ()
    # symmetry: the plane across which handles act on both sides, or None; in a file also a letter
    symmetry: Annotated[SymmetryPlane | None, Written(SymmetryPlane | Literal["x", "y", "z"] | None)] = None
    default: Transform | None = None  # D₀ of Eq. 1, the transform of all that no handle holds; None is the identity
    # preset: defaults of new handles, and rules that combine handles
    preset: Annotated[Preset, About("The paper's equations to the letter, or dfd's own way.")] = "default"

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
                already = f"{fixed.place} is {taken[fixed.place.key]} already"
                raise ArgumentError("fixed", f"must be free places, but {already}", "Edit")
            taken[fixed.place.key] = "fixed"

    @property
    def rules(self) -> Rules:
        """Return the values of the preset."""
        return PRESETS[self.preset]

    @property
    def blending(self) -> Blend:
        """Return how `dfd.pose` blends transforms: dual quaternions preserve the volume under large rotations."""
        turns = (np.linalg.norm(handle.transform.rotation) for handle in self.handles)
        far = self.rules.blend == "auto" and max(turns, default=0.0) > MOST_LINEAR
        return "dual_quaternion" if far else "linear"

    def handle(self, id: int) -> Handle:  # noqa: A002  # same name as in `Handle`
        """Return the handle with an id; ValueError if there is none."""
        for handle in self.handles:
            if handle.id == id:
                return handle
        known = ", ".join(str(handle.id) for handle in self.handles) or "none"
        raise ArgumentError("handle", f"must be the id of a handle ({known}), got {id!r}", "Edit")

    def released(self, place: Place) -> Edit:
        """Return the edit without the fixed point or region at `place`; ValueError if there is none."""
        kept = tuple(fixed for fixed in self.fixed if fixed.place.key != place.key)
        if len(kept) == len(self.fixed):
            raise ArgumentError("at", f"must be a fixed point, got {place}", "Edit")
        return replace(self, fixed=kept)

    def removed(self, handle: int) -> Edit:
        """Return the edit without the handle with an id; ValueError if there is none."""
        held = self.handle(handle)
        return replace(self, handles=tuple(other for other in self.handles if other is not held))

    def replaced(self, changed: Handle) -> Edit:
        """Return the edit with `changed` in place of the handle with the same id."""
        return replace(self, handles=tuple(changed if handle.id == changed.id else handle for handle in self.handles))


def edit_on(mesh: Mesh, edit: Edit, place: Callable[[str, Place], Place] | None = None) -> Edit:
    """Return `edit` with its vertices and regions placed on `mesh`; `place` maps a key and a place to the new place.

    Raises ValueError if `mesh` lacks one of them.
    """

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
    """Return `edit` with another preset, whose defaults replace every handle's controls and the plane's band.

    Raises ValueError if there is no such preset.
    """
    said = PRESETS[check.choice("Edit", "preset", preset, Preset)].handle
    handles = (replace(handle, controls=replace(handle.controls, **said)) for handle in edit.handles)
    plane = edit.symmetry and replace(edit.symmetry, band=band_on(mesh, preset))
    return replace(edit, preset=preset, handles=tuple(handles), symmetry=plane)


def band_on(mesh: Mesh, preset: Preset) -> float:
    """Return the half width of the blend band at a mirror plane, mesh units."""
    return PRESETS[preset].band * float(np.max(mesh.extents))


def symmetry_on(
    mesh: Mesh,
    plane: SymmetryPlane | str,
    band: float | None = None,
    *,
    preset: Preset = "default",
    field: Field | None = None,
    candidates: SymmetryCandidates | None = None,
    threshold: float | Literal["relative"] | None = None,
) -> SymmetryPlane:
    """Return the plane for a `SymmetryPlane` or a text that `dfd.symmetry.plane.plane_from_text` reads.

    With a `field`, "auto" is the plane with the most similar sides. `candidates` and `threshold` are those of
    `symmetry_planes`; the preset's if left out. `band`, in mesh units, replaces the plane's own band; the band of a
    plane from a text is the preset's.

    Raises ValueError if `plane` is neither, "auto" finds none, or the plane does not cut the shape. Raises ValueError
    if `band` is negative or not finite.
    """
    defaults = PRESETS[preset]
    if plane != "auto" and not (candidates is None and threshold is None):
        raise ArgumentError("candidates", f"and `threshold` are for the plane auto, got {plane!r}")
    if band is None and isinstance(plane, str):
        band = band_on(mesh, preset)
    if plane == "auto" and field is not None:
        threshold = defaults.threshold if threshold is None else threshold
        found = symmetry_planes(field, mesh, candidates=candidates or defaults.candidates, threshold=threshold)
        if not found:
            raise ArgumentError("plane", "cannot be 'auto': the shape looks alike across no plane")
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
    heights = plane.signed_distance(mesh.vertices)
    low, high = float(heights.min()), float(heights.max())
    if low > plane.band or high < -plane.band:
        raise ArgumentError(
            "plane", f"must pass through the shape, which lies from {low:.3g} to {high:.3g} of it, along its normal"
        )
    return plane


def box_center(mesh: Mesh) -> Vector:
    """Return the center (3,) of the bounding box, mesh units: the pivot of a default transform without a pivot."""
    return vector("mesh", np.asarray(mesh.bounds, np.float64).mean(axis=0))
