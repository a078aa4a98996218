"""An edit of a shape, as one immutable value: handles, fixed points, symmetry, and how they are put together.

It is what `Deformer` steps through and what it keeps in a file; `dfd.editing.document` describes the document.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from dfd.common import check
from dfd.common.preset import Preset
from dfd.editing.controls import Blend, Controls, Overlap, controls_with_places
from dfd.editing.place import Place, place_on
from dfd.editing.presets import PRESETS, SymmetryCandidates
from dfd.editing.regions import Region, members
from dfd.posing.transforms import Transform, Vector, vector
from dfd.symmetry.plane import SymmetryPlane, plane_from_text
from dfd.symmetry.search import symmetry_planes

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

__all__ = ["Edit", "Fixed", "Handle", "band_on", "box_center", "edit_on", "empty_edit", "symmetry_on", "with_preset"]

IDENTITY = Transform()
CONTROLS = Controls()
DEFAULTS = PRESETS["default"]


@dataclass(frozen=True)
class Handle:
    """What is held of the shape, and what is done to it.

    Attributes
    ----------
    id
        Stays with the handle for as long as it lives, and is never given to another one.
    place
        Where it is on the resting shape.
    transform
        What is done to it, about its own pivot.
    controls
        What follows it.
    name
        For people; None when nobody gave one.

    Raises
    ------
    ValueError
        If `name` is no text, or the numbers are so large that the matrix is not finite.
    """

    id: int
    place: Place
    transform: Transform = IDENTITY
    controls: Controls = CONTROLS
    name: str | None = None

    def __post_init__(self) -> None:
        """Refuse what no frame should have to look at again."""
        name: object = self.name
        if name is not None and not (isinstance(name, str) and name):
            raise ValueError(f"Handle: `name` must be a text that is not empty, got {self.name!r}")
        if name is not None and any("\ud800" <= letter <= "\udfff" for letter in name):
            raise ValueError(f"Handle: `name` must be text that can be written to a file, got {self.name!r}")
        _ = self.matrix

    @property
    def pivot(self) -> Vector:
        """The point, (3,) in mesh units, about which the handle turns and scales."""
        return self.place.position if self.transform.pivot is None else self.transform.pivot

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """The handle's transform as a (3, 4) affine matrix in mesh units, read-only."""
        return self.transform.matrix(self.place.position)


