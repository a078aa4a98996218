"""An edit of a shape, as one immutable value: handles, fixed points, symmetry and default transform.

It is what `Deformer` steps through and what it keeps in a file; `dfd.editing.edit_file` describes the document.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.common import check
from dfd.posing.transforms import Vector, affine, rotation_vector, scale_factors, vector
from dfd.symmetry.plane import AXES, DEFAULT_BAND, SymmetryPlane, axis_name, axis_plane
from dfd.symmetry.search import symmetry_planes

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

__all__ = ["Edit", "Handle", "Place", "Transform", "box_center", "edit_on", "handle_on", "place_on", "symmetry_on"]


@dataclass(frozen=True)
class Place:
    """Where a handle or a fixed point sits on the resting shape: at a vertex, or at any point of space.

    Attributes
    ----------
    position
        (3,) in mesh units.
    vertex
        Index of the vertex that lies there, or None.
    """

    position: Vector
    vertex: int | None = None

    def __str__(self) -> str:
        """Name it for a message, and as the command line takes it."""
        return ",".join(f"{x:g}" for x in self.position) if self.vertex is None else str(self.vertex)


@dataclass(frozen=True)
class Transform:
    """Scale, then rotation, then translation, about a pivot.

    Attributes
    ----------
    translation
        (3,) in mesh units.
    rotation
        (3,) rotation vector in degrees: its direction is the axis, its length the angle, right-handed.
    scale
        (3,) factors along the mesh's axes.
    pivot
        (3,) in mesh units; None is the handle's own position, or for the default transform the centre of the box.
    """

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)
    scale: Vector = (1.0, 1.0, 1.0)
    pivot: Vector | None = None

    def changed(
        self,
        function: str,
        *,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
    ) -> Transform:
        """The transform with some of its parts exchanged; None leaves a part, the pivot "auto" takes its own away.

        Raises
        ------
        ValueError
            In the name of `function`, if a number is not finite or not of its shape.
        """
        own_pivot = self.pivot
        if pivot is not None:
            own_pivot = None if isinstance(pivot, str) and pivot == "auto" else vector(function, "pivot", pivot)
        return Transform(
            self.translation if translation is None else vector(function, "translation", translation),
            self.rotation if rotation is None else rotation_vector(function, rotation),
            self.scale if scale is None else scale_factors(function, scale),
            own_pivot,
        )

    @property
    def rests(self) -> bool:
        """Whether it leaves every point in place, whatever the pivot."""
        return self == Transform(pivot=self.pivot)

    def matrix(self, center: Vector) -> NDArray[np.float64]:
        """The (3, 4) affine matrix in mesh units; `center` is the pivot of a transform without one."""
        pivot = center if self.pivot is None else self.pivot
        return affine(translation=self.translation, rotation=self.rotation, scale=self.scale, pivot=pivot)


@dataclass(frozen=True)
class Handle:
    """A point of the shape that is held, and what is done to it.

    Attributes
    ----------
    id
        Stays with the handle for as long as it lives, and is never given to another one.
    place
        Where it sits on the resting shape.
    transform
        What is done to it, about its own pivot.
    locality
        λ of Eq. 7; 0 lets it reach everything that looks alike, more keeps it near.
    name
        For people; None when nobody gave one.
    """

    id: int
    place: Place
    transform: Transform = Transform()
    locality: float = 0.0
    name: str | None = None

    @property
    def pivot(self) -> Vector:
        """The point, (3,) in mesh units, about which the handle turns and scales."""
        return self.place.position if self.transform.pivot is None else self.transform.pivot

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The handle's transform as a (3, 4) affine matrix in mesh units."""
        return self.transform.matrix(self.place.position)


