"""The editing session: handles that stay live, fixed points, symmetry, undo, and the posed shape at any moment."""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dfd.editing.compatibility import check_fit
from dfd.editing.edit import Edit, Handle, Place, Transform, box_center, edit_on, handle_on, place_on, symmetry_on
from dfd.editing.edit_file import read_edit, write_edit
from dfd.editing.handle_weights import HandleWeights
from dfd.editing.history import History
from dfd.editing.posed_shape import PosedShape
from dfd.mesh.mesh import MeshLike, as_mesh
from dfd.symmetry.plane import SymmetryPlane
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from dfd.field.field import Field

__all__ = ["Deformer"]


class Deformer:
    """One editing session of one shape.

    Nothing is ever baked: every handle keeps the numbers it was given and can be changed or removed at any time, and
    `vertices` always follows from the resting mesh. Every change is a step that `undo` takes back, without limit. A new
    handle costs one column of weights, a frame of a drag what the handles that move cost, however many others rest.

    Parameters
    ----------
    mesh
        The resting shape, or whatever `dfd.load` makes one of; it is never changed.
    field
        The shape's feature field, or that of another resolution of the same shape.
    features
        (V, D) features of the vertices when they are at hand, in full or as `dfd.compact` makes them; the field is then
        asked for points in space alone. Otherwise it is asked once they are needed, above 16,384 vertices for compact
        ones, whose weights are within 0.01 of exact, judged by a sample (`features.error`); full ones never exist.

    Raises
    ------
    ValueError
        If `features` is not finite or not one row of the field's width per vertex; without `features`, if the field's
        shape was of another size, below half or above twice the mesh's, or lay elsewhere.

    Warns
    -----
    UserWarning
        If a part of the mesh lies far outside the box of the field's shape.
    """

    def __init__(self, mesh: MeshLike, field: Field, *, features: Any = None) -> None:
        mesh = as_mesh(mesh)
        self.mesh = mesh
        self.field = field
        if features is None:
            check_fit("Deformer", field, mesh)
        self._weights = HandleWeights(mesh, field, features)
        self._posed = PosedShape(mesh, self._weights)
        self._start(Edit())

    def _start(self, edit: Edit) -> None:
        self._history = History(edit)
        self._next_id = 1 + max((handle.id for handle in edit.handles), default=0)

    def __repr__(self) -> str:
        """Say how much is being done to what."""
        return f"Deformer({self.mesh!r}, {len(self.handles)} handles, {len(self.fixed)} fixed points)"

    # --- what there is

    @property
    def edit(self) -> Edit:
        """The present state, an immutable value."""
        return self._history.present

    @property
    def handles(self) -> tuple[Handle, ...]:
        """The live handles, in the order in which they came."""
        return self.edit.handles

    @property
    def fixed(self) -> tuple[Place, ...]:
        """The fixed points, in the order in which they came."""
        return self.edit.fixed

    @property
    def symmetry(self) -> SymmetryPlane | None:
        """The plane across which handles act on both sides, or None."""
        return self.edit.symmetry

    @property
    def default(self) -> Transform | None:
        """D₀ of Eq. 1, what happens to what no handle holds; None is nothing."""
        return self.edit.default

    def handle(self, handle: int) -> Handle:
        """The handle of that id.

        Raises
        ------
        ValueError
            If there is none.
        """
        return self.edit.handle("Deformer.handle", handle)

    # --- handles

    def add(
        self,
        at: int | ArrayLike | Place,
        *,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
        locality: float = 0.0,
        name: str | None = None,
    ) -> int:
        """Take hold of the shape and return the new handle's id.

        Parameters
        ----------
        at
            A vertex index, or any point (3,) in mesh units, on the surface or off it.
        translation
            (3,) in mesh units.
        rotation
            (3,) rotation vector in degrees (axis times angle, right-handed), or a quaternion (x, y, z, w).
        scale
            One factor, or (3,) along the mesh's axes, before the rotation.
        pivot
            (3,) in mesh units, about which it turns and scales; its own position if left out.
        locality
            λ of Eq. 7: 0 reaches everything that looks alike, more stays nearer.
        name
            For people.

        Raises
        ------
        ValueError
            If a number is not finite or of another shape, `locality` is negative, or the place is taken.
        """
        function = "Deformer.add"
        transform = Transform().changed(function, translation=translation, rotation=rotation, scale=scale, pivot=pivot)
        handle = handle_on(self.mesh, function, self._next_id, at, transform, locality, name)
        self._commit(handle, replace(self.edit, handles=(*self.handles, handle)))
        self._next_id += 1
        return handle.id

    def move(
        self,
        handle: int,
        *,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
        merge: bool = False,
    ) -> None:
        """Set parts of a handle's transform, always from the resting shape; what is left out stays. Nothing is rebound.

        Parameters
        ----------
        handle
            The handle's id.
        translation, rotation, scale
            As in `add`.
        pivot
            As in `add`; "auto" returns it to the handle's position.
        merge
            Join the step before if that one moved the same handle: a drag is one plain move and then merged ones, and
            `undo` takes it back whole.

        Raises
        ------
        ValueError
            If there is no such handle, or a number is not finite or of another shape.
        """
        function = "Deformer.move"
        held = self.edit.handle(function, handle)
        transform = held.transform.changed(
            function, translation=translation, rotation=rotation, scale=scale, pivot=pivot
        )
        changed = replace(held, transform=transform)
        self._commit(changed, self.edit.replaced(changed), topic=handle, merge=merge)

    def change(
        self,
        handle: int,
        *,
        at: int | ArrayLike | Place | None = None,
        locality: float | None = None,
        name: str | None = None,
    ) -> None:
        """Set where a handle sits, its locality or its name; what is left out stays.

        Raises
        ------
        ValueError
            As in `add`, or if there is no such handle.
        """
        function = "Deformer.change"
        held = self.edit.handle(function, handle)
        own = held.locality if locality is None else locality, held.name if name is None else name
        changed = handle_on(self.mesh, function, held.id, held.place if at is None else at, held.transform, *own)
        self._commit(changed, self.edit.replaced(changed))

    def remove(self, handle: int) -> None:
        """Let go of a handle.

        Raises
        ------
        ValueError
            If there is no such handle.
        """
        held = self.edit.handle("Deformer.remove", handle)
        self._history.commit(replace(self.edit, handles=tuple(other for other in self.handles if other is not held)))

    # --- what holds for the whole shape

    def fix(self, at: int | ArrayLike | Place) -> None:
        """Hold a vertex or a point (3,) in mesh units in place, and with it all that looks like it (Eq. 6).

        Raises
        ------
        ValueError
            If it is no vertex and no finite point, or is fixed or a handle already.
        """
        place = place_on(self.mesh, "Deformer.fix", "at", at)
        self._history.commit(replace(self.edit, fixed=(*self.fixed, place)))

    def release(self, at: int | ArrayLike | Place) -> None:
        """Take back a `fix`.

        Raises
        ------
        ValueError
            If that point is not fixed.
        """
        place = place_on(self.mesh, "Deformer.release", "at", at)
        self._history.commit(self.edit.released("Deformer.release", place))

    def set_symmetry(self, plane: SymmetryPlane | str | None, *, band: float | None = None) -> None:
        """Let every handle act on both sides of a plane, mirrored on the other side (Eq. 8).

        Parameters
        ----------
        plane
            A plane; "x", "y" or "z" for the plane across that axis through the centre of the box; "auto" for the plane
            across which the shape looks most alike; None for no symmetry.
        band
            Half width, in mesh units, of the zone in which the sides blend; 0 is Eq. 8 to the letter, which tears what
            lies across the plane. If left out: the plane's own, or 3 % of the longest side for an axis or "auto".

        Raises
        ------
        ValueError
            If it is no such plane, `band` is negative or not finite, or "auto" finds no plane.
        """
        chosen = None
        if plane is not None:
            chosen = symmetry_on(self.mesh, "Deformer.set_symmetry", plane, band, field=self.field)
        self._history.commit(replace(self.edit, symmetry=chosen))

    def set_default(
        self,
        *,
        translation: ArrayLike | None = None,
        rotation: ArrayLike | None = None,
        scale: ArrayLike | None = None,
        pivot: ArrayLike | None = None,
    ) -> None:
        """Set D₀ of Eq. 1, what happens to what no handle holds; with nothing given it stays where it is.

        The pivot is the centre of the box if left out; the rest is as in `add`.

        Raises
        ------
        ValueError
            If a number is not finite or of another shape.
        """
        function = "Deformer.set_default"
        transform = Transform().changed(function, translation=translation, rotation=rotation, scale=scale, pivot=pivot)
        transform.matrix(box_center(self.mesh))
        self._history.commit(replace(self.edit, default=None if transform == Transform() else transform))

    def apply(self, edit: Edit) -> None:
        """Replace everything by `edit`, as one step; `Edit()` clears the session.

        Raises
        ------
        ValueError
            If a vertex of `edit` is none of the mesh.
        """
        self._history.commit(edit_on(self.mesh, "Deformer.apply", edit))
        self._next_id = max(self._next_id, 1 + max((handle.id for handle in edit.handles), default=0))

    # --- steps

    @property
    def can_undo(self) -> bool:
        """Whether there is a step to take back."""
        return self._history.can_undo

    @property
    def can_redo(self) -> bool:
        """Whether there is a step that was taken back."""
        return self._history.can_redo

    def undo(self) -> bool:
        """Take the newest step back; False if there is none."""
        return self._history.undo()

    def redo(self) -> bool:
        """Take a step again that was taken back; False if there is none."""
        return self._history.redo()

    def step(self) -> AbstractContextManager[None]:
        """`with deformer.step():` makes one step of all changes inside; if one of them fails, none of them happens."""
        return self._history.step()

    def _commit(self, changed: Handle, edit: Edit, *, topic: Hashable = None, merge: bool = False) -> None:
        _ = changed.matrix  # refuses numbers so large that no finite matrix comes of them
        self._history.commit(edit, topic=topic, merge=merge)

    # --- what comes of it

    def prepare(self, progress: Callable[[int], object] | None = None) -> None:
        """Ask the field for the vertices' features now rather than when they are first needed.

        It is the one long step of a session. `progress` is called with the number of further vertices that are done.
        """
        self._weights.prepare(progress)

    @property
    def features(self) -> NDArray[np.float32] | CompactFeatures:
        """(V, D) features of the vertices, what `dfd.bind` takes: full unit rows or compact ones, see `Deformer`."""
        return self._weights.features

    @property
    def weights(self) -> NDArray[np.float32]:
        """(V, H) weights of the handles, in the order of `handles`, column-major and read-only; they stay as they are.

        Only what changed is bound again.
        """
        return self._weights.of(self.edit)

    @property
    def transforms(self) -> NDArray[np.float64]:
        """(H, 3, 4) affine transforms of the handles, mesh units, in the order of `handles`."""
        return np.array([handle.matrix for handle in self.handles]).reshape(-1, 3, 4)

    @property
    def vertices(self) -> NDArray[np.float64]:
        """(V, 3) the posed shape in mesh units, read-only: Eq. 1, and with a plane Eq. 8.

        Where weights sum to more than 1, handles add up and those at rest count for nothing (`HandleWeights.blend_of`).
        """
        return self._posed.of(self.edit)

    # --- files

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the present edit, without its history, as the JSON document of `dfd.editing.edit_file`.

        Raises
        ------
        OSError
            If `path` cannot be written; a file that was there stays as it was.
        """
        write_edit(path, self.edit, self.mesh)

    @classmethod
    def load(cls, path: str | os.PathLike[str], mesh: MeshLike, field: Field, *, features: Any = None) -> Deformer:
        """Open a session with the edit in `path`, made on `mesh` or on another resolution of the same shape.

        Raises
        ------
        OSError
            If `path` cannot be read.
        ValueError
            If it is no edit; the message names the key and what was found there.
        """
        deformer = cls(mesh, field, features=features)
        deformer._start(read_edit(path, deformer.mesh))
        return deformer