@dataclass(frozen=True)
class Fixed:
    """A point or a region that stays, and with it all that looks like it (Eq. 6).

    Attributes
    ----------
    place
        Where it is on the resting shape.
    strength
        In [0, 1]: how much of the weight there it takes away; 1 is Eq. 6.
    """

    place: Place
    strength: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a strength that is none."""
        strength = check.number("Fixed", "strength", self.strength, minimum=0.0, maximum=1.0)
        object.__setattr__(self, "strength", strength)

    @property
    def position(self) -> Vector:
        """Where it is, (3,) in mesh units."""
        return self.place.position

    @property
    def vertex(self) -> int | None:
        """The vertex that it is, or None."""
        return self.place.vertex


@dataclass(frozen=True)
class Edit:
    """Everything that a session has done to a shape; never changed, only replaced.

    Attributes
    ----------
    handles, fixed
        In the order in which they came.
    symmetry
        The plane across which handles act on both sides, or None.
    default
        D₀ of Eq. 1, what happens to what no handle holds; None is nothing.
    overlap, blend
        How weights that meet and transforms are put together, by the names of `dfd.pose`.
    arrive
        Whether handles get back what fixed points take from them (`Deformer.arrive`).
    mirrored_locality, bridges
        From where and over what distances along the surface are measured (`Deformer.mirrored_locality`, `.bridges`).
    preset
        What new handles start with, and where all this came from unless it was set apart.

    Raises
    ------
    ValueError
        If two handles share an id, or any two handles or fixed points share a place, or a name is unknown.
    """

    handles: tuple[Handle, ...] = ()
    fixed: tuple[Fixed, ...] = ()
    symmetry: SymmetryPlane | None = None
    default: Transform | None = None
    overlap: Overlap = DEFAULTS.overlap
    blend: Blend = DEFAULTS.blend
    arrive: bool = DEFAULTS.arrive
    mirrored_locality: bool = DEFAULTS.mirrored_locality
    bridges: bool = DEFAULTS.bridges
    preset: Preset = "default"

    def __post_init__(self) -> None:
        """Refuse two of what may be only once."""
        check.choice("Edit", "overlap", self.overlap, Overlap)
        check.choice("Edit", "blend", self.blend, Blend)
        check.choice("Edit", "preset", self.preset, Preset)
        for name in ("arrive", "mirrored_locality", "bridges"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"Edit: `{name}` must be True or False, got {getattr(self, name)!r}")
        ids: set[int] = set()
        taken: dict[tuple[Vector, Region | None], str] = {}
        for handle in self.handles:
            if handle.id in ids:
                raise ValueError(f"Edit: `handles` must have distinct ids, got {handle.id} twice")
            ids.add(handle.id)
            key = (handle.place.position, handle.place.region)
            if key in taken:
                raise ValueError(
                    f"Edit: `handles` must lie at distinct places, got two at {handle.place}: "
                    f"{taken[key]} and handle {handle.id}"
                )
            taken[key] = f"handle {handle.id}"
        for fixed in self.fixed:
            key = (fixed.position, fixed.place.region)
            if key in taken:
                raise ValueError(f"Edit: `fixed` must be free places, but {fixed.place} is {taken[key]} already")
            taken[key] = "fixed"

    def handle(self, id: int) -> Handle:  # noqa: A002  # the handle's own word for it
        """The handle of that id.

        Raises
        ------
        ValueError
            If there is none.
        """
        for handle in self.handles:
            if handle.id == id:
                return handle
        known = ", ".join(str(handle.id) for handle in self.handles) or "none"
        raise ValueError(f"Edit: `handle` must be the id of a handle ({known}), got {id!r}")

    def released(self, place: Place) -> Edit:
        """The edit without the fixed point or region at `place`.

        Raises
        ------
        ValueError
            If there is none.
        """
        kept = tuple(fixed for fixed in self.fixed if not _same(fixed.place, place))
        if len(kept) == len(self.fixed):
            raise ValueError(f"Edit: `at` must be a fixed point, got {place}")
        return replace(self, fixed=kept)

    def replaced(self, changed: Handle) -> Edit:
        """The edit with `changed` in place of the handle of its id."""
        return replace(self, handles=tuple(changed if handle.id == changed.id else handle for handle in self.handles))


def _same(one: Place, other: Place) -> bool:
    return (one.position, one.region) == (other.position, other.region)


def edit_on(mesh: Mesh, edit: Edit) -> Edit:
    """`edit` with its vertices and regions where those of `mesh` lie.

    Raises
    ------
    ValueError
        If one of them is none of `mesh`.
    """
    for handle in edit.handles:
        if handle.controls.within is not None:
            members(mesh, handle.controls.within)
    handles = (
        replace(handle, place=place_on(mesh, handle.place), controls=controls_with_places(mesh, handle.controls))
        for handle in edit.handles
    )
    fixed = (replace(fixed, place=place_on(mesh, fixed.place)) for fixed in edit.fixed)
    return replace(edit, handles=tuple(handles), fixed=tuple(fixed))


def empty_edit(preset: Preset) -> Edit:
    """The edit that a session of this preset starts with.

    Raises
    ------
    ValueError
        If there is no such preset.
    """
    return Edit(preset=preset, **PRESETS[check.choice("Edit", "preset", preset, Preset)].whole_shape)


def with_preset(edit: Edit, preset: Preset, mesh: Mesh) -> Edit:
    """`edit` with everything that a preset says, whatever it was before: of the shape, of its plane and of each handle.

    Raises
    ------
    ValueError
        If there is no such preset.
    """
    empty, shape = empty_edit(preset), PRESETS[preset].handle
    handles = (replace(handle, controls=replace(handle.controls, **shape)) for handle in edit.handles)
    plane = edit.symmetry and replace(edit.symmetry, band=band_on(mesh, preset))
    return replace(empty, handles=tuple(handles), fixed=edit.fixed, default=edit.default, symmetry=plane)


def band_on(mesh: Mesh, preset: Preset) -> float:
    """The half width, mesh units, of the zone in which the sides of a mirror plane blend."""
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
    """The plane that a person means: a plane, or a text as `dfd.symmetry.plane.plane_from_text` reads it.

    With a `field`, "auto" is the plane across which the shape looks most alike, of `candidates` and by a `threshold` as
    `symmetry_planes` takes them; the preset's if left out. `band`, in mesh units, replaces the plane's own, which for a
    text is the preset's.

    Raises
    ------
    ValueError
        If `plane` is neither, "auto" finds none, it lies beside the shape, or `band` is negative or not finite.
    """
    defaults = PRESETS[preset]
    if plane != "auto" and not (candidates is None and threshold is None):
        raise ValueError(f"`candidates` and `threshold` are for the plane auto, got {plane!r}")
    if band is None and isinstance(plane, str):
        band = band_on(mesh, preset)
    if isinstance(plane, str) and plane == "auto" and field is not None:
        found = symmetry_planes(
            field,
            mesh,
            candidates=candidates or defaults.candidates,
            threshold=defaults.threshold if threshold is None else threshold,
        )
        if not found:
            raise ValueError("`plane` cannot be 'auto': the shape looks alike across no plane")
        plane = found[0]
    elif isinstance(plane, str):
        plane = _plane_in(plane, mesh)
    elif not isinstance(plane, SymmetryPlane):
        raise ValueError(f"`plane` must be a text such as x or x=0.1, or a SymmetryPlane, got {type(plane).__name__}")
    if band is not None:
        plane = replace(plane, band=check.number("band", "band", band, minimum=0.0))
    heights = plane.signed_distance(mesh.vertices)
    low, high = float(heights.min()), float(heights.max())
    if low > plane.band or high < -plane.band:
        raise ValueError(
            f"`plane` must pass through the shape, which lies from {low:.3g} to {high:.3g} of it, along its normal"
        )
    return plane


def _plane_in(text: str, mesh: Mesh) -> SymmetryPlane:
    try:
        return plane_from_text(text, mesh)
    except ValueError as error:
        raise ValueError(str(error).replace("plane_from_text: `text`", "`plane`")) from None


def box_center(mesh: Mesh) -> Vector:
    """Center of the bounding box, the pivot of a default transform without one, (3,) in mesh units."""
    return vector("mesh", np.asarray(mesh.bounds, np.float64).mean(axis=0))