@dataclass(frozen=True)
class Edit:
    """Everything that a session has done to a shape; never changed, only replaced.

    Raises
    ------
    ValueError
        If two handles share an id, or any two handles or fixed points share a place.
    """

    handles: tuple[Handle, ...] = ()
    fixed: tuple[Place, ...] = ()
    symmetry: SymmetryPlane | None = None
    default: Transform | None = None

    def __post_init__(self) -> None:
        """Refuse two of what may be only once."""
        ids: set[int] = set()
        taken: dict[Vector, str] = {}
        for handle in self.handles:
            if handle.id in ids:
                raise ValueError(f"Edit: `handles` must have distinct ids, got {handle.id} twice")
            ids.add(handle.id)
            if handle.place.position in taken:
                raise ValueError(
                    f"Edit: `handles` must lie at distinct places, got two at {handle.place}: "
                    f"{taken[handle.place.position]} and handle {handle.id}"
                )
            taken[handle.place.position] = f"handle {handle.id}"
        for place in self.fixed:
            if place.position in taken:
                raise ValueError(f"Edit: `fixed` must be free places, but {place} is {taken[place.position]} already")
            taken[place.position] = "fixed"

    def handle(self, function: str, id: int) -> Handle:  # noqa: A002  # the handle's own word for it
        """The handle of that id.

        Raises
        ------
        ValueError
            In the name of `function`, if there is none.
        """
        for handle in self.handles:
            if handle.id == id:
                return handle
        known = ", ".join(str(handle.id) for handle in self.handles) or "none"
        raise ValueError(f"{function}: `handle` must be the id of a handle ({known}), got {id!r}")

    def released(self, function: str, place: Place) -> Edit:
        """The edit without the fixed point at `place`.

        Raises
        ------
        ValueError
            In the name of `function`, if there is none.
        """
        kept = tuple(other for other in self.fixed if other.position != place.position)
        if len(kept) == len(self.fixed):
            raise ValueError(f"{function}: `at` must be a fixed point, got {place}")
        return replace(self, fixed=kept)

    def replaced(self, changed: Handle) -> Edit:
        """The edit with `changed` in place of the handle of its id."""
        return replace(self, handles=tuple(changed if handle.id == changed.id else handle for handle in self.handles))


def place_on(mesh: Mesh, function: str, name: str, at: Any) -> Place:
    """The place that a person means by `at`: a vertex index, three coordinates in mesh units, or a `Place`.

    Raises
    ------
    ValueError
        In the name of `function`, if it is no vertex of `mesh` and no finite point.
    """
    if isinstance(at, Place):
        return at if at.vertex is None else place_on(mesh, function, name, at.vertex)
    if np.ndim(at) == 0:
        if isinstance(at, bool) or not isinstance(at, int | np.integer):
            raise ValueError(f"{function}: `{name}` must be a vertex index or a point, got {at!r}")
        vertex = int(check.vertex_indices(function, name, [at], len(mesh.vertices))[0])
        return Place(vector(function, name, mesh.vertices[vertex]), vertex)
    return Place(vector(function, name, at))


def handle_on(
    mesh: Mesh,
    function: str,
    id: int,  # noqa: A002  # the handle's own word for it
    at: Any,
    transform: Transform,
    locality: float,
    name: Any,
) -> Handle:
    """The handle that a person means, its place as in `place_on`.

    Raises
    ------
    ValueError
        In the name of `function`, if the place is none, `locality` is negative or not finite, or `name` is no text.
    """
    place = place_on(mesh, function, "at", at)
    if name is not None and not (isinstance(name, str) and name):
        raise ValueError(f"{function}: `name` must be a text that is not empty, got {name!r}")
    return Handle(id, place, transform, check.number(function, "locality", locality, minimum=0.0), name)


def edit_on(mesh: Mesh, function: str, edit: Edit) -> Edit:
    """`edit` with its vertices where those of `mesh` lie.

    Raises
    ------
    ValueError
        In the name of `function`, if one of them is no vertex of `mesh`.
    """
    handles = (replace(handle, place=place_on(mesh, function, "edit", handle.place)) for handle in edit.handles)
    fixed = (place_on(mesh, function, "edit", place) for place in edit.fixed)
    return replace(edit, handles=tuple(handles), fixed=tuple(fixed))


def symmetry_on(
    mesh: Mesh, function: str, plane: SymmetryPlane | str, band: float | None, *, field: Field | None = None
) -> SymmetryPlane:
    """The plane that a person means by "x", "y" or "z" (through the centre of the box) or by a plane.

    With a `field`, "auto" is the one of these across which the shape looks most alike. `band`, in mesh units, replaces
    the plane's own. Without it, a named axis gets 3 % of the longest side.

    Raises
    ------
    ValueError
        In the name of `function`, if `plane` is neither, "auto" finds none, or `band` is negative or not finite.
    """
    if plane == "auto" and field is not None:
        found = symmetry_planes(field, mesh)
        if not found:
            raise ValueError(f"{function}: `plane` cannot be 'auto': the shape looks alike across no axis plane")
        plane = axis_name(found[0].normal)
    if isinstance(plane, str):
        if plane not in AXES:
            raise ValueError(f"{function}: `plane` must be x, y, z or a SymmetryPlane, got {plane!r}")
        plane = axis_plane(mesh, plane, band=DEFAULT_BAND * float(np.max(mesh.extents)))
    elif not isinstance(plane, SymmetryPlane):
        raise ValueError(f"{function}: `plane` must be x, y, z or a SymmetryPlane, got {type(plane).__name__}")
    return plane if band is None else replace(plane, band=check.number(function, "band", band, minimum=0.0))


def box_center(mesh: Mesh) -> Vector:
    """Centre of the bounding box, the pivot of a default transform without one, (3,) in mesh units."""
    return vector("box_center", "mesh", np.asarray(mesh.bounds, np.float64).mean(axis=0))
